"""HTML pages: style, pieces, figures and images."""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
