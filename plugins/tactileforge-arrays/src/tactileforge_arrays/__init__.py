"""Arrays of taxels for tactileforge: a driver to derive from, simulated arrays, and a recipe.

``import tactileforge_arrays`` costs no numpy, since light commands list its recipes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactileforge_arrays.serial_array import SerialArray

__all__ = ["SerialArray"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from tactileforge_arrays.serial_array import SerialArray

        return SerialArray
    raise AttributeError(f"module 'tactileforge_arrays' has no attribute {name!r}")
