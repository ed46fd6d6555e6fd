"""Former home of the names for authors of plugins; an alias for one release.

Each name is in a public package now: `tactileforge.contracts`, `.data`, `.sensors`, `.plugins` and
the others of docs/reference.md. ``from tactileforge.plugin import Frame`` is
``from tactileforge.contracts import Frame``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tactileforge.plugins.moves import home_of


def __getattr__(name: str) -> Any:
    if package := home_of(name):
        return getattr(import_module(package), name)
    raise AttributeError(f"module 'tactileforge.plugin' has no attribute {name!r}", name=name)
