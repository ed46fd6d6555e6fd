"""Simulated against real touch: the same measures of both, and their distances."""
