"""Displacement of printed markers as an objective."""
