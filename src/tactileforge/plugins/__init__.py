"""Plugins by name, their commands, and tools for them: whole files, locks, processes, bars."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
