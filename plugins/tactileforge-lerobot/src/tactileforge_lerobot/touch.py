"""Touch metadata without a place in LeRobot's format: backgrounds, labels, licence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from tactileforge.contracts import Recording
from tactileforge.data import describe_recording, encode_image
from tactileforge.errors import DataError
from tactileforge.plugins import load_json
from tactileforge.reading import regular_text

#: Keys of a recording stored in columns of the tables.
_COLUMNS = ("version", "times", "force", "action", "tracks", "image_times")
#: Largest number of stored frames without contact.
_STILLS = 9
#: Types of the metadata of a recording; all but the sensor may be missing.
_KINDS: dict[str, type] = {
    **dict.fromkeys(("key", "sensor", "object", "text", "source", "licence"), str),
    **{"tier": int, "labels": dict, "tracks": dict, "background": list, "shape": list},
}


def read_touch(path: Path) -> tuple[Any, list[dict[str, dict[str, Any]]]]:
    """Reads the version of a file of touch metadata, and those of each device, by episode.

    Raises:
        DataError: The file is damaged.
    """
    try:
        stored = load_json(regular_text(path))
        episodes = [
            {str(name): _checked(about) for name, about in parts.items()}
            for parts in stored["episodes"]
        ]
        return stored["version"], episodes
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: damaged ({error!r}); remove it, or write it again") from error


def _checked(about: dict[str, Any]) -> dict[str, Any]:
    """Checks metadata of a recording, and drops nulls; a null label becomes NaN.

    Raises:
        ValueError: A value is missing, or of the wrong type.
    """
    given = {key: value for key, value in about.items() if value is not None}
    for name, kind in _KINDS.items():
        if (name in given or name == "sensor") and not isinstance(given.get(name), kind):
            raise ValueError(f"{name} is {given.get(name)!r}, not of type {kind.__name__}")
    files, tails = given.get("background", []), given.get("tracks", {}).values()
    if not all(isinstance(name, str) for name in files):
        raise ValueError(f"background is {files!r}, not a list of paths")
    for sizes in (given.get("shape", [1, 1]), *tails):
        if not isinstance(sizes, list) or not all(type(n) is int and n >= 0 for n in sizes):
            raise ValueError(f"{sizes!r} is not a shape")
    if len(given.get("shape", [1, 1])) != 2:
        raise ValueError(f"shape is {given['shape']!r}, not height and width")
    labels = given.get("labels", {})
    given["labels"] = {name: math.nan if x is None else x for name, x in labels.items()}
    return given


def describe_touch(root: Path, number: int, name: str, part: Recording) -> dict[str, Any]:
    """Describes a recording beyond its tables, and writes its background.

    Args:
        root: Folder of the data set.
        number: Index of the episode.
        name: Name of the device.
        part: The recording.
    """
    about = {key: value for key, value in describe_recording(part).items() if key not in _COLUMNS}
    return about | {
        "background": _write_stills(root, f"meta/tactileforge/{number:06d}.{name}", part),
        "shape": list(part.frames.shape),
        "tracks": {track: list(values.shape[1:]) for track, values in part.tracks.items()},
        "image": part.image is not None,
    }


def _write_stills(root: Path, prefix: str, part: Recording) -> list[str]:
    if part.no_contact is None:
        return []
    (root / prefix).parent.mkdir(exist_ok=True)
    files = []
    for i in range(min(len(part.no_contact), _STILLS)):
        files.append(f"{prefix}.{i}.png")
        (root / files[-1]).write_bytes(encode_image(part.no_contact.read([i])[0], "png"))
    return files
