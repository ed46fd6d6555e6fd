"""Types of sensors in names of files, folders and tables."""

from __future__ import annotations

import re

from tactileforge.specs.published import SPECS


def words_of_sensors(name: str) -> str:
    """A name in small letters, with the names of sensors as the specs write them.

    Example:
        >>> words_of_sensors("GelSightMini_2"), words_of_sensors("gsmini-left")
        ('gelsight_mini_2', 'gelsight_mini_left')
        >>> words_of_sensors("GelSight Mini")
        'gelsight_mini'
    """
    words = re.sub(r"[-\s.]+", "_", name.lower()).replace("gel_sight", "gelsight")
    return re.sub(r"(?<![a-z])(?:gelsight|gs)_?mini(?![a-z])", "gelsight_mini", words)


def named_sensor(name: str) -> str:
    """The type of a sensor in a name, the longest one; "" without any.

    Example:
        >>> named_sensor("GelSightMini_2"), named_sensor("DIGIT_D20123"), named_sensor("digits")
        ('gelsight_mini', 'digit', '')
    """
    words = words_of_sensors(name)
    named = [spec for spec in SPECS if re.search(rf"(?<![a-z]){spec}(?![a-z])", words)]
    return max(named, key=len, default="")
