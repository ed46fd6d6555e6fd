"""From recordings to batches: frames, labels, shards and the data module."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
