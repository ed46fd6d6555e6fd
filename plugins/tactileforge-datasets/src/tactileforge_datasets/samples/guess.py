"""Guesses of layouts from the first samples of tars."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tactileforge.contracts import Guess
from tactileforge.data import NEWTONS, Blob, is_foreign, named_unit
from tactileforge.errors import DataError, TactileForgeError
from tactileforge.reading import ASSUMED_FPS, AXES, BACKGROUND, guess_sensor, likely_unit
from tactileforge_datasets.samples.members import read_members
from tactileforge_datasets.samples.opened import shown
from tactileforge_datasets.samples.places import (
    PICTURES,
    VIDEOS,
    array_header,
    as_numbers,
    kind_of,
    parse_place,
    read_value,
)
from tactileforge_datasets.samples.units import grouped

#: Samples of the first tar that are looked at.
_LOOKED = 200
#: Parts that are tables.
_TABLES = ("csv", "tsv")
_CAMERA = re.compile(r"cam|rgb|scene|view|vis")
_NUMBERED = re.compile(r"(?P<start>.*?)(?P<frame>\d+)\.(?P<kind>[a-z]+)")
_FORCE, _OBJECT = ("force", "forces", "f", "wrench"), ("object", "object_name", "label", "class")
_TEXT, _TIME = ("text", "caption", "desc", "description"), ("t", "time", "timestamp", "timestamps")


def guess_samples(root: Path) -> Guess | None:
    """Guess the layout of a folder of tars, or of a single tar.

    Args:
        root: Folder or file.

    Returns:
        Options of the data set ``webdataset``; None without samples that have pictures.
    """
    alone = root.is_file() and root.suffix == ".tar"
    tars = [root] if alone else sorted(root.glob("*.tar")) if root.is_dir() else []
    if not tars or not is_foreign(tars[0]):
        return None
    samples: dict[str, dict[str, Blob]] = {}
    # the first may be damaged, the next ones look like it
    for path in tars[:4]:
        try:
            samples, _, _ = grouped(read_members(path).members[: 16 * _LOOKED])
        except DataError:
            continue
        if samples := dict(list(samples.items())[:_LOOKED]):
            break
    doubts: list[str] = []
    layout = _layout(root, samples, doubts) if samples else {}
    if not layout:
        return None
    options = {"root": str(root.parent if alone else root), **_names(root, tars), "layout": layout}
    return Guess(options=options, format="tars of samples (webdataset)", score=0.4, doubts=doubts)


def _names(root: Path, tars: Sequence[Path]) -> dict[str, Any]:
    """Options of the names of tars."""
    if root.is_file():
        return {"tars": root.name}
    for word in ("val", "valid", "validation", "test"):
        held_out = [path for path in tars if re.match(rf"{word}[^a-z]", path.name)]
        if held_out and len(held_out) < len(tars):
            return {"val_tars": f"{word}*.tar"}
    return {}


def _layout(
    root: Path, samples: Mapping[str, dict[str, Blob]], doubts: list[str]
) -> dict[str, Any]:
    """Keys of the layout; {} without pictures."""
    counts = Counter(part for parts in samples.values() for part in parts)
    parts = next(iter(samples.values()))
    layout = _frames(samples, counts, doubts)
    if not layout:
        return {}
    key = next(iter(samples))
    words = "_".join([root.absolute().name, key, *parts])
    layout |= guess_sensor(words, lambda: _shape(parts, str(layout["touch"])), doubts)
    background = [part for part in counts if kind_of(part) in PICTURES and BACKGROUND.search(part)]
    layout["background"] = {"file": background[0]} if background else "none"
    if not background:
        doubts.append("background: none was found, so nothing is subtracted")
    cameras = [part for part in counts if kind_of(part) in PICTURES and _CAMERA.search(part)]
    if cameras and cameras[0] != layout["touch"]:
        layout["camera"] = cameras[0]
    layout |= _values(parts, doubts)
    if times := layout.pop("times", ""):
        layout |= _times(samples, layout, times, doubts)
    tables = [f"{key}.{part}" for key, of in samples.items() for part in of if part in _TABLES]
    if tables and (root / tables[0]).is_file():
        return {}  # unpacked beside the tars: the files are read
    if tables:
        doubts.append(
            f"force: a table of a tar ({tables[0]}) is not read; unpack the tars in their folder, "
            """for f in *.tar; do tar -xf "$f"; done, and read it again"""
        )
    doubts.append("licence: write it into layout.licence")
    return layout


def _frames(
    samples: Mapping[str, dict[str, Blob]], counts: Counter[str], doubts: list[str]
) -> dict[str, Any]:
    """Keys of the frames."""
    usual = [
        part
        for part, count in counts.most_common()
        if 2 * count > len(samples) and not BACKGROUND.search(part)
    ]
    touch = [part for part in usual if not _CAMERA.search(part)] or usual
    videos = [part for part in touch if kind_of(part) in VIDEOS]
    if videos:
        return {"touch": videos[0]}
    stills = [part for part in touch if kind_of(part) in PICTURES]
    numbered = [m for part in stills if (m := _NUMBERED.fullmatch(part))]
    if len(numbered) > 1:
        one = numbered[0]
        doubts.append(f"fps: {ASSUMED_FPS} is assumed, names tell no times")
        return {"touch": f"{one['start']}{{frame}}.{one['kind']}", "fps": ASSUMED_FPS}
    if len(stills) > 1:
        doubts.append(f"touch: {stills[0]} is taken for the touch, beside {', '.join(stills[1:])}")
    if stills:
        shown = {key: parts for key, parts in samples.items() if stills[0] in parts}
        return {"touch": stills[0]} | _clips(shown, doubts)
    return _arrays(samples, [part for part in touch if kind_of(part) == "npy"], doubts)


def _arrays(
    samples: Mapping[str, dict[str, Blob]], parts: Sequence[str], doubts: list[str]
) -> dict[str, Any]:
    """Keys of the first array of pictures."""
    first = next(iter(samples.values()))
    for part in parts:
        try:
            dtype, shape, _, _ = array_header(first[part], part)
        except (DataError, KeyError):
            continue
        if dtype == "uint8" and len(shape) in (3, 4) and shape[-1] == 3:
            if len(shape) == 3:
                return {"touch": part} | _clips(samples, doubts)
            doubts.append(f"fps: {ASSUMED_FPS} is assumed")
            return {"touch": part, "fps": ASSUMED_FPS}
    return {}


def _clips(samples: Mapping[str, dict[str, Blob]], doubts: list[str]) -> dict[str, Any]:
    """Keys of clips of one frame a sample, by the names of the samples."""
    keys = list(samples)
    signs = [sign for sign in "/_-" if all(_numbered(key, sign) for key in keys)]
    for sign in signs:
        clips = Counter(key.rpartition(sign)[0] for key in keys)
        numbers = [int(key.rpartition(sign)[2]) for key in keys]
        ahead = sum(b == a + 1 for a, b in itertools.pairwise(numbers))
        if len(clips) < len(keys) / 2 and ahead > len(keys) / 2:
            depth = next(iter(clips)).count("/")
            folders = "".join(f"{{folder_{chr(97 + i)}}}/" for i in range(depth))
            doubts.append(
                f"samples: those that differ in the number behind {sign!r} are taken for frames of "
                f"a clip, {ASSUMED_FPS} a second without times"
            )
            return {"samples": f"{folders}{{clip}}{sign}{{frame}}", "fps": ASSUMED_FPS}
    doubts.append("touch: each sample is taken for a touch of its own")
    return {}


def _numbered(key: str, sign: str) -> bool:
    start, _, number = key.rpartition(sign)
    return bool(start) and number.isdecimal() and len(number) < 19


def _shape(parts: Mapping[str, Blob], frames: str) -> tuple[int, int]:
    """Height and width of the first frame; 1 x 1 for an unreadable one."""
    kind = kind_of(frames)
    part = frames if frames in parts else next((one for one in parts if kind_of(one) == kind), "")
    try:
        return shown("", [parts[part]], part).shape if part else (1, 1)
    except TactileForgeError:
        return 1, 1


def _values(parts: Mapping[str, Blob], doubts: list[str]) -> dict[str, Any]:
    """Keys of forces, objects, captions and times by the usual names."""
    found: dict[str, Any] = {}
    if "cls" in parts:
        found["object"] = "{cls}"
        doubts.append(
            "object: the class is taken for the name of the object; layout.words names it"
        )
    if "txt" in parts:
        found["text"] = "{txt}"
    for part in parts:
        if kind_of(part) == "npy" and part.rpartition(".")[0] in _FORCE and _has_axes(parts[part]):
            found["force"] = {"values": part}
        if kind_of(part) == "json":
            found |= {key: one for key, one in _json(part, parts).items() if key not in found}
    if "force" in found:
        unit = named_unit(str(found["force"]["values"]))
        found["force"] |= {"unit": unit} if unit in NEWTONS and unit != "N" else {}
        said = found["force"].get("unit", "newton")
        doubts.append(f"force: taken for {said}, {AXES}")
    return found


def _times(
    samples: Mapping[str, dict[str, Blob]], layout: dict[str, Any], place: str, doubts: list[str]
) -> dict[str, Any]:
    """Key of the times in the unit of a plausible rate, in place of ``fps``; {} for stills."""
    if layout.pop("fps", None) is None:
        return {}
    read: list[float] = []
    for parts in list(samples.values())[:2]:
        try:
            found = as_numbers(
                read_value(parse_place(place), parts[parse_place(place).part], ""), ""
            )
        except (DataError, KeyError):
            continue
        read += [float(one) for one in found.reshape(-1)[:2]]
    step = read[1] - read[0] if len(read) > 1 else 0.0
    unit = likely_unit(step) or "s"
    doubts.append(f"times: taken for {unit}")
    return {"times": {"values": place} | ({} if unit == "s" else {"unit": unit})}


def _has_axes(blob: Blob) -> bool:
    try:
        return array_header(blob, "")[1][-1:] >= (3,)
    except DataError:
        return False


def _json(part: str, parts: Mapping[str, Blob]) -> dict[str, Any]:
    try:
        said = read_value(parse_place(part), parts[part], "")
    except DataError:
        return {}
    found: dict[str, Any] = {}
    for name, value in said.items() if isinstance(said, dict) else ():
        low = str(name).lower()
        if not re.fullmatch(r"[^.:?{}]+", str(name)):
            continue
        if low in _FORCE and isinstance(value, list) and value:
            found.setdefault("force", {"values": f"{part}:{name}"})
        elif low in _TIME and isinstance(value, int | float | list):
            found.setdefault("times", f"{part}:{name}")
        elif low in _OBJECT and isinstance(value, str | int):
            found.setdefault("object", f"{{{part}:{name}}}")
        elif low in _TEXT and isinstance(value, str):
            found.setdefault("text", f"{{{part}:{name}}}")
    return found
