"""Guesses of layouts from folders of videos or images."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.data.frames.companions import is_companion
from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.reading.guessing.frames import guess_frames
from tactileforge.reading.guessing.labels import left_out
from tactileforge.reading.guessing.lists import lists_of_splits
from tactileforge.reading.guessing.media import VIDEOS, Part, of_endings, stacks, stills_among
from tactileforge.reading.guessing.part import NOTES, TABLES, add_camera, guess_part
from tactileforge.reading.guessing.patterns import pattern_of
from tactileforge.reading.guessing.sensor_names import named_sensor
from tactileforge.reading.guessing.view_words import scenes, words_of
from tactileforge.reading.linked import matches
from tactileforge.reading.records import conversion, sheets
from tactileforge.reading.sides import side_of
from tactileforge.reading.splits import SPLIT_OF_FOLDER

_NUMBER = re.compile(r"\d+")
#: Largest number of files that are listed; the rest of a large set looks like its start.
_MOST_FILES = 50_000
#: Names of texts about a data set.
_ABOUT = re.compile(
    "readme|licen[cs]e|copying|copyright|requirements|changelog|citation|authors|notes?$|todo|"
    "cmakelists|version"
)
#: Endings of archives, of which folders of their names may be beside them.
_ARCHIVES = frozenset({".zip", ".7z", ".rar", ".tar", ".gz", ".tgz"})
#: Names that phones and cameras give to films.
_OF_CAMERA = re.compile(r"(?:IMG|MVI|VID|PXL|DJI|MOV)_\d{4,}.*|DSCN?_?\d{4,}|G[HPX]\d{6}|GOPR\d{4}")
#: Largest number of folders that get a layout each.
_MOST_PARTS = 20


def guess_layout(root: Path) -> Guess | None:
    """Guess the layout of a folder of videos or images.

    Returns:
        Options of the data set ``recordings``; None for a folder without videos and images.
    """
    paths = sorted(matches(root, "**/*"))
    found = (path for path in paths if path.is_file())
    files = list(islice((x for x in found if not is_companion(x.relative_to(root))), _MOST_FILES))
    # videos first: stills beside them are usually backgrounds
    kinds = [of_endings(files, VIDEOS), stacks(files), of_endings(files, IMAGE_SUFFIXES)]
    stills = stills_among(files, root)
    shown = [path for kind in kinds for path in kind if path not in stills]
    views = scenes(list(dict.fromkeys(shown)), root)
    views += _of_cameras([path for path in shown if path not in views], files)
    hidden = {*views}
    owns = [[one for one in kind if one not in hidden] for kind in kinds]
    films, pictures = [*owns[0], *owns[1]], [path for path in owns[2] if path not in stills]
    if _are_data(pictures, films, files):
        owns = [owns[2], *owns[:2]]
    media = next((own for own in owns if not stills.issuperset(own)), [])
    if not media:
        return None
    parts = _parts(root, media, files, stills)
    for part in parts:
        guess_part(part)
        if views:
            add_camera(part, views)
    # of few recordings in a list, folders may not say that they name objects
    by_folder = [o for x in parts if (o := x.layout.get("object")) in ("{folder}", "{parent}")]
    for part in parts if by_folder else ():
        if part.listed:
            part.layout.setdefault("object", by_folder[0])
    layouts = {re.sub(r"\W+", "_", part.folder) or "guessed": part.layout for part in parts}
    doubts = [
        f"{part.folder}: {line}" if part.folder else line for part in parts for line in part.doubts
    ]
    seen = {*media}.union(*(part.read for part in parts))
    if media[0] in pictures:
        films = [path for path in films if path not in stills]
        doubts += _films_left_out(root, films, files, parts[0].layout["sensor"])
    doubts += left_out(_unread(files, seen, doubts), root)
    if len(files) < _MOST_FILES:
        doubts += _without_media(paths, media, root)
    layout = parts[0].layout
    kind = "videos" if "videos" in layout else f"images, each {layout['each']} a recording"
    options = {"root": str(root), "layouts": layouts}
    return Guess(options=options, format=f"a folder of {kind}", score=0.1, doubts=doubts)


def _of_cameras(shown: Sequence[Path], files: Sequence[Path]) -> list[Path]:
    """Films with a phone's or camera's own name and no table, beside others; [] for all films."""
    tables = {path.with_suffix("") for path in of_endings(files, TABLES | sheets())}
    films = of_endings(shown, VIDEOS)
    found = [
        path
        for path in films
        if _OF_CAMERA.fullmatch(path.stem) and path.with_suffix("") not in tables
    ]
    return found if len(found) < len(films) else []


def _are_data(pictures: Sequence[Path], films: Sequence[Path], files: Sequence[Path]) -> bool:
    """Whether pictures are the data and films only show it: tables are beside the pictures."""
    folders, shown = {path.parent for path in pictures}, {path.parent for path in films}
    named = {path.stem for path in films}
    tables = [path for path in files if path.suffix.lower() in (TABLES - NOTES) | sheets()]
    beside = any(path.parent in folders for path in tables)
    of_films = any(path.parent in shown or path.stem in named for path in tables)
    return beside and not of_films


def _films_left_out(
    root: Path, films: Sequence[Path], files: Sequence[Path], sensor: str
) -> list[str]:
    """Line about unread films, with the key to read them in place of images."""
    if not films:
        return []
    first, more = films[0].relative_to(root).as_posix(), len(films) - 1
    pattern = pattern_of(Part(root, "", films, files))
    return [
        f"touch: {first}{f' and {more} more are' if more else ' is'} left out, since tables are "
        f"beside the images; if touch is in films: data.layouts={{films: {{videos: {pattern!r}, "
        f"sensor: {sensor}, background: {{first: 1}}}}}}"
    ]


def _unread(files: Sequence[Path], seen: set[Path], doubts: Sequence[str]) -> list[Path]:
    """Unread tables and files of labels, named by no line."""
    endings = (TABLES - {".yaml", ".yml"}) | sheets()
    return [
        path
        for path in files
        if path not in seen and (path.suffix.lower() in endings or conversion(path))
        if not (path.suffix.lower() in NOTES and _ABOUT.match(path.stem.lower()))
        if not any(path.name in line for line in doubts)
        if path.suffix.lower() not in _ARCHIVES
        or not (path.parent / path.name.split(".")[0]).is_dir()
    ]


def _without_media(paths: Sequence[Path], media: Sequence[Path], root: Path) -> list[str]:
    """Line about folders named as those of recordings, but for a number, without pictures."""

    def name(path: Path) -> str:
        return path.relative_to(root).as_posix()

    folders = {folder for path in {path.parent for path in media} for folder in path.parents}
    folders |= {path.parent for path in media}
    alike = {_NUMBER.sub("0", name(path)) for path in folders if path.is_relative_to(root)}
    empty = [
        path
        for path in paths
        if path not in folders
        if path.parent in folders and _NUMBER.search(path.name)
        if _NUMBER.sub("0", name(path)) in alike and path.is_dir()
    ]
    if not empty:
        return []
    more = f" and {len(empty) - 1} more have" if len(empty) > 1 else " has"
    return [f"touch: {name(empty[0])}{more} no picture or film of touch, and no recording is there"]


def _parts(
    root: Path, media: Sequence[Path], files: Sequence[Path], stills: set[Path]
) -> list[Part]:
    """Files of each layout: of a sensor, a split, a background or a side; or all of them."""
    touches = [path for path in media if path not in stills]
    folders = _by_sensors(root, touches)
    if [*folders] == [""]:
        folders = _by_backgrounds(root, touches, media, files) or folders
    if [*folders] == [""] and (lists := lists_of_splits(files, touches, root)):
        named = {path: word for word, (_, own) in lists.items() for path in own}
        return [
            Part(root, word, own, [x for x in files if named.get(x, word) == word], listed=table)
            for word, (table, own) in lists.items()
        ]
    if [*folders] == [""]:
        folders = _by_sides(root, touches, files) or folders
    return [Part(root, folder, own, files) for folder, own in folders.items()]


def _by_sensors(root: Path, media: Sequence[Path]) -> dict[str, list[Path]]:
    """Files by folders or words of names of sensors, or of splits; all of them (``""``)."""
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
    return named if len(named.keys() - {""}) > 1 else _by_splits(media)


def _by_splits(media: Sequence[Path]) -> dict[str, list[Path]]:
    """Files by the word of a split in the name of each (``X_test.npy``); or all of them."""
    named: dict[str, list[Path]] = {}
    for path in media:
        words = [word for word in words_of(path.stem) if word in SPLIT_OF_FOLDER]
        if len(words) != 1:
            return {"": list(media)}
        named.setdefault(words[0], []).append(path)
    return named if len({SPLIT_OF_FOLDER[word] for word in named}) > 1 else {"": list(media)}


def _by_sides(root: Path, media: Sequence[Path], files: Sequence[Path]) -> dict[str, list[Path]]:
    """Files of each side of a gripper, if tables have the forces or sensor of each; or {}."""
    own = [side_of(path.stem) for path in media]
    sides: dict[str, list[Path]] = {}
    for path, side in zip(media, own, strict=True):
        is_bare = path.stem.lower() == side
        key = (path.stem if is_bare else side) if all(own) else path.parent.name
        sides.setdefault(key, []).append(path)
    named = {side_of(name) for name in sides} - {""}
    if not len(named) == len(sides) > 1:
        return {}
    forces, sensors = set(), set()
    for side, paths in sides.items():
        part = Part(root, side, paths, files)
        guess_part(part)
        forces |= {str(part.layout["force"])} if "force" in part.layout else set()
        # a type by the shape of the pictures is in no table
        if not any(line.startswith("sensor: no name") for line in part.doubts):
            sensors.add(str(part.layout["sensor"]))
    return sides if len(sides) in (len(forces), len(sensors)) else {}


def _by_backgrounds(
    root: Path, touches: Sequence[Path], media: Sequence[Path], files: Sequence[Path]
) -> dict[str, list[Path]]:
    """Files of each folder of stills, if some have backgrounds of their own; {} otherwise."""
    folders: dict[Path, list[Path]] = {}
    for path in touches:
        folders.setdefault(path.parent, []).append(path)
    stills = {*media} - {*touches}
    own = {path.parent for path in stills if path.parent in folders and path.parent != root}
    names = {folder.name for folder in folders}
    if not own or own == folders.keys() or len(names) < len(folders) or len(names) > _MOST_PARTS:
        return {}
    if guess_frames(Part(root, "", touches, files)).get("each") != "touch":
        return {}
    return {folder.name: paths for folder, paths in folders.items()}
