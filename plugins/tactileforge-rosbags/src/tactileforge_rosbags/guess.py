"""Bags recognised by their files, and touch by the names of topics."""

from __future__ import annotations

import re
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge.specs import SPECS
from tactileforge_rosbags.bags import find_bags
from tactileforge_rosbags.pictures import KINDS

#: Words of topics of touch.
_TOUCH = re.compile(r"tactile|touch|gel|digit|finger|taxel")
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
    if left := [name for name in pictures if name not in topics]:
        doubts.append(f"pictures without a word of touch, left out: {', '.join(left)}")
    if not topics:
        doubts.append("no topic is called touch: say which is, data.topics={TOPIC: SENSOR}")
    doubts.append("wrenches are tracks: a map says whose force on a gel they are, and its signs")
    return Guess(
        options={"root": str(root), "topics": topics}, format="ROS bags", score=0.9, doubts=doubts
    )


def _sensor(topic: str) -> str:
    """Type of the sensor named by a topic: that of the longest name in it."""
    named = [name for name in SPECS if len(name) > 2 and name in topic.lower()]
    return max(named, key=len, default=_ANY)
