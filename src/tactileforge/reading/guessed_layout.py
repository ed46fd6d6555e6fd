"""Guesses of layouts from folders of videos or images."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice, takewhile
from pathlib import Path, PurePath
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Guess
from tactileforge.data.frames.companions import is_companion
from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.data.frames.stacks import is_stack
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessed_background import guess_background
from tactileforge.reading.guessed_labels import (
    force_in_names,
    guess_labels,
    guess_shared,
    left_out,
    unread_words,
)
from tactileforge.reading.guessed_media import (
    ASSUMED_FPS,
    BACKGROUND,
    VIDEOS,
    of_endings,
    open_media,
    stacks,
    units_of,
)
from tactileforge.reading.guessed_tables import guess_apart, guess_force, guess_times
from tactileforge.reading.linked import matches
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import name_keys, name_prefix
from tactileforge.reading.records import RECORDS, conversion, sheets
from tactileforge.reading.sensor_names import guess_sensor, named_sensor
from tactileforge.reading.series import series_of
from tactileforge.reading.sides import SIDE_NAMES
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.table_families import Units, families, is_for_all, templates
from tactileforge.reading.tiles import Box, tiles
from tactileforge.reading.trial_rows import RECORDING_WORDS
from tactileforge.reading.view_words import DERIVED, scenes, words_of

#: Largest number of files that are listed; the rest of a large set looks like its start.
_MOST_FILES = 50_000
#: Images of a folder to compare, and the largest change from one to the next in a recording, over
#: that between images in another order; and the same of means of 8 x 8 pixels. Takes of a sensor
#: have .1 to .4, more with noise in single pixels, still touches about 1, on a grid of places .6.
_COMPARED, _SMOOTH, _SMOOTH_AREAS = 24, 0.6, 0.4
#: Endings of tables that may be notes as well.
_NOTES = frozenset({".txt", ".dat"})
#: Endings of tables that are read.
_TABLES = frozenset({".csv", ".tsv"}) | _NOTES | RECORDS
#: Largest number of folders that get a layout each.
_MOST_PARTS = 20
#: Folder of an object: words, which count no trials and tell no date.
_OBJECT_FOLDER = re.compile(
    rf"(?!(?:{RECORDING_WORDS}|session|day|set|part|batch)s?[\W\d_]*[a-z]?$)\D.*", re.IGNORECASE
)
#: Most files that are opened for the shape of a picture: the first ones may be damaged.
_OPENED = 5
#: Largest number of folders that a pattern names.
_MOST_NAMED = 8


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
    kinds = [of_endings(files, VIDEOS), stacks(files), of_endings(files, IMAGE_SUFFIXES)]
    shown = [path for kind in kinds for path in kind if not BACKGROUND.search(path.stem.lower())]
    views = scenes(list(dict.fromkeys(shown)), root)
    hidden = {*views}
    media = next((own for kind in kinds if (own := [one for one in kind if one not in hidden])), [])
    if not media:
        return None
    touches = [path for path in media if not BACKGROUND.search(path.stem.lower())] or media
    doubts: list[str] = []
    layouts: dict[str, dict[str, Any]] = {}
    read: set[Path] = set()
    parts = _parts(root, touches)
    apart = _with_backgrounds(root, touches, [path for path in media if path not in {*touches}])
    if [*parts] == [""] and apart and _frames(root, touches, files, []).get("each") == "touch":
        parts = apart
    if [*parts] == [""]:
        parts = _with_forces_of_sides(root, touches, files) or parts
    for folder, own in parts.items():
        told: list[str] = []
        layouts[re.sub(r"\W+", "_", folder) or "guessed"] = layout = _layout(
            root, folder, own, files, told, read
        )
        if views:
            layout |= _camera(root, own, views, layout, told)
        doubts += [f"{folder}: {line}" if folder else line for line in told]
    labels = [
        path for path in files if path.suffix.lower() in _TABLES | sheets() or conversion(path)
    ]
    seen = {*read, *media}
    unread = [
        path
        for path in labels
        if path not in seen and path.suffix not in (".yaml", ".yml", *_NOTES)
    ]
    doubts += left_out([path for path in unread if not any(path.name in x for x in doubts)], root)
    (layout, *_) = layouts.values()
    kind = "videos" if "videos" in layout else f"images, each {layout['each']} a recording"
    options = {"root": str(root), "layouts": layouts}
    return Guess(options=options, format=f"a folder of {kind}", score=0.1, doubts=doubts)


def _parts(root: Path, media: Sequence[Path]) -> dict[str, list[Path]]:
    """Files of each layout: by folders named by sensors or splits, or all of them (``""``)."""
    paths = [path.relative_to(root).parts[:-1] for path in media]
    for depth in range(min(map(len, paths))):
        folders: dict[str, list[Path]] = {}
        for path, parts in zip(media, paths, strict=True):
            folders.setdefault(parts[depth], []).append(path)
        sensors = {sensor for name in folders if (sensor := named_sensor(name))}
        if len(sensors) > 1 or (
            len(folders) > 1 and {x.lower() for x in folders} <= SPLIT_OF_FOLDER.keys()
        ):
            return folders
    named: dict[str, list[Path]] = {}
    for path in media:
        named.setdefault(named_sensor(path.stem), []).append(path)
    return named if len(named.keys() - {""}) > 1 else {"": list(media)}


def _names_part(stem: str, folder: str) -> bool | None:
    """Whether a name is of the sensor or side of a folder; None for a name of neither."""
    if sensor := named_sensor(folder):
        named = named_sensor(stem)
        return named == sensor if named else None
    if folder.lower() in SIDE_NAMES:
        sides = SIDE_NAMES & {*words_of(stem)}
        return folder.lower() in sides if sides else None
    return None


def _with_forces_of_sides(
    root: Path, media: Sequence[Path], files: Sequence[Path]
) -> dict[str, list[Path]]:
    """Files of each side of a gripper, if tables have the forces of each; {} otherwise."""
    sides: dict[str, list[Path]] = {}
    for path in media:
        sides.setdefault(path.parent.name, []).append(path)
    if len(sides) < 2 or not {name.lower() for name in sides} <= SIDE_NAMES:
        return {}
    layouts = [_layout(root, side, own, files, [], set()) for side, own in sides.items()]
    forces = {str(layout.get("force")) for layout in layouts if "force" in layout}
    return sides if len(forces) == len(sides) else {}


def _with_backgrounds(
    root: Path, media: Sequence[Path], stills: Sequence[Path]
) -> dict[str, list[Path]]:
    """Files of each folder, where some of them have backgrounds of their own; {} otherwise."""
    folders: dict[Path, list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
    own = {path.parent for path in stills if path.parent in folders and path.parent != root}
    names = {folder.name for folder in folders}
    if not own or own == folders.keys() or len(names) < len(folders) or len(names) > _MOST_PARTS:
        return {}
    return {folder.name: paths for folder, paths in folders.items()}


def _layout(
    root: Path,
    folder: str,
    media: Sequence[Path],
    files: Sequence[Path],
    doubts: list[str],
    read: set[Path],
) -> dict[str, Any]:
    """The layout of media of one sensor or split; adds its tables to ``read``."""
    layout = _frames(root, media, files, doubts)
    boxes = _boxes(media[0])
    layout |= _sensor(root, folder, media, boxes, doubts)
    layout |= _crops(boxes, layout["sensor"], doubts)
    units = units_of(root, media, layout)
    frames = {*media}
    tables = [path for path in of_endings(files, _TABLES | sheets()) if path not in frames]
    # those of the folder first
    tables.sort(key=lambda path: folder not in path.relative_to(root).parts)
    # a table is of the sensor or side in its name; those with the name come first
    tables = [path for path in tables if _names_part(path.stem, folder) is not False]
    tables.sort(key=lambda path: _names_part(path.stem, folder) is None)
    found = families(tables, units)
    for family in found:
        family.side = folder.lower() if folder.lower() in SIDE_NAMES else ""
    told: list[str] = []
    shared, of_shared = guess_shared(found, units, "fps" in layout, told)
    if shared:
        doubts[:] = [line for line in doubts if line.partition(":")[0] not in shared]
        doubts += told
        layout |= shared
        units = units_of(root, media, layout)
    told = []
    apart, of_apart = ({}, []) if "recording" in layout else guess_apart(found, units, told)
    if apart:
        doubts[:] = [line for line in doubts if not line.startswith("each:")] + told
        layout |= apart
        if "each" in apart:
            for key in ("fps", "times"):
                layout.pop(key, None)
            doubts[:] = [line for line in doubts if not line.startswith("fps:")]
        units = units_of(root, media, layout)
        found = [*of_apart, *(family for family in found if family not in of_apart)]
    column = str(apart.get("recording", "")).strip("{}")
    times, is_dated = guess_times(found, units, doubts, column)
    units = replace(units, is_dated=is_dated)
    force, of_force = guess_force(found, units, doubts)
    labels, of_labels = guess_labels(of_apart or found, units, doubts)
    if column:
        labels = {"labels": {"file": of_apart[0].template, "key": of_apart[0].key}} | labels
    if times:
        layout.pop("fps", None)
        doubts[:] = [line for line in doubts if not line.startswith("fps:")]
    background = guess_background(root, folder, media, files, layout, doubts)
    still = background["background"]
    name = still.get("file", "") if isinstance(still, Mapping) else ""
    if "images" in layout and not BACKGROUND.search(PurePath(name).stem.lower()):
        # a picture that is named so, and is none, is no touch either
        layout["images"] = _pattern(root, media, files, is_listed=True)
    layout |= times | background | force
    if "sensor" in labels:
        doubts[:] = [line for line in doubts if not line.startswith("sensor:")]
    layout |= labels
    if not force:
        doubts += force_in_names(media, root)
    for family in of_force if force else ():
        if family not in of_labels:
            unread_words(family, layout, doubts)
    if "object" not in layout:
        layout |= _object(root, folder, media, layout, doubts)
    if folder.lower() in SPLIT_OF_FOLDER:
        is_val = SPLIT_OF_FOLDER[folder.lower()] == "val"
        layout["hold_out"] = "all" if is_val else "none"
    used = {times["times"]["file"]} if times else set()
    read |= {
        path
        for family in found
        if family in (*of_force, *of_labels, *of_shared, *of_apart) or family.template in used
        for path in family.files
    }
    return layout


def _camera(
    root: Path,
    media: Sequence[Path],
    views: Sequence[Path],
    layout: Mapping[str, Any],
    doubts: list[str],
) -> dict[str, Any]:
    """Key of the view of the scene beside each recording; the others are left out."""
    units = units_of(root, media, layout)
    are_stills = layout.get("each") == "touch"
    # of a film in images, their pattern
    places = [
        path if are_stills or path.suffix.lower() in VIDEOS else path.parent / f"*{path.suffix}"
        for path in views
    ]
    found = templates(list(dict.fromkeys(places)), units)
    shown = [one for one in found if DERIVED.isdisjoint(words_of(one.template))]
    whole = [one for one in shown if one.is_own and is_for_all(one, units)]
    rest = sorted(one.template for one in found if one not in whole[:1])
    if whole:
        doubts.append(f"camera: {whole[0].template} is the view of the scene")
    if rest:
        doubts.append(
            f"touch: {', '.join(rest[:3])}{' and others' if len(rest) > 3 else ''} left out: by "
            "name a view of the scene, or computed from others"
        )
    return {"camera": whole[0].template} if whole else {}


def _frames(
    root: Path, media: Sequence[Path], files: Sequence[Path], doubts: list[str]
) -> dict[str, Any]:
    """Keys of the files and of their times."""
    pattern = _pattern(root, media, files)
    ending = media[0].suffix.lower()
    if ending in VIDEOS:
        return {"videos": pattern}
    if is_stack(media[0]):
        doubts.append(f"fps: {ASSUMED_FPS} is assumed, a stack tells no times")
        return {"videos": pattern, "fps": ASSUMED_FPS}
    folders: dict[Path, list[Path]] = {}
    named: dict[tuple[Path, str], list[Path]] = {}
    for path in media:
        folders.setdefault(path.parent, []).append(path)
        named.setdefault((path.parent, name_prefix(path.stem)), []).append(path)
    series = series_of(max(folders.values(), key=len))
    largest = max(series.values(), key=len)
    # series that count alike are those of several sensors; others are recordings
    prefixes = _told_apart(named) if len(series) == 1 else []
    if prefixes:
        largest = max(named.values(), key=len)
    keys = name_keys(largest)
    largest.sort(key=lambda path: keys[path])
    if not _follow_each_other(largest):
        doubts.append("each: neighboring images differ, so each is taken for a touch of its own")
        return {"images": pattern, "each": "touch"}
    doubts.append("each: neighboring images are alike, so a folder is taken for one recording")
    layout: dict[str, Any] = {"images": pattern, "each": "sequence"}
    if prefixes:
        doubts[-1] = f"recording: images of one folder are told apart by {' and '.join(prefixes)}"
        layout["recording"] = "{prefix}"
    if name_times([path.stem for path in largest], None).times is not None:
        return layout | {"times": "names"}
    doubts.append(f"fps: {ASSUMED_FPS} is assumed, names tell no times")
    return layout | {"fps": ASSUMED_FPS}


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


def _pattern(
    root: Path, media: Sequence[Path], files: Sequence[Path], is_listed: bool = False
) -> str | list[str]:
    """Pattern of files, with their common folders by name; their names, where none fits."""
    paths = [path.relative_to(root) for path in media]
    depths = {len(path.parts) for path in paths}
    others = {path.relative_to(root).parts[:-1] for path in files} - {
        path.parts[:-1] for path in paths
    }
    # of folders of several depths, those that all lie in: others are of another layout
    folders_of = zip(*(path.parts[:-1] for path in paths), strict=False)
    common = takewhile(lambda column: len({*column}) == 1, folders_of)
    above = "".join(f"{column[0]}/" for column in common) + "**/"
    if len(depths) == 1:
        columns = list(zip(*(path.parts[:-1] for path in paths), strict=True))
        # a folder by its name where others lie beside it
        above = "".join(
            f"{column[0]}/"
            if len(set(column)) == 1 and any(len(o) > i and o[i] != column[0] for o in others)
            else "*/"
            for i, column in enumerate(columns)
        )
    endings = sorted({path.suffix.lower() for path in media})
    aboves = [above]
    if len(depths) == 1 and above.endswith("*/"):
        # folders by their names where those of other pictures lie beside them
        named = {path.parent.name for path in media}
        unlike = {path.parent.name for path in files if path.suffix.lower() in endings} - named
        if unlike and len(named) <= _MOST_NAMED:
            aboves = [f"{above.removesuffix('*/')}{name}/" for name in sorted(named)]
    patterns = [f"{one}*{ending}" for one in aboves for ending in endings]
    if endings == [".npy"]:  # other arrays lie beside those of frames
        ends = [path.name.rpartition("_")[2] for path in media]
        names = {path.name for path in media}
        if len(names) == 1:
            patterns = [f"{above}{media[0].name}"]
        elif len(set(ends)) == 1:
            patterns = [f"{above}*_{ends[0]}"]
    folders = {path.parent for path in media}
    strangers = {
        path.name
        for path in files
        if path.suffix.lower() in endings and path.parent in folders and path not in {*media}
    }
    # a background that is used is not a touch, whatever the pattern is
    is_listed |= any(not BACKGROUND.search(PurePath(name).stem.lower()) for name in strangers)
    if strangers and (endings != [".npy"] or patterns == [f"{above}*.npy"]):
        found: list[str] = []
        for ending in endings:
            own = [path.name for path in media if path.suffix.lower() == ending]
            rest = {name for name in strangers if name.lower().endswith(ending)}
            shown = _apart(own, rest, is_listed) or [f"*{ending}"]
            found += [f"{one}{name}" for one in aboves for name in shown]
        patterns = found
    return patterns[0] if len(patterns) == 1 else patterns


def _same(names: Sequence[str]) -> str:
    """What names begin with."""
    columns = takewhile(lambda column: len({*column}) == 1, zip(*names, strict=False))
    return "".join(column[0] for column in columns)


def _apart(names: Sequence[str], others: set[str], is_listed: bool) -> list[str]:
    """Patterns of names, and not of others in the same folders; else the names, or none."""
    # numbers count: those that are alike by chance say nothing
    start = _same(names).rstrip("0123456789")
    stem = _same([name[::-1] for name in names])[::-1].lstrip("0123456789")
    ending = PurePath(names[0]).suffix
    if len({*names}) > 1 and start and not any(name.startswith(start) for name in others):
        return [f"{start}*{ending}"]
    if len({*names}) > 1 and len(stem) > len(ending) and not any(x.endswith(stem) for x in others):
        return [f"*{stem}"]
    return sorted({*names}) if is_listed else []


def _follow_each_other(images: Sequence[Path]) -> bool:
    """Whether images change less from one to the next than in another order."""
    if len(images) < 3:
        return False
    # pairs spread over all images: nothing may move in the first ones
    starts = spread_rows(len(images) - 1, min(_COMPARED // 2, len(images) - 1))
    chosen = sorted({*starts, *(start + 1 for start in starts)})
    try:
        pictures = ImageFrames([images[i] for i in chosen]).read(range(len(chosen)))
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
    """Change from a picture to the next, as a share of that between distant ones."""

    def change(first: int, second: int) -> float:
        one, other = (pictures[row].astype(np.float32) for row in (first, second))
        return float(np.abs(one - other).mean())

    following = sum(change(start + 1, start) for start in starts) / len(starts)
    half = len(starts) // 2
    pairs = [*zip(starts[half : 2 * half], starts[:half], strict=True)]
    apart = sum(change(a, b) for a, b in pairs) / max(1, len(pairs))
    return following / apart if apart else float("inf" if following else 0)


def _sensor(
    root: Path, folder: str, media: Sequence[Path], boxes: Sequence[Box], doubts: list[str]
) -> dict[str, Any]:
    what = "the folder" if folder in media[0].relative_to(root).parts[:-1] else "the file"
    if folder and (sensor := named_sensor(folder)):
        doubts.append(f"sensor: {sensor}, by the name of {what}")
        return {"sensor": sensor}
    words = "_".join([root.name, *media[0].relative_to(root).parts])

    def shape() -> tuple[int, int]:
        if boxes:
            return boxes[0][3], boxes[0][2]
        opened = (frames for path in media[:_OPENED] if (frames := open_media(path)) is not None)
        return next((frames.shape for frames in opened), (1, 1))

    return guess_sensor(words, shape, doubts)


def _crops(boxes: Sequence[Box], sensor: str, doubts: list[str]) -> dict[str, Any]:
    """Keys of the tiles of composite pictures."""
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


def _boxes(path: Path) -> list[Box]:
    frames = open_media(path)
    if frames is None:
        return []
    try:
        return tiles(frames.read([0, len(frames) // 2][: len(frames)]))
    except TactileForgeError:
        return []


def _object(
    root: Path, folder: str, media: Sequence[Path], layout: Mapping[str, Any], doubts: list[str]
) -> dict[str, Any]:
    """Keys of objects by folder."""
    above = {path.parent for path in media} - {root}
    if layout.get("each") != "touch":
        return _object_of_takes(units_of(root, media, layout), doubts)
    if len(above) < 2:
        return {}
    is_sensor = bool(folder) and all(path.name == folder for path in above)
    doubts.append(f"object: named by the folder of {'a sensor' if is_sensor else 'an image'}")
    return {"object": "{parent}" if is_sensor else "{folder}"}


def _object_of_takes(units: Units, doubts: list[str]) -> dict[str, Any]:
    """Key of the object, by folders with words for names and several recordings in each."""
    of_folder: dict[str, set[str]] = {}
    for parts in (parts for parts in units.files if len(parts) > 1):
        # both sides of a trial are one recording of it
        name = PurePath(parts[-1]).stem.lower()
        of_folder.setdefault(parts[-2], set()).add("" if name in SIDE_NAMES else name)
    others = SIDE_NAMES | SPLIT_OF_FOLDER.keys()
    if (
        len({*map(len, units.files)}) > 1
        or len({re.sub(r"\d+", "", name) for name in of_folder}) < 2
        or min(map(len, of_folder.values())) < 2
        or not all(_OBJECT_FOLDER.fullmatch(name) for name in of_folder)
        or any(name.lower() in others or named_sensor(name) for name in of_folder)
    ):
        return {}
    doubts.append("object: named by the folder of several recordings")
    return {"object": "{folder}"}
