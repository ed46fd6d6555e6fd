"""Plugins: their registry, the packages that bring them, and changes of their contract."""
