"""Encoders and the probes fitted on them."""
