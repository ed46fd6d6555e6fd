"""A map guessed from the keys, shapes and names of a container."""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Any

from tactileforge.errors import DataError
from tactileforge.reading import ROBOT, Container, says_touch
from tactileforge_episodes.groups import find_ends, find_splits
from tactileforge_episodes.guessed_arrays import ACTIONS, FORCES, FoundArrays, short_names
from tactileforge_episodes.guessed_forces import guess_forces
from tactileforge_episodes.guessed_times import guess_times
from tactileforge_episodes.guessed_touch import guess_camera, guess_touch
from tactileforge_episodes.looks import Look, is_one_picture

_STATES = {"state", "states", "qpos", "proprio", "proprioception"}
_BODY = ROBOT | {"hand", "pose", "robot0"}
_NO_STATES = {"vel", "velocity", "qvel", "effort", "acc", "object", "sim", "next"} | ACTIONS
#: Words of what a planner or generator of demonstrations aims at.
_NO_STATES |= {"datagen", "target", "goal", "desired", "planned"}
#: Words of arrays of texts, and attributes of groups, by what they say of an episode.
_WORDS = (
    (
        "text",
        {"instruction", "instructions", "language", "lang", "text", "caption", "prompt"},
        ("language_instruction", "instruction", "caption", "prompt", "text"),
    ),
    (
        "object",
        {"object", "class", "label", "material", "item"},
        ("object", "object_name", "label", "class", "material", "item", "object_id", "obj_id"),
    ),
)
#: Most numbers of a row of a track.
_WIDEST = 4096


def guess_map(
    file: Container, name: str, root: object, touch: Sequence[str] = ()
) -> dict[str, Any]:
    """Guess a map of a container, plain data, with its lines to be checked.

    Args:
        file: The container.
        name: Its path, for messages and words of the sensor.
        root: Folder of the data, for messages.
        touch: Keys of touch; () for those whose names say it.

    Raises:
        DataError: No array is touch by its name, or the container is damaged.
    """
    found = FoundArrays(file, name)
    entries = guess_touch(found, touch)
    if not entries:
        raise _unclear(found, root)
    rows = found.looks[next(iter(entries))].facts.rows
    keys: dict[str, Any] = {"about": f"{name}, guessed", "touch": [*entries.values()]}
    keys |= _episodes(found, rows)
    keys |= guess_times(found, entries, str(keys.get("ends", "")))
    guess_forces(found, entries, keys)
    keys |= guess_camera(found, rows) | _numbers(found, rows) | _texts(found, rows)
    if any("taxels" not in one and "reference" not in one for one in entries.values()):
        keys["background"] = "first"
        found.doubts.append("background: nothing may touch in the first frame of an episode")
    convention = found.attribute(found.group.split("/")[0], "macros_image_convention")
    if str(convention).lower() == "opengl":
        found.doubts.append(
            "mirror: the file says that its simulator draws pictures from below "
            "(macros_image_convention: opengl): if they are upside down, give mirror: y"
        )
    found.add_left_out()
    return keys | {"doubts": found.doubts}


def _episodes(found: FoundArrays, rows: int) -> dict[str, Any]:
    """Keys of the places of episodes."""
    if not found.within:
        ends = find_ends(found, [*found.looks.values()], rows)
        found.used |= {ends["ends"]} if ends else set()
        return ends
    splits = find_splits(found.every)
    if splits:
        found.doubts.append(f"splits: as {' and '.join(splits.values())} of the file say")
    keys: dict[str, Any] = {"within": found.within} | ({"splits": splits} if splits else {})
    if "{number" not in found.within:
        found.doubts.append(
            f"within: groups {found.within} hold the same arrays, and are taken for a recording "
            "each; if they are sensors of one, name these in a map (data.map)"
        )
    if "{object}" in found.within:
        found.doubts.append(f"object: named by the group, {found.within}")
        keys["object"] = "{object}"
    return keys


