"""Presets of data, as options of the command line."""
