"""Bags recognised by their files, and touch by the names of topics."""

from __future__ import annotations

from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge.reading import (
    AXES,
    force_of_touch,
    guess_sensor,
    guess_sign,
    scene_among,
    touch_among,
)
from tactileforge_rosbags.bags import Bag, find_bags
from tactileforge_rosbags.series import placed
from tactileforge_rosbags.topic_frames import KINDS, size_of
from tactileforge_rosbags.values import WRENCHES, wrench_of

#: Ends of topics with the pictures of another topic once more, or with a depth.
_AGAIN, _DEPTH = ("/compressed", "/theora"), "/compressedDepth"
#: Messages of a force that are looked at for its sign.
_LOOKED_AT = 2000


def guess(root: Path) -> Guess | None:
    """Recognises bags; None for a folder without any.

    Args:
        root: Folder or file.
    """
    try:
        bag = next(find_bags(root))
        pictures = _pictures(bag)
    except (DataError, OSError):
        return None
    topics = touch_among(pictures)
    if not topics:
        doubts = ["no topic is called touch: say which is, data.topics={TOPIC: SENSOR}"]
        return _guess({"root": str(root), "topics": {}}, doubts)
    doubts = []
    touch = [_sensor(bag, topic, doubts) for topic in topics]
    options: dict[str, Any] = {"touch": touch}
    rest = [name for name in pictures if name not in topics]
    if view := scene_among(rest):
        doubts.append(f"camera: {view} is the view of the scene")
        options["camera"] = {"topic": f"{view}?"}
    if left := [name for name in rest if name != view]:
        doubts.append(f"pictures without a word of touch, left out: {', '.join(left)}")
    _add_forces(bag, touch, doubts)
    doubts.append(
        "background: none is known, so nothing is subtracted; data.background=first where bags "
        "begin without contact"
    )
    return _guess({"root": str(root), "map": options}, doubts)


def _guess(options: dict[str, Any], doubts: list[str]) -> Guess:
    return Guess(options=options, format="ROS bags", score=0.9, doubts=doubts)


def _pictures(bag: Bag) -> list[str]:
    """Topics of pictures; those that repeat another topic are left out."""
    found = sorted(one.name for one in bag.topics.values() if one.kind in KINDS)
    again = {one + end for one in found for end in _AGAIN}
    return [one for one in found if one not in again and not one.endswith(_DEPTH)]


def _sensor(bag: Bag, topic: str, doubts: list[str]) -> dict[str, Any]:
    """Entry of the map for a topic of touch."""

    def shape() -> tuple[int, int]:
        with suppress(DataError):
            for _, _, message in islice(placed(bag, topic, None, None), 1):
                return size_of(message)
        return 1, 1

    lines: list[str] = []
    sensor = guess_sensor(topic, shape, lines)
    doubts.append(f"{topic} is taken for touch of {sensor['sensor']}, by its name")
    doubts += [f"{topic}: {line}" for line in lines]
    return {"topic": topic, **sensor}


def _add_forces(bag: Bag, touch: list[dict[str, Any]], doubts: list[str]) -> None:
    """Add to each touch the key of its force, if names of topics leave no choice."""
    wrenches = sorted(one.name for one in bag.topics.values() if one.kind in WRENCHES)
    force = force_of_touch([one["topic"] for one in touch], wrenches)
    for entry in touch:
        if entry["topic"] in force:
            entry["force"] = _force(bag, force[entry["topic"]], doubts)
    if rest := [one for one in wrenches if one not in force.values()]:
        doubts.append(
            f"wrenches are tracks ({', '.join(rest)}): a map says whose force on a gel they are, "
            "and its signs"
        )


def _force(bag: Bag, topic: str, doubts: list[str]) -> dict[str, Any]:
    doubts.append(f"force: {topic} is taken for that on the gel, in N, {AXES}")
    force: dict[str, Any] = {"topic": f"{topic}?"}
    try:
        found = islice(placed(bag, topic, None, None), _LOOKED_AT)
        z = np.array([wrench_of(message)[2] for _, _, message in found], np.float64)
    except DataError:
        return force  # named when it is read
    return force | guess_sign(f"z of {topic}", z, doubts)