def _numbers(found: FoundArrays, rows: int) -> dict[str, Any]:
    """Keys of the state, the command and the tracks."""
    free = [
        look
        for look in found.free()
        if look.is_numbers and look.facts.shape and look.facts.rows == rows
        if math.prod(look.width) <= _WIDEST and "next" not in look.words
    ]
    commands = _shortest([one for one in free if one.has(ACTIONS)])
    states = _states(free)
    taken = {one.key for one in (*commands, *states)}
    rest = [one.key for one in free if one.key not in taken]
    found.used |= {*taken, *rest}
    keys = {
        "command": [f"{one.key}?" for one in commands],
        "state": [f"{one.key}?" for one in states],
        "tracks": {name: f"{key}?" for key, name in short_names(rest).items()},
    }
    return {name: value for name, value in keys.items() if value}


def _states(free: Sequence[Look]) -> list[Look]:
    """Arrays of the state of the robot: the one of that name, else those of its body."""
    states = _shortest([one for one in free if one.has(_STATES) and not one.has(_NO_STATES)])
    if states and states[0].words[-1:] != ("states",):  # of a simulator, where others are
        return states
    body = [one for one in free if one.has(_BODY) and not one.has(_NO_STATES | FORCES)]
    return [one for one in body if not says_touch(one.words)] or states


def _shortest(looks: Sequence[Look]) -> list[Look]:
    """The array with the fewest words in its name; [] for none."""
    return sorted(looks, key=lambda one: len(one.words))[:1]


def _texts(found: FoundArrays, rows: int) -> dict[str, Any]:
    """Keys of the caption and of the object."""
    said = {what: _said(found, rows, words, names) for what, words, names in _WORDS}
    if said["object"]:
        found.doubts.append(f"object: {said['object'].get('attr') or said['object']['array']}")
    if not said["text"]:
        said["text"] = _problem(found)
    return {what: keys for what, keys in said.items() if keys}


def _said(
    found: FoundArrays, rows: int, words: AbstractSet[str], attributes: Sequence[str]
) -> dict[str, Any]:
    """Place of a text of an episode: an array of texts, or an attribute; {} for none."""
    for look in found.looks.values():
        is_text = look.facts.dtype.kind in "SUO" and look.key not in found.pictures
        if is_text and look.has(words) and look.facts.shape in ((), (1,), (rows,)):
            found.used.add(look.key)
            return {"array": f"{look.key}?"}
    for key in found.groups():
        for name in attributes:
            said = found.attribute(key, name)
            if isinstance(said, str) or (name.endswith("_id") and isinstance(said, int)):
                return {"array": found.place(key), "attr": name}
    return {}


def _problem(found: FoundArrays) -> dict[str, Any]:
    """Keys of the caption in the JSON of a simulator's problem; {} for none."""
    for key, said in found.in_json("problem_info", "language_instruction"):
        if isinstance(said, str):
            return {"array": f"/{key}", "attr": "problem_info", "json": "language_instruction"}
    return {}


def _unclear(found: FoundArrays, root: object) -> DataError:
    """Error with a list of the arrays, and the words to type."""
    why = "no array is called touch" if found.pictures else "no array of pictures or touch"
    singles = [look for look in found.looks.values() if is_one_picture(look)]
    if singles and not found.pictures:
        more = f" (and {len(singles) - 1} more)" if len(singles) > 1 else ""
        return DataError(
            f"{found.name}: {singles[0]}{more} is one picture; save those of a recording as one "
            "array (T, H, W, 3): np.stack"
        )
    shown = next(iter(found.pictures), "KEY")
    within = f"within: {found.within!r}, " if found.within else ""
    filled = f"{{about: mine, {within}touch: [{{array: {shown!r}, sensor: digit}}], fps: 30}}"
    return DataError(
        f"{found.name}: {why}. It has {found.listed()}. Say which is touch: data=episodes "
        f"data.root={root} 'data.touch=[{shown}]'; or fill in a map: \"data.map={filled}\" "
        "(docs/data.md)"
    )
