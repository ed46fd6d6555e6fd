"""Encoders and the probes that are fitted on them."""
