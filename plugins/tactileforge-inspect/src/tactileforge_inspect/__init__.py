"""A data set on one page, before anything is trained on it.

``import tactileforge_inspect`` imports neither torch nor OpenCV: names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactileforge_inspect.findings import InspectionFindings, Reason, Suspect, Total
    from tactileforge_inspect.write import inspect

__all__ = ["InspectionFindings", "Reason", "Suspect", "Total", "inspect"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from tactileforge_inspect import findings, write

        return getattr(write if name == "inspect" else findings, name)
    raise AttributeError(f"module 'tactileforge_inspect' has no attribute {name!r}")
