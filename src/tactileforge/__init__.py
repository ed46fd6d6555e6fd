"""tactileforge: train, compare and run encoders of touch for optical tactile sensors.

``import tactileforge`` costs no torch: names are imported on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactileforge.hub.loading import list_models, load
    from tactileforge.plugins.registry import list_plugins

__version__ = "0.1.0"
__all__ = ["__version__", "list_models", "list_plugins", "load"]

_HOMES = {
    "list_models": "tactileforge.hub.loading",
    "list_plugins": "tactileforge.plugins.registry",
    "load": "tactileforge.hub.loading",
}


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'tactileforge' has no attribute {name!r}")
