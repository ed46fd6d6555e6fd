"""Maps as files, and from topics alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactileforge.errors import ConfigError
from tactileforge.plugins import strict
from tactileforge.reading import check_origin, check_stream
from tactileforge_rosbags.map_keys import BagMap, TouchKeys, finger_of


def map_of(topics: Mapping[str, str]) -> BagMap:
    """A map of topics of touch alone.

    Args:
        topics: Type of the sensor by topic.
    """
    touch = tuple(TouchKeys(topic=topic, sensor=sensor) for topic, sensor in topics.items())
    return BagMap(touch=touch)


def check_map(where: str, content: Any) -> BagMap:
    """A map by its keys.

    Args:
        where: Place of the keys, for errors.
        content: The keys, plain data.

    Raises:
        ConfigError: A key is unknown, missing or of another type, or keys contradict each other.
    """
    made: BagMap = strict.build(BagMap, where, content)
    if not made.touch:
        raise ConfigError(f"{where}: touch is empty; say which topics are touch")
    check_origin(made, where)
    for stream in (*made.touch, *([made.camera] if made.camera else [])):
        check_stream(stream, f"{where}: {stream.topic}")
    if not made.gap > 0:
        raise ConfigError(f"{where}: gap is {made.gap}; give seconds above 0")
    fingers = [finger_of(touch) for touch in made.touch]
    if twice := sorted({name for name in fingers if fingers.count(name) > 1}):
        raise ConfigError(f"{where}: two touches are called {twice[0]!r}; give each its `finger`")
    for touch in made.touch:
        _check_force(f"{where}: touch.force", touch)
    for bag, parts in made.intervals.items():
        if bad := [part for part in parts if not 0 <= part.start < part.stop]:
            raise ConfigError(
                f"{where}: intervals of {bag}: {bad[0].start} s to {bad[0].stop} s; give a begin, "
                "0 or more, and a later end"
            )
    return made


def _check_force(where: str, touch: TouchKeys) -> None:
    if touch.force is None:
        return
    if any(column not in (None, 0, 1, 2) for column in touch.force.columns):
        raise ConfigError(f"{where}.columns {touch.force.columns}; give 0, 1, 2 or null")
    touch.force.newtons([touch.force.topic] * 3, where)
