"""Forces of a guessed map: their fingers, units, signs and clocks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactileforge.data import NEWTONS, named_unit
from tactileforge.reading import AXES, force_of_touch, guess_sign
from tactileforge_episodes.guessed_arrays import FORCES, TIMES, FoundArrays
from tactileforge_episodes.guessed_times import own_clock
from tactileforge_episodes.looks import Look

#: Sizes of the last axis of forces along an axis, along three, and with torques.
_SINGLE, _WHOLE = ((), (1,)), ((3,), (6,))
#: Axis of the bodies of a simulator, where a sensor is one.
_ONE = (1,)


def guess_forces(
    found: FoundArrays, entries: Mapping[str, dict[str, Any]], keys: Mapping[str, Any]
) -> None:
    """Give each touch its force: of its own words, or the only one of the only touch.

    Args:
        found: The arrays.
        entries: Entries of touch by key, which get the key ``force``.
        keys: The map so far.
    """
    rows = found.looks[next(iter(entries))].facts.rows
    times = {key: one.get("times") or keys.get("times") for key, one in entries.items()}
    frames = {key: one["array"] for key, one in times.items() if one}
    # rows of all episodes, or a rate, have no second clock
    is_timed = "ends" not in keys and len(frames) == len(entries)
    forces = [look for look in found.looks.values() if _is_force(found, look)]
    clocks = {look.key: own_clock(found, look, frames) if is_timed else {} for look in forces}
    forces = [one for one in forces if one.facts.rows == rows or clocks[one.key]]
    axes = _axes_of([look.key for look in forces if look.width in _SINGLE])
    named = {axes.get(look.key, look.key): look for look in forces}
    given = set()
    for key, entry in entries.items():
        pads = found.looks[key].width[:1] if entry.get("pads") else ()
        fits = [name for name, look in named.items() if look.width[:-1] in (pads, pads or _ONE)]
        name = force_of_touch([*entries], fits).get(key, "")
        if name and (force := _force(found, name, named[name], clocks[named[name].key])):
            entry["force"] = force
            given.add(name)
            unit = force.get("unit", "N")
            found.doubts.append(f"force: {name} is taken for that on {key}, in {unit}, {AXES}")
    for look in forces:
        if axes.get(look.key, look.key) not in given:
            if look.facts.rows == rows:
                found.doubts.append(
                    f"force: {look.key} is a track, as it is not of one touch alone"
                )
        elif look.width[-1:] != (6,):  # torques are a track
            found.used.add(look.key)


def _is_force(found: FoundArrays, look: Look) -> bool:
    """Whether an array is a force by its name and shape."""
    is_named = look.has(FORCES) or look.words[-1:] == ("f",)
    is_time = look.has(TIMES) and look.width in _SINGLE
    is_row = look.width[-1:] in (*_SINGLE, *_WHOLE) and bool(look.facts.shape)
    return is_named and look.is_numbers and look.key not in found.used and not is_time and is_row


def _force(
    found: FoundArrays, name: str, look: Look, clock: Mapping[str, str]
) -> dict[str, Any] | None:
    """Key of a force; None in a unit of something else."""
    named = named_unit(name.rpartition("/")[2].replace("{axis}", "z"))
    said = (str(found.attribute(found.top + look.key, one) or "") for one in ("unit", "units"))
    unit = named or next((unit for text in said if (unit := named_unit(text))), "N")
    if unit not in NEWTONS:
        where = "name" if named else "attribute"
        found.doubts.append(f"force: {name} is in {unit} by its {where}, so it is a track")
        return None
    is_whole = look.width[-1:] in _WHOLE or "{axis}" in name
    force: dict[str, Any] = {
        "array": f"{name}?",
        "columns": [0, 1, 2] if is_whole else [None, None, 0],
    }
    if unit != "N":
        force["unit"] = unit
    if clock:
        force["times"] = clock
        found.used |= {clock["array"], look.key}
        found.doubts.append(
            f"force: {name} has a clock of its own, {clock['array']} in {clock['unit']}, and is "
            "interpolated to the frames"
        )
    if look.width[-1:] in _WHOLE and look.width[:-1] in ((), _ONE):
        z = found.values(look)[..., 2].reshape(-1).astype(np.float64)
        force |= guess_sign(f"z of {name}", z, found.doubts)
    return force


def _axes_of(keys: Sequence[str]) -> dict[str, str]:
    """Keys of forces along x, y and z, from an array of each, with one for all.

    Example:
        >>> sorted(_axes_of(["data/fx", "data/fy", "data/fz"]).items())[0]
        ('data/fx', 'data/f{axis}')
    """
    found: dict[str, dict[str, str]] = {}
    for key in keys:
        if fits := re.fullmatch(r"(.*(?:[Ff]|[Ff]orces?_?|ft_|[Ww]rench_))([xyz])((?:_\w+)?)", key):
            found.setdefault(f"{fits[1]}{{axis}}{fits[3]}", {})[fits[2]] = key
    return {key: name for name, axes in found.items() if len(axes) == 3 for key in axes.values()}
