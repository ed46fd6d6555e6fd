"""Readers shared by data sets: layouts, tables, pickles, splits."""
