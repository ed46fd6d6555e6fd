"""Folders of runs, and the checkpoints in them."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
