"""Facts of a recording by name, for splits and filters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from tactileforge.errors import ConfigError, nearest_name, unknown
from tactileforge_bench.tasks.source import TaskSource


def recording_fact(source: TaskSource, number: int, name: str) -> str:
    """Looks up a fact of a recording by name; see `suite.SplitPlan`.

    Raises:
        ConfigError: Nothing is known by that name.
    """
    recording = source.recordings[number]
    known = {
        "side": source.sides[number],
        "sensor": recording.sensor,
        "object": recording.object or "",
        "recording": recording.key,
        "tier": str(recording.tier),
    }
    if name.startswith("re:"):
        match = re.search(name[3:], recording.key)
        if not match:
            raise ConfigError(f"split: {name!r} does not match the key {recording.key!r}")
        # the last group in parentheses, or all that matches
        return match[match.lastindex or 0]
    if name in known:
        return known[name]
    value = recording.labels.get(name)
    if value is None:
        have = [*known, *recording.labels]
        near = nearest_name(name, have)
        raise ConfigError(
            f"split: recording {recording.key!r} has no {name!r}{near} It has: {', '.join(have)}"
        )
    return label_text(value)


def unknown_values(source: TaskSource, chosen: Mapping[str, Any]) -> str:
    """The first value of a filter without a recording, as text with the nearest; "" for none."""
    for name, wanted in chosen.items():
        known = {recording_fact(source, n, name) for n in range(len(source.recordings))}
        for value in map(str, wanted if isinstance(wanted, list) else [wanted]):
            if value not in known:
                text = unknown(f"value of {name}", value, known)
                is_whole = (name, value) == ("side", "val")
                return f"{text}. The data hold nothing out: give val: SHARE" if is_whole else text
    return ""


def label_text(value: str | float) -> str:
    """A label as text; a whole number has no decimals, no digit is lost."""
    if isinstance(value, str):
        return value
    number = float(value)
    return str(int(number)) if number.is_integer() else repr(number)


def matches_filter(source: TaskSource, number: int, chosen: Mapping[str, Any]) -> bool:
    """Whether the facts of a recording match a filter; see `suite.SplitPlan`."""
    for name, wanted in chosen.items():
        values = {str(value) for value in (wanted if isinstance(wanted, list) else [wanted])}
        if recording_fact(source, number, name) not in values:
            return False
    return True
