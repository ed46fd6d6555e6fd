"""Packages for the reading of files, imported on use."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tactileforge.errors import ConfigError


def need(name: str, where: str) -> Any:
    """Imports a package.

    Args:
        name: Name of the package, or of a module within one.
        where: File that needs it, for messages.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        top = name.partition(".")[0]
        raise ConfigError(f"{where}: is read by {name}: pip install {top} ({error})") from error
