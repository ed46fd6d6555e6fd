"""Guesses of layouts from folders of videos or images."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import Frames, Guess
from tactileforge.data.frames.companions import is_companion
from tactileforge.data.frames.lazy import ImageFrames, VideoFrames
from tactileforge.data.labels.missing import stated
from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.files import read_rows
from tactileforge.reading.linked import matches
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import name_keys
from tactileforge.reading.series import series_of
from tactileforge.specs.published import SPECS

_VIDEOS = frozenset({".avi", ".mp4", ".mov", ".mkv", ".webm"})
_IMAGES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff"})
#: Largest number of files that are listed; the rest of a large set looks like its start.
_MOST_FILES = 50_000
#: Images of a folder to compare, and the largest change from one to the next in a recording, over
#: that between images in another order. Takes of a sensor have .1 to .4, still touches about 1.
_COMPARED, _SMOOTH = 24, 0.6
#: Frames per second where nothing tells them: the usual rate of the cameras in such sensors.
ASSUMED_FPS = 30
#: Smallest share of files or names in a table, for the table to be about them.
_ABOUT = 0.8
_BACKGROUND = re.compile(r"background|reference|no_?contact|blank|(?<![a-z])(?:ref|bg)(?![a-z])")
#: Headers of columns, without the unit behind them.
_FORCES = {
    axis: re.compile(rf"(?:force|f)[_ .]?{axis}\b.*|{axis}[_ .]?force\b.*") for axis in "xyz"
}
_TIME = re.compile(
    r"t|times?(?:tamps?)?(?:_s)?|(?:\w+\.)*(?:(?:time)?stamp[._])?(?:secs?|seconds?)"
)
_FRAME = re.compile(r"frame(?:_?i?d?x?)?")
_OBJECT = re.compile(r"object(?:_name)?|label|class|name|material")


def guess_layout(root: Path) -> Guess | None:
    """Guess the layout of a folder of videos or images.

    Args:
        root: The folder.

    Returns:
        Options of the data set ``recordings``; None for a folder without videos and images.
    """
    found = (path for path in sorted(matches(root, "**/*")) if path.is_file())
    files = list(islice((x for x in found if not is_companion(x.relative_to(root))), _MOST_FILES))
    # videos first: stills beside them are usually backgrounds
    media = _of(files, _VIDEOS) or _of(files, _IMAGES)
    if not media:
        return None
    doubts: list[str] = []
    tables = [(path, rows) for path in _of(files, {".csv"}) if (rows := _rows(path))]
    touches = [path for path in media if not _BACKGROUND.search(path.stem.lower())] or media
    layout = _frames(root, touches, doubts)
    layout |= _sensor(root, touches, doubts)
    layout |= _background(root, files, layout, doubts)
    layout |= _force(root, touches, layout, tables, doubts)
    layout |= _object(root, touches, layout, tables, doubts)
    untold = [path for path in _of(files, {".csv"}) if not any(path.name in x for x in doubts)]
    doubts += _left_out(root, untold, layout)
    kind = "videos" if "videos" in layout else f"images, each {layout['each']} a recording"
    options = {"root": str(root), "layouts": {"guessed": layout}}
    return Guess(options=options, format=f"a folder of {kind}", score=0.1, doubts=doubts)


def _of(files: Sequence[Path], endings: frozenset[str] | set[str]) -> list[Path]:
    return [path for path in files if path.suffix.lower() in endings]


def _rows(path: Path) -> list[list[str]]:
    try:
        return read_rows(path)
    except TactileForgeError:  # the reader names it, once it is told to read it
        return []


def _frames(root: Path, media: Sequence[Path], doubts: list[str]) -> dict[str, Any]:
    """Keys of the files and of their times."""
    depths = {len(path.relative_to(root).parts) for path in media}
    above = "*/" * (depths.pop() - 1) if len(depths) == 1 else "**/"
    endings = sorted({path.suffix.lower() for path in media})
    patterns = [f"{above}*{ending}" for ending in endings]
    pattern = patterns[0] if len(patterns) == 1 else patterns
    if media[0].suffix.lower() in _VIDEOS:
        return {"videos": pattern}
    folders: dict[Path, list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
    largest = max(series_of(max(folders.values(), key=len)).values(), key=len)
    keys = name_keys(largest)
    largest.sort(key=lambda path: keys[path])
    if not _follow_each_other(largest):
        doubts.append("each: neighboring images differ, so each is taken for a touch of its own")
        return {"images": pattern, "each": "touch"}
    doubts.append("each: neighboring images are alike, so a folder is taken for one recording")
    layout: dict[str, Any] = {"images": pattern, "each": "sequence"}
    if name_times([path.stem for path in largest], None).times is not None:
        return layout | {"times": "names"}
    doubts.append(f"fps: {ASSUMED_FPS} is assumed, names tell no times")
    return layout | {"fps": ASSUMED_FPS}


def _follow_each_other(images: Sequence[Path]) -> bool:
    """Whether images change less from one to the next than in another order."""
    if len(images) < 3:
        return False
    try:
        pictures = ImageFrames(images[:_COMPARED]).read(range(min(len(images), _COMPARED)))
    except TactileForgeError:
        return False
    # every eighth pixel: neighbors say nearly the same, and a guess is for the whole picture
    small = pictures[:, ::8, ::8].astype(np.float32)
    following = np.abs(np.diff(small, axis=0)).mean()
    half = len(small) // 2
    apart = np.abs(small[half : 2 * half] - small[:half]).mean()
    return bool(following <= _SMOOTH * apart)


def _sensor(root: Path, media: Sequence[Path], doubts: list[str]) -> dict[str, Any]:
    words = "_".join([root.name, *media[0].relative_to(root).parts])

    def shape() -> tuple[int, int]:
        return (1, 1) if (frames := _open(media[0])) is None else frames.shape

    return guess_sensor(words, shape, doubts)


def guess_sensor(
    words: str, shape: Callable[[], tuple[int, int]], doubts: list[str]
) -> dict[str, Any]:
    """Guess the key of the sensor.

    Args:
        words: Names of folders and files.
        shape: Function to height and width of a frame, called where no name tells the type.
        doubts: Lines, added to.
    """
    words = words.lower().replace("-", "_").replace("gsmini", "gelsight_mini")
    # the longest name first: gelsight_mini holds gelsight
    if named := [name for name in sorted(SPECS, key=len, reverse=True) if name in words]:
        return {"sensor": named[0]}
    height, width = shape()
    # DIGIT alone of the usual sensors is taller than wide
    sensor = "digit" if height > width else "gelsight_mini"
    doubts.append(f"sensor: no name tells the type; {sensor} by the shape {height} x {width} alone")
    return {"sensor": sensor}


def _open(path: Path) -> Frames | None:
    try:
        return VideoFrames(path) if path.suffix.lower() in _VIDEOS else ImageFrames([path])
    except TactileForgeError:
        return None


def _background(
    root: Path, files: Sequence[Path], layout: Mapping[str, Any], doubts: list[str]
) -> dict[str, Any]:
    still = [path for path in _of(files, _IMAGES) if _BACKGROUND.search(path.stem.lower())]
    if still:
        return {"background": {"file": still[0].relative_to(root).as_posix()}}
    if layout.get("each") == "touch":
        doubts.append("background: none was found, so nothing is subtracted")
        return {"background": "none"}
    doubts.append("background: nothing may touch in the first frame of a recording")
    return {"background": {"first": 1}}


def _force(
    root: Path,
    media: Sequence[Path],
    layout: Mapping[str, Any],
    tables: Sequence[tuple[Path, list[list[str]]]],
    doubts: list[str],
) -> dict[str, Any]:
    """Keys of forces: one table of all images, or one beside each recording."""
    for path, rows in tables:
        columns = [_column(rows[0], _FORCES[axis]) for axis in "xyz"]
        if columns[2] is None:
            continue
        table: dict[str, Any] = {"columns": columns}
        names = {one.stem for one in media} if "videos" in layout else set()
        if layout.get("each") == "sequence":
            names = {one.parent.name for one in media}
        if layout.get("each") == "touch" and (key := _key(rows, media)):
            table |= {"file": path.relative_to(root).as_posix(), "key": key}
        elif path.stem in names:
            table["file"] = _beside(root, path, media, layout)
            if time := _column(rows[0], _TIME):
                table["time"] = time
            elif frame := _column(rows[0], _FRAME):
                table["frame"] = frame
        else:
            continue
        units = {unit for name in columns if name and (unit := named_unit(name))} or {"N"}
        if len(units) > 1 or not units <= NEWTONS.keys():
            doubts.append(f"force: {path.name} has it in {' and '.join(sorted(units))}, left out")
            return {}
        (unit,) = units
        table |= {} if unit == "N" else {"force_unit": unit}
        said = "newton" if unit == "N" else unit
        doubts.append(
            f"force: taken for {said}, x right, y down, z into the gel, pressing positive"
        )
        return {"force": table}
    return {}


def _beside(root: Path, table: Path, media: Sequence[Path], layout: Mapping[str, Any]) -> str:
    """Path of the table of a recording, with its names in braces."""
    files = media if "videos" in layout else sorted({path.parent for path in media})
    own = next(path for path in files if path.stem == table.stem or path.name == table.stem)
    parts = list(table.relative_to(root).parts[:-1])
    if parts and parts[-1] == own.parent.name and own.parent != root:
        parts[-1] = "{folder}"
    elif parts and parts[-1] == own.name:
        parts[-1] = "{stem}"
    return "/".join([*parts, "{stem}" + table.suffix])


def _object(
    root: Path,
    media: Sequence[Path],
    layout: Mapping[str, Any],
    tables: Sequence[tuple[Path, list[list[str]]]],
    doubts: list[str],
) -> dict[str, Any]:
    """Keys of objects: of a table, or by folder."""
    names = media
    if layout.get("each") == "sequence":
        names = [*media, *sorted({path.parent for path in media})]
    for path, rows in tables:
        key, column = _key(rows, names), _column(rows[0], _OBJECT)
        if key and column and key != column:
            labels = {"file": path.relative_to(root).as_posix(), "key": key}
            return {"labels": labels, "object": f"{{{column}}}"}
    if layout.get("each") == "touch" and len({path.parent for path in media} - {root}) > 1:
        doubts.append("object: named by the folder of an image")
        return {"object": "{folder}"}
    return {}


def _left_out(root: Path, tables: Sequence[Path], layout: Mapping[str, Any]) -> list[str]:
    """Doubt about unread tables."""
    read = [re.escape(layout[key]["file"]) for key in ("force", "labels") if key in layout]
    pattern = re.compile(
        "|".join(read).replace(r"\{stem\}", "[^/]+").replace(r"\{folder\}", "[^/]+")
    )
    names = sorted(path.relative_to(root).as_posix() for path in tables)
    left = [name for name in names if not pattern.fullmatch(name)]
    if not left:
        return []
    more = f" and {len(left) - 1} more are" if len(left) > 1 else " is"
    fix = "give force: or labels: of the layout, if it has some (commas, decimals with points)"
    return [
        f"labels: {left[0]}{more} left out, since no force and no name of an object was seen; {fix}"
    ]


def _column(header: Sequence[str], pattern: re.Pattern[str]) -> str | None:
    return next((name for name in header if pattern.fullmatch(name.strip().lower())), None)


def _key(rows: Sequence[Sequence[str]], files: Sequence[Path]) -> str | None:
    """Column with the names of the files; None without one."""
    names = {path.name for path in files} | {path.stem for path in files}
    for number, title in enumerate(rows[0]):
        cells = [row[number] for row in rows[1:] if number < len(row) and stated(row[number])]
        found = sum(cell.replace("\\", "/").rpartition("/")[2] in names for cell in cells)
        if cells and found >= _ABOUT * len(cells):
            return title
    return None
