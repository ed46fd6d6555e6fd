"""Losses of policy heads."""
