"""Parts of a training: what is built, fitted, logged and kept."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
