"""Losses of heads that act."""
