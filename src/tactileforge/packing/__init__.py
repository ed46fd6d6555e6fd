"""Data sets as shards: `data pack` and `data filter`."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
