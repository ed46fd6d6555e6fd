"""Heads that act: what a robot perceives, to a chunk of commands."""
