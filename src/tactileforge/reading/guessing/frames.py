"""Guesses of frames: images, recordings of them, their times and tiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.pixel_contract import white_of
from tactileforge.data.frames.stacks import deepest, is_stack
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.media import ASSUMED_FPS, VIDEOS, Part, open_media
from tactileforge.reading.guessing.patterns import pattern_of
from tactileforge.reading.guessing.tiles import Box, tiles
from tactileforge.reading.guessing.view_words import DERIVED, words_of
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import name_keys, name_prefix
from tactileforge.reading.series import series_of
from tactileforge.reading.sides import SIDE_NAMES

#: Images of a folder to compare, and the largest change from one to the next in a recording, over
#: that between images in another order; and the same of means of 8 x 8 pixels. Takes of a sensor
#: have .1 to .4, more with noise in single pixels, still touches about 1, on a grid of places .6.
_COMPARED, _SMOOTH, _SMOOTH_AREAS = 24, 0.6, 0.4
#: Fewest pictures of a recording.
_FEWEST = 3
#: Width over height from which a picture may show two sensors.
_WIDE = 2


def guess_white(part: Part) -> dict[str, Any]:
    """Guess the key of white in pictures of 16 bits; {} for others, and for a depth."""
    folders: dict[Path, list[Path]] = {}
    for path in part.media:
        folders.setdefault(path.parent, []).append(path)
    shown = [
        path
        for own in islice(folders.values(), _COMPARED)
        for path in dict.fromkeys((own[0], own[len(own) // 2], own[-1]))
        if DERIVED.isdisjoint(words_of(path.relative_to(part.root).with_suffix("").as_posix()))
    ]
    most = max((deepest(path) for path in shown if path.suffix.lower() not in VIDEOS), default=0)
    if not most:
        return {}
    white = white_of(most)
    part.doubts.append(
        f"white: pictures have 16 bits and values up to {most}, so {white} is taken for white "
        f"({white.bit_length()} bits)"
    )
    return {"white": white}


def guess_frames(part: Part) -> dict[str, Any]:
    """Guess the keys of the files and of their times."""
    doubts, pattern, white = part.doubts, pattern_of(part), part.layout.get("white")
    if part.media[0].suffix.lower() in VIDEOS:
        return {"videos": pattern}
    if is_stack(part.media[0]):
        if len(part.media) == 1:
            doubts.append(
                f"each: {part.media[0].name} is taken for one film; if each of its pictures is a "
                "touch of its own: each: touch, background: none"
            )
        doubts.append(f"fps: {ASSUMED_FPS} is assumed, a stack tells no times")
        return {"videos": pattern, "fps": ASSUMED_FPS}
    images, prefixes = _recording(part.media)

    def read(rows: Sequence[int]) -> NDArray[np.uint8]:
        return ImageFrames([images[i] for i in rows], white=white).read(range(len(rows)))

    if not is_film(read, len(images)):
        doubts.append("each: neighboring images differ, so each is taken for a touch of its own")
        return {"images": pattern, "each": "touch"}
    layout: dict[str, Any] = {"images": pattern, "each": "sequence"}
    if prefixes:
        layout["recording"] = "{prefix}"
        doubts.append(f"recording: images of one folder are told apart by {' and '.join(prefixes)}")
    else:
        doubts.append("each: neighboring images are alike, so a folder is taken for one recording")
    if name_times([path.stem for path in images], None).times is not None:
        return layout | {"times": "names"}
    doubts.append(f"fps: {ASSUMED_FPS} is assumed, names tell no times")
    return layout | {"fps": ASSUMED_FPS}


def _recording(media: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Images of the largest recording, in order, and the difference between those of one folder."""
    folders: dict[Path, list[Path]] = {}
    named: dict[tuple[Path, str], list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
        named.setdefault((path.parent, name_prefix(path.stem)), []).append(path)
    series = series_of(max(folders.values(), key=len))
    # series that count alike are those of several sensors; others are recordings
    prefixes = _told_apart(named) if len(series) == 1 else []
    images = max((named if prefixes else series).values(), key=len)
    keys = name_keys(images)
    return sorted(images, key=lambda path: keys[path]), prefixes


def _told_apart(folders: Mapping[tuple[Path, str], Sequence[Path]]) -> list[str]:
    """Distinct starts of the names of recordings of one folder; [] without any."""
    of_folder: dict[Path, list[str]] = {}
    for folder, prefix in folders:
        of_folder.setdefault(folder, []).append(prefix)
    several = {folder: names for folder, names in of_folder.items() if len(names) > 1}
    for folder, names in several.items():
        is_few = any(len(folders[folder, name]) < 3 for name in names)
        # sides are sensors of one recording, and no recordings
        if "" in names or is_few or {name.lower() for name in names} <= SIDE_NAMES:
            return []
    shown = sorted({name for names in several.values() for name in names})
    return [*shown[:2], "others"] if len(shown) > 2 else shown


def is_film(read: Callable[[Sequence[int]], NDArray[np.uint8]], count: int) -> bool:
    """Whether pictures change less from one to the next than in another order.

    Args:
        read: Function from numbers of pictures to these; may raise an error of the framework.
        count: Number of pictures.
    """
    if count < _FEWEST:
        return False
    # pairs spread over all of them: nothing may move in the first ones
    starts = spread_rows(count - 1, min(_COMPARED // 2, count - 1))
    chosen = sorted({*starts, *(start + 1 for start in starts)})
    try:
        pictures = read(chosen)
    except TactileForgeError:
        return False
    # every eighth pixel: neighbours say nearly the same, and a guess is for the whole picture
    if _change_ratio(dict(zip(chosen, pictures[:, ::8, ::8], strict=True)), starts) <= _SMOOTH:
        return True
    # a camera's noise is in every pair, and is no change
    height, width = (max(1, side // 8) for side in pictures.shape[1:3])
    areas = [
        cv2.resize(one.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        for one in pictures
    ]
    return _change_ratio(dict(zip(chosen, areas, strict=True)), starts) <= _SMOOTH_AREAS


def _change_ratio(pictures: Mapping[int, NDArray[Any]], starts: Sequence[int]) -> float:
    """Change between neighbouring pictures, as a share of the change between distant ones."""

    def change(first: int, second: int) -> float:
        one, other = (pictures[row].astype(np.float32) for row in (first, second))
        return float(np.abs(one - other).mean())

    following = sum(change(start + 1, start) for start in starts) / len(starts)
    half = len(starts) // 2
    pairs = [*zip(starts[half : 2 * half], starts[:half], strict=True)]
    apart = sum(change(a, b) for a, b in pairs) / max(1, len(pairs))
    return following / apart if apart else float("inf" if following else 0)


def boxes_of(path: Path, white: float | None) -> list[Box]:
    """Tiles of a composite picture or film; [] for others, and for an unreadable one."""
    frames = open_media(path, white)
    if frames is None:
        return []
    try:
        return tiles(frames.read([0, len(frames) // 2][: len(frames)]))
    except TactileForgeError:
        return []


def guess_crops(
    boxes: Sequence[Box], shape: tuple[int, int], sensor: str, doubts: list[str]
) -> dict[str, Any]:
    """Guess the keys of the tiles of composite pictures; {} for none."""
    height, width = shape
    if not boxes and width >= _WIDE * height:
        half = width // 2
        doubts.append(
            f"crops: pictures of {height} x {width} are taken for one sensor; if they show two, "
            f"side by side: crops: {{left: {{box: [0, 0, {half}, {height}]}}, "
            f"right: {{box: [{half}, 0, {half}, {height}]}}}}"
        )
    if not boxes:
        return {}
    rows, columns = (len({box[axis] for box in boxes}) for axis in (1, 0))
    doubts.append(
        f"crops: the pictures are put together of {rows} x {columns}, each taken for a sensor of "
        f"its own, of type {sensor}: name that of each, and take out what is none"
    )
    # the first by rows, as one reads
    crops = {f"part{i}": {"box": [*box], "sensor": sensor} for i, box in enumerate(boxes, 1)}
    return {"crops": crops}
