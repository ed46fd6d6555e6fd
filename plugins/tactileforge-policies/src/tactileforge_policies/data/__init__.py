"""Demonstrations: read, grouped into episodes, and cut into samples."""
