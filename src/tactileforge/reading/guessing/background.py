"""Guesses of backgrounds: pictures without contact beside those of touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from tactileforge.reading.guessing.families import is_for_all, templates
from tactileforge.reading.guessing.media import BACKGROUND, VIDEOS, Part, open_media, stills_among
from tactileforge.reading.guessing.sensor_names import named_sensor
from tactileforge.reading.order import name_keys

#: Grey levels by which half of a picture differs from what is no background.
_ANOTHER = 75
#: Least number of pictures beside one that differs by its ending.
_MANY = 10
#: Folders whose first and last pictures are looked at.
_COMPARED = 24


def guess_background(part: Part) -> dict[str, Any]:
    """Guess the key of the background."""
    stills = sorted(stills_among(part.files, part.root) - {*part.media})
    if part.folder and not part.listed:
        stills = [path for path in stills if _is_of(path.relative_to(part.root), part.folder)]
    if stills and (name := _still(part, stills)):
        is_film = PurePath(name).suffix.lower() in VIDEOS
        if is_film or not all(BACKGROUND.search(path.stem.lower()) for path in stills):
            part.doubts.append(
                f"background: {name}, by its name; nothing of such a name is taken for touch"
            )
        return {"background": {"file": name, **({"first": 1} if is_film else {})}}
    if stills:
        name = stills[0].relative_to(part.root).as_posix()
        part.doubts.append(
            f"background: {name} is not of the size and colours of all pictures, and left out"
        )
    if part.layout.get("each") != "touch":
        part.doubts.append("background: nothing may touch in the first frame of a recording")
        return {"background": {"first": 1}}
    odd = _odd_ones(part.media)
    rest = replace(part, media=[path for path in part.media if path not in odd])
    rest.count()
    if odd and (name := _still(rest, odd)):
        part.doubts.append(
            f"background: {name}, by its place as the first and by being the only {odd[0].suffix}"
        )
        return {"background": {"file": name}}
    part.doubts.append("background: none was found, so nothing is subtracted")
    return {"background": "none"}


def _odd_ones(media: Sequence[Path]) -> list[Path]:
    """The first picture of each folder, if it alone has another ending; [] otherwise."""
    folders: dict[Path, list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
    found = []
    for paths in folders.values():
        keys = name_keys(paths)
        first, *others = sorted(paths, key=lambda path: keys[path])
        endings = {path.suffix.lower() for path in others}
        if len(others) < _MANY or len(endings) > 1 or first.suffix.lower() in endings:
            return []
        found.append(first)
    return found


def _is_of(still: Path, folder: str) -> bool:
    """Whether a background lies in a folder, or is named by it and nothing else."""
    rest = BACKGROUND.sub("", still.stem.lower()).strip("_-. ")
    of_name = rest in (folder.lower(), named_sensor(folder))
    return folder in still.parts[:-1] or bool(rest and of_name)


def _still(part: Part, stills: Sequence[Path]) -> str:
    """Path of the background of each recording, with names in braces, or of one for all."""
    for family in templates(stills, part.units):
        if len(family.files) > 1 and is_for_all(family, part.units):
            own = [path for path in part.media if path.parent == family.files[0].parent]
            if not own or _fits(part, family.files[0], own):
                return family.template
    shared = min(stills, key=lambda path: len(path.parts))
    return shared.relative_to(part.root).as_posix() if _fits(part, shared, part.media) else ""


def _fits(part: Part, still: Path, media: Sequence[Path]) -> bool:
    """Whether a background has the size of the frames of each folder, and looks alike."""
    white = part.layout.get("white")
    folders: dict[Path, list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
    looked = [
        path for paths in islice(folders.values(), _COMPARED) for path in (paths[0], paths[-1])
    ]
    shapes = {
        None if (frames := open_media(path, white)) is None else frames.shape
        for path in (still, *looked)
    }
    if len(shapes) > 1 or None in shapes:
        return False
    pictures = [open_media(path, white) for path in (still, media[0])]
    base, first = (frames.read([0])[0].astype(np.float32) for frames in pictures if frames)
    return bool(np.median(np.abs(base - first)) < _ANOTHER)
