"""Imports of published touch encoders."""
