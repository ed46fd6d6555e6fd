"""Built-in data sets: one class a file, registered by entry points like those of plugins."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
