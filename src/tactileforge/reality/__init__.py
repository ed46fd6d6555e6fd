"""Simulated touch beside real: the same numbers of both, and how far they are apart."""
