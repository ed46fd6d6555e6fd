"""Checks of touch data: rules with a code, a reason and a fix, run wherever data enters."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
