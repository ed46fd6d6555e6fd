"""Built-in heads: one class per file, registered by entry points like those of other packages."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
