"""What is known of a recording, by name: what splits go by."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from tactileforge.bench.tasks.source import TaskSource
from tactileforge.errors import ConfigError


def recording_fact(source: TaskSource, number: int, name: str) -> str:
    """What is known of a recording; see `suite.SplitPlan`.

    Raises:
        ConfigError: Nothing is known by that name.
    """
    one = source.recordings[number]
    known = {
        "side": source.sides[number],
        "sensor": one.sensor,
        "object": one.object or "",
        "recording": one.key,
        "tier": str(one.tier),
    }
    if name.startswith("re:"):
        found = re.search(name[3:], one.key)
        if not found:
            raise ConfigError(f"split: {name!r} finds nothing in the key {one.key!r}")
        return found[found.lastindex or 0]
    if name in known:
        return known[name]
    value = one.labels.get(name)
    if value is None:
        have = ", ".join([*known, *one.labels])
        raise ConfigError(f"split: recording {one.key!r} has no {name!r} (it has: {have})")
    return value if isinstance(value, str) else f"{value:g}"


def matches_filter(source: TaskSource, number: int, chosen: Mapping[str, Any]) -> bool:
    """Whether a recording has the facts that a filter names; see `suite.SplitPlan`."""
    for name, wanted in chosen.items():
        values = {str(one) for one in (wanted if isinstance(wanted, list) else [wanted])}
        if recording_fact(source, number, name) not in values:
            return False
    return True
