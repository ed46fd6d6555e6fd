"""Bags recognised by their files, and touch by the names of topics."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge.reading import is_turned
from tactileforge.specs import SPECS
from tactileforge_rosbags.bags import Bag, find_bags
from tactileforge_rosbags.pictures import KINDS
from tactileforge_rosbags.series import placed
from tactileforge_rosbags.values import WRENCHES, wrench_of

#: Words of topics of touch.
_TOUCH = re.compile(r"tactile|touch|gel|digit|finger|taxel")
#: Words of topics of forces on the robot.
_ROBOT = re.compile(
    r"robot|tcp|flange|wrist|(?<![a-z])(?:arm|eef?|gripper|base|joint|motor)(?![a-z])"
)
#: Messages of a force that are looked at for its sign.
_LOOKED_AT = 2000
#: Type of the sensor taken for a topic of touch that names none.
_ANY = "gelsight_mini"


def guess(root: Path) -> Guess | None:
    """Recognises bags; None for a folder without any.

    Args:
        root: Folder or file.
    """
    try:
        bag = next(find_bags(root))
        pictures = sorted(one.name for one in bag.topics.values() if one.kind in KINDS)
    except (DataError, OSError):
        return None
    topics = {name: _sensor(name) for name in pictures if _TOUCH.search(name.lower())}
    doubts = [f"{name} is taken for touch of {topics[name]}, by its name" for name in topics]
    if not topics:
        doubts.append("no topic is called touch: say which is, data.topics={TOPIC: SENSOR}")
        return _guess({"root": str(root), "topics": {}}, doubts)
    touch: list[dict[str, Any]] = [{"topic": one, "sensor": topics[one]} for one in topics]
    options: dict[str, Any] = {"touch": touch}
    if views := [name for name in pictures if name not in topics]:
        doubts.append(f"camera: {views[0]} is the view of the scene")
        options["camera"] = {"topic": f"{views[0]}?"}
    if len(views) > 1:
        doubts.append(f"pictures without a word of touch, left out: {', '.join(views[1:])}")
    touch[0] |= _force(bag, len(topics), doubts)
    return _guess({"root": str(root), "map": options}, doubts)


def _guess(options: dict[str, Any], doubts: list[str]) -> Guess:
    return Guess(options=options, format="ROS bags", score=0.9, doubts=doubts)


def _force(bag: Bag, count: int, doubts: list[str]) -> dict[str, Any]:
    """Key of the force of the only touch, from the only topic of it; {} otherwise."""
    wrenches = sorted(one.name for one in bag.topics.values() if one.kind in WRENCHES)
    if not wrenches:
        return {}
    if count > 1 or len(wrenches) > 1 or _ROBOT.search(wrenches[0].lower()):
        doubts.append(
            "wrenches are tracks: a map says whose force on a gel they are, and its signs"
        )
        return {}
    (topic,) = wrenches
    doubts.append(
        f"force: {topic} is taken for that on the gel, in N, x right, y down, z into the gel, "
        "pressing positive"
    )
    force: dict[str, Any] = {"topic": f"{topic}?"}
    try:
        found = islice(placed(bag, topic, None, None), _LOOKED_AT)
        z = np.array([wrench_of(message)[2] for _, _, message in found], np.float64)
    except DataError:
        return {"force": force}  # named when it is read
    if is_turned(z):
        doubts.append(f"force: z of {topic} is negative where large, so it is turned")
        force["sign"] = [1, 1, -1]
    return {"force": force}


def _sensor(topic: str) -> str:
    """Type of the sensor named by a topic: that of the longest name in it."""
    named = [name for name in SPECS if len(name) > 2 and name in topic.lower()]
    return max(named, key=len, default=_ANY)
