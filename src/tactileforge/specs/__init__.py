"""Published types of sensors, as data."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
