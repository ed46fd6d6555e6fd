"""Maps as files: those of the package, and a user's own."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import load_yaml, strict
from tactileforge.reading import check_origin, check_stream
from tactileforge_episodes.forces import newtons
from tactileforge_episodes.map_keys import EpisodeMap, TouchKeys

_FOLDER = "tactileforge_episodes.maps"


def preset_names() -> list[str]:
    """Names of the maps of the package."""
    found = (path.name for path in files(_FOLDER).iterdir())
    return sorted(name.removesuffix(".yaml") for name in found if name.endswith(".yaml"))


@cache
def read_preset(name: str) -> EpisodeMap:
    """A map of the package.

    Raises:
        ConfigError: There is none of this name; the message names the nearest.
    """
    if name not in preset_names():
        raise ConfigError(unknown("data.preset", name, preset_names()))
    text = (files(_FOLDER) / f"{name}.yaml").read_text("utf-8")
    return parse_map(f"{name}.yaml", load_yaml(text))


def parse_map(where: str, content: Any) -> EpisodeMap:
    """Checks the content of a map.

    Args:
        where: Name of the file, for messages.
        content: Plain values.

    Raises:
        ConfigError: A key is unknown, missing or of another type, or keys contradict each other.
    """
    made: EpisodeMap = strict.build(EpisodeMap, where, content)
    if not made.touch:
        raise ConfigError(f"{where}: touch is empty; say which key is touch")
    check_origin(made, where)
    if made.camera:
        check_stream(made.camera, f"{where}: camera")
    for touch in made.touch:
        _check(where, touch)
    return made


def _check(where: str, touch: TouchKeys) -> None:
    check_stream(touch, f"{where}: touch")
    taxels = touch.taxels
    if taxels and taxels.columns is not None and len(taxels.columns) not in (1, 3):
        raise ConfigError(f"{where}: touch.taxels.columns has {len(taxels.columns)}; give 1 or 3")
    if taxels and (taxels.size < 1 or (taxels.span is not None and taxels.span <= 0)):
        raise ConfigError(f"{where}: touch.taxels: give a size and a span above 0")
    if touch.white is not None and touch.white <= 0:
        raise ConfigError(f"{where}: touch.white is {touch.white}; give the value of white")
    if touch.force and any(column is not None and column < 0 for column in touch.force.columns):
        raise ConfigError(f"{where}: touch.force.columns: give columns from 0, or null")
    if touch.force:
        newtons(touch.force, f"{where}: touch.force")
    if isinstance(touch.parts, dict) and any(not 0 <= a < b for a, b in touch.parts.values()):
        raise ConfigError(f"{where}: touch.parts: give first column, and the one after the last")
