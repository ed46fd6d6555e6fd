"""Readers of published touch data sets, one a module; see ``docs/datasets.md``."""
