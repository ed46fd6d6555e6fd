"""tactileforge: train, compare and run encoders of touch for optical tactile sensors.

``import tactileforge`` costs no torch: names are imported on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = ["__version__", "list_plugins"]

_HOMES = {"list_plugins": "tactileforge.registry"}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'tactileforge' has no attribute {name!r}")
