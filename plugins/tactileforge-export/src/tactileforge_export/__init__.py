"""Exports of models as ONNX and torch programs."""
