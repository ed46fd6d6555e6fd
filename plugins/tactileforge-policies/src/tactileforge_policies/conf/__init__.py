"""Recipes, a suite and presets of scale, as options of the command line."""
