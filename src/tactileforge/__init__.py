"""tactileforge: train, compare and run encoders of touch for optical tactile sensors.

``import tactileforge`` costs no torch: names are imported on first use.
"""

from tactileforge.util import lazy

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy.attach(__name__)
__all__ += ["__version__"]
