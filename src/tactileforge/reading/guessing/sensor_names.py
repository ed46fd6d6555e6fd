"""Types of sensors in names of files, folders and tables."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from tactileforge.plugins import names
from tactileforge.specs.published import SPECS, is_type

#: Types of sensors that have no package, and those that are most like them.
_FOREIGN = {"wedge": "gelsight", "geltip": "gelsight", "9dtact": "gelsight"}
_FOREIGN |= {"ninedtact": "gelsight", "tac3d": "gelsight"}
#: Sensors whose names begin as those of others.
_ROUND = re.compile(r"(?<![a-z])(digit|gelsight)360(?!_?\d)")
#: Fewest letters of a name for parts of longer words to mean it: no others have these.
_TELLING = 7


def words_of_sensors(name: str) -> str:
    """A name in small letters, with the names of sensors as the specs write them.

    Example:
        >>> words_of_sensors("GelSightMini_2"), words_of_sensors("gsmini-left")
        ('gelsight_mini_2', 'gelsight_mini_left')
        >>> words_of_sensors("GelSight Mini")
        'gelsight_mini'
    """
    words = re.sub(r"[-\s.]+", "_", name.lower()).replace("gel_sight", "gelsight")
    words = re.sub(r"(?<![a-z])dm_?tac(?![a-z])", "dm", words)
    return re.sub(r"(?<![a-z])(?:gelsight|gs)_?mini(?![a-z])", "gelsight_mini", words)


def named_sensor(name: str) -> str:
    """The type of a sensor in a name, the longest one; "" without any.

    Example:
        >>> named_sensor("GelSightMini_2"), named_sensor("DIGIT_D20123"), named_sensor("digits")
        ('gelsight_mini', 'digit', '')
    """
    words = words_of_sensors(name)
    return max((name for name in SPECS if _is_word(name, words)), key=len, default="")


def _is_word(name: str, words: str) -> bool:
    """Whether a name is a word of its own among others."""
    return re.search(rf"(?<![a-z]){re.escape(name)}(?![a-z])", words) is not None


def guess_sensor(
    words: str, shape: Callable[[], tuple[int, int]], doubts: list[str]
) -> dict[str, Any]:
    """Guess the key of the sensor.

    Args:
        words: Names of folders and files.
        shape: Function to height and width of a frame, called where no name tells the type; 1 and 1
            where none can be read.
        doubts: Lines, added to.
    """
    words = words_of_sensors(words)
    if match := _ROUND.search(words):
        doubts.append(
            f"sensor: {match[0]} by its name, which no package has; {match[1]} is the nearest, "
            f"tactileforge plugins new sensor {match[0]} makes one"
        )
        return {"sensor": match[1]}
    named = [
        name for name in SPECS if _is_word(name, words) or (len(name) >= _TELLING and name in words)
    ]
    named = named or [name for name in names("sensors") if _is_word(name, words) and is_type(name)]
    if named:
        return {"sensor": max(named, key=len)}  # gelsight_mini holds gelsight
    if _is_word("digits", words):
        doubts.append("sensor: digit, by the word digits, which may mean others")
        return {"sensor": "digit"}
    height, width = shape()
    if foreign := next((name for name in _FOREIGN if name in words), ""):
        doubts.append(
            f"sensor: {foreign} by its name, which no package has; {_FOREIGN[foreign]} is the "
            f"nearest, tactileforge plugins new sensor {foreign} makes one"
        )
        return {"sensor": _FOREIGN[foreign]}
    # DIGIT alone of the usual sensors is taller than wide
    sensor = "digit" if height > width else "gelsight_mini"
    why = f"only by the shape {height} x {width}"
    if (height, width) == (1, 1):
        why = "stands in, as no picture can be read"
    doubts.append(f"sensor: no name tells the type; {sensor} {why}")
    return {"sensor": sensor}
