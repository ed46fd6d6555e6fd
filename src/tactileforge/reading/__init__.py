"""Readers shared by data sets: layouts, tables, pickles, splits."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
