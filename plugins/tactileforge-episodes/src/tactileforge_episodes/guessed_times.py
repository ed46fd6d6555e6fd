"""Times of a guessed map: arrays of them, or the rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tactileforge.data import UNITS
from tactileforge.errors import DataError
from tactileforge.reading import (
    ASSUMED_FPS,
    COMMANDS,
    ROBOT,
    VIEWS,
    says_touch,
    time_unit,
    touch_of,
)
from tactileforge_episodes.guessed_arrays import TIMES, FoundArrays
from tactileforge_episodes.looks import Look

#: Words of times that are not of touch.
_ELSEWHERE = ROBOT | COMMANDS | VIEWS
#: Attributes and arrays with a rate.
_RATES = (
    *("fps", "frame_rate", "framerate", "rate", "rate_hz", "hz", "frequency", "freq"),
    *("control_freq", "control_frequency", "sampling_rate", "sample_rate"),
)
#: Rates of formats whose files have none: robomimic, LIBERO and MimicGen; ALOHA.
_USUAL = (("obs/", 20), ("observations/", 50))


def guess_times(found: FoundArrays, entries: Mapping[str, Any], ends: str) -> dict[str, Any]:
    """Guess the key of the times of all touch, else of the rate; {} where each has its own.

    Args:
        found: The arrays.
        entries: Entries of touch by key; times of one of several are added to its own.
        ends: Array of the ends of episodes; "" for none.

    Raises:
        DataError: The name of an array of times says another unit than its values.
    """
    rows = found.looks[next(iter(entries))].facts.rows
    clocks = [look for look in found.clocks(rows) if look.key not in found.used]
    clocks.sort(key=lambda one: (not says_touch(one.words), one.has(_ELSEWHERE), len(one.words)))
    first = _first(found, rows, ends)
    shared: dict[str, Any] = {}
    for look in clocks:
        touch = touch_of(look.key, [*entries])
        if len(touch) == 1 < len(entries):
            entry = entries[touch[0]]
            entry |= {} if "times" in entry else _read_times(found, look, first)
        elif not shared:
            shared = _read_times(found, look, first)
    if all("times" in entry for entry in entries.values()):
        return {}
    return shared or _rate(found)


def _first(found: FoundArrays, rows: int, ends: str) -> int:
    """Rows of the first episode."""
    if not ends:
        return rows
    look = found.looks[ends]
    values = found.values(look, look.facts.rows).reshape(-1).astype(np.int64)
    if len(values) == rows:
        return int(np.argmax(values != values[0])) or rows
    return int(next((one for one in values if one > 0), rows))


def _read_times(found: FoundArrays, look: Look, rows: int) -> dict[str, Any]:
    """Key of times; {} for an array without them."""
    try:
        unit, why = time_unit(look.key, found.values(look, rows).reshape(-1))
    except ValueError as error:
        raise DataError(
            f"{found.name}: {look}: {error}; correct the name, or say the unit in a map: "
            f"times: {{array: {look.key}, unit: s}}"
        ) from error
    if unit == "frames":
        return {}
    if not unit:
        found.doubts.append(f"times: {look.key} is left out, as {why}")
        return {}
    found.used.add(look.key)
    found.doubts.append(f"times: {look.key} in {unit}, {why}")
    return {"times": {"array": look.key, "unit": unit}}


def own_clock(found: FoundArrays, force: Look, frames: Mapping[str, Any]) -> dict[str, str]:
    """Key of a force's own times, of its group or name; {} for those of the frames.

    Args:
        found: The arrays.
        force: The force.
        frames: Arrays of the times of frames, by those of touch.
    """
    groups = {key.rpartition("/")[0] for key in frames}
    group = force.key.rpartition("/")[0]
    for look in found.clocks(force.facts.rows):
        is_near = look.key.rpartition("/")[0] == group != "" and group not in groups
        named = {*look.words} - TIMES - UNITS.keys()
        if look.key in frames.values() or not (is_near or (named and named <= {*force.words})):
            continue
        try:
            unit, _ = time_unit(look.key, found.values(look, force.facts.rows).reshape(-1))
        except ValueError:
            continue
        if unit in UNITS:
            return {"array": look.key, "unit": unit}
    return {}


def _rate(found: FoundArrays) -> dict[str, Any]:
    """Key of the rate: of an attribute, the JSON of a simulator or an array; else a usual one."""
    for key in found.groups():
        for name in _RATES:
            if _is_rate(found.attribute(key, name)):
                return {"fps": {"array": found.place(key), "attr": name}}
    for key, rate in found.in_json("env_args", "env_kwargs", "control_freq"):
        if _is_rate(rate):
            json = "env_kwargs.control_freq"
            return {"fps": {"array": f"/{key}", "attr": "env_args", "json": json}}
    for key, look in found.looks.items():
        if look.has(_RATES) and look.facts.shape in ((), (1,)) and look.is_numbers:
            found.used.add(key)
            return {"fps": {"array": key, "whole": True}}
    usual = (rate for start, rate in _USUAL if any(key.startswith(start) for key in found.looks))
    rate = next(usual, ASSUMED_FPS)
    found.doubts.append(f"fps: {rate} is assumed, as nothing tells the rate (data.fps)")
    return {"fps": rate}


def _is_rate(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= 1e5
