"""Names of a public package, imported on first use."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def attach(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Public names of a package, read from the stub ``__init__.pyi`` beside its ``__init__.py``.

    The stub is what type checkers read, so each public name is listed once. Importing the package
    imports none of its modules: `import tactileforge.sensors` needs no torch.

    Args:
        package: Name of the package, its ``__name__``.

    Returns:
        ``__getattr__``, ``__dir__`` and ``__all__`` of the package.

    Example:
        >>> import tactileforge.packing
        >>> _, _, names = attach("tactileforge.packing")
        >>> names
        ['Filter', 'PackOptions', 'pack', 'summary']
    """
    homes = _homes(str(sys.modules[package].__file__))
    public = sorted(homes)

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name)
        home = homes[name]
        if home == package:  # a module of the package
            return import_module(f"{home}.{name}")
        module = import_module(home)
        value = getattr(module, name) if hasattr(module, name) else import_module(f"{home}.{name}")
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: public, public


@cache
def _homes(init: str) -> dict[str, str]:
    """Module of each name of a stub."""
    tree = ast.parse(Path(init).with_suffix(".pyi").read_text("utf-8"))
    return {
        item.asname or item.name: str(node.module)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for item in node.names
    }
