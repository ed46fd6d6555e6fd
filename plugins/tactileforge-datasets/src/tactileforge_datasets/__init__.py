"""Readers of published touch data sets, one per module; see ``docs/datasets.md``."""
