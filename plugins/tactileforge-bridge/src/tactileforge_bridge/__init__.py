"""Readings of ``tactileforge live`` for other programs."""
