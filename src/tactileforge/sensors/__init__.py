"""Live sensors: specs, packets, health, and reading in threads."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
