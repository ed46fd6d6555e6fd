"""Built-in encoders: one class per file, with entry points like those of other packages."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
