"""Readers that data sets share: layouts, tables, pickles, splits."""
