"""Packages of optional extras, imported where they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tactileforge.errors import ConfigError


def diffusers(module: str) -> Any:
    """Imports a module of ``diffusers``: schedulers of noise, and of the learning rate.

    Args:
        module: Its name within the package, such as ``optimization``.

    Raises:
        ConfigError: The extra ``policies`` is not installed.
    """
    try:
        return import_module(f"diffusers.{module}")
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"policies need {error.name}, which is not installed: pip install "
            "'tactileforge[policies]'"
        ) from error
