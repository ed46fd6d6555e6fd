"""Guess of the options for a LeRobot data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge.reading import (
    force_of_touch,
    guess_sensor,
    read_regular,
    scene_among,
    touch_among,
    words_of,
)
from tactileforge_lerobot import folder
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.sets import find_sets, touch_numbers, wrenches


def recognise(root: Path) -> Guess | None:
    """Recognises LeRobot data sets by their info file; None for any other folder."""
    try:
        found = find_sets(root) if root.is_dir() else {}
        if not found:
            return None
        place = next(iter(found.values()))
        return _guess(root, place, len(found))
    except (OSError, ValueError):
        return None


def _is_ours(path: Path) -> bool:
    """Whether a damaged file names itself the metadata of LeRobot."""
    try:
        return b"codebase_version" in read_regular(path, 1 << 28)
    except (OSError, DataError):
        return False


def _guess(root: Path, place: Path, count: int) -> Guess | None:
    options: dict[str, Any] = {"root": str(root)}
    try:
        info = Info.read(place)
    except DataError as error:
        if not _is_ours(place / folder.INFO):
            return None
        return Guess(options=options, format="LeRobot", score=1.0, doubts=(str(error),))
    doubts: list[str] = []
    if not (place / folder.TOUCH).is_file():
        doubts += _touch(info, options)
    version = "v3" if info.version == 3 else "v2"
    several = f", {count} data sets, options by the first" if count > 1 else ""
    return Guess(
        options=options,
        format=f"LeRobot {version} ({info.fps:g} rows a second{several})",
        score=1.0,
        doubts=tuple(doubts),
    )


def _touch(info: Info, options: dict[str, Any]) -> list[str]:
    """Fills in the touch features, and returns doubts about them."""
    pictures, numbers = touch_among(info.pictures()), touch_numbers(info)
    touch = pictures or numbers
    if not touch:
        return [
            "no feature is touch by its name: give data.touch and data.sensors; pictures are "
            f"{', '.join(info.pictures()) or 'none'}"
        ]
    doubts: list[str] = []
    sensors = [_sensor(info, name, doubts) if pictures else "serial_array" for name in touch]
    options |= {"touch": touch, "sensors": sensors, "background": "first"}
    doubts.append("background: the first frame of an episode is taken to be without contact")
    if not pictures:
        options |= _numeric(info, touch)
        doubts.append(
            "span: the change drawn as full color is not stated; 1.0 stands in, in units of the "
            "feature"
        )
    if view := scene_among(name for name in info.pictures() if name not in touch):
        options["camera"] = view
        doubts.append(f"camera: {view} is the view of the scene")
    force = _force(info, touch, options, doubts)
    tracks = [name for name in (*numbers, *wrenches(info)) if name not in (*touch, *force)]
    if tracks:
        options["tracks"] = list(dict.fromkeys(tracks))
    for name in wrenches(info):
        if name not in force:
            doubts.append(
                f"force: {name} is a track; units, axes and signs are not stated: "
                f"once they are known, data.force=[{name}] with data.force_columns and "
                "data.force_sign"
            )
    return doubts


def _force(info: Info, touch: list[str], options: dict[str, Any], doubts: list[str]) -> list[str]:
    """Fill in the forces with a word of their touch, and return their features.

    Another force may be of the robot, which most data sets of this format are about.
    """
    plain = {name.removeprefix("observation.").removeprefix("images."): name for name in touch}
    forces = {name.removeprefix("observation."): name for name in wrenches(info)}
    matched = force_of_touch([*plain], [*forces], only=False)
    found = {plain[name]: forces[force] for name, force in matched.items()}
    columns = {_columns(info, name) for name in found.values()}
    if len(columns) != 1 or None in columns:
        return []
    (chosen,) = columns
    options |= {"force": [found.get(name, "") for name in touch], "force_columns": chosen}
    options["force_sign"] = [1, 1, "mean"]
    for name in found.values():
        doubts.append(
            f"force: columns {chosen} of {name} are taken for x right, y down and z into the gel, "
            "in N unless they name another unit; z is turned so that its mean is positive"
        )
    return [*found.values()]


def _columns(info: Info, name: str) -> tuple[int, ...] | None:
    """Columns x, y and z of a force by their names, the first three without names."""
    named = info.features[name].get("names")
    if isinstance(named, dict):
        named = next(iter(named.values()), None)
    if not isinstance(named, list) or not named:
        return (0, 1, 2)
    words = [words_of(str(one)) for one in named]
    found = [[i for i, said in enumerate(words) if _is_axis(said, axis)] for axis in "xyz"]
    return tuple(one[0] for one in found) if all(len(one) == 1 for one in found) else None


def _is_axis(words: tuple[str, ...], axis: str) -> bool:
    """Whether words name a force along an axis: ``fx``, ``force x``, ``x``."""
    if not {"torque", "moment", "t", "m"}.isdisjoint(words):
        return False
    return f"f{axis}" in words or axis in words


def _sensor(info: Info, name: str, doubts: list[str]) -> str:
    """Type of the sensor of pictures, by their name or shape."""
    lines: list[str] = []
    height, width = [size for size in info.features[name]["shape"] if size > 4][:2] or (1, 1)
    sensor = guess_sensor(name, lambda: (height, width), lines)["sensor"]
    doubts += [f"{line} ({name})" for line in lines]
    return str(sensor)


def _numeric(info: Info, touch: list[str]) -> dict[str, Any]:
    """Options of drawing for the shape of the first feature."""
    shape = info.features[touch[0]]["shape"]
    options: dict[str, Any] = {"span": 1.0}
    if len(shape) > 1 and shape[-1] in (3, 6):
        options["columns"] = [0, 1, 2] if shape[-1] == 3 else [3, 4, 5]
        shape = shape[:-1]
    elif len(shape) > 2 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) == 1:
        options["grid"] = [1, shape[0]]
    elif len(shape) > 2:
        rows = 1
        for size in shape[:-1]:
            rows *= size
        options["grid"] = [rows, shape[-1]]
    return options
