"""Recipes and their cards, shipped with the package as ``tactileforge.zoo``."""
