"""The layout of one part of a folder: the files of one sensor, side or split."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain, islice
from pathlib import Path, PurePath
from typing import Any

from tactileforge.data.frames.stacks import is_stack
from tactileforge.reading.guessing.background import guess_background
from tactileforge.reading.guessing.families import Family, families, is_for_all, templates
from tactileforge.reading.guessing.frames import boxes_of, guess_crops, guess_frames, guess_white
from tactileforge.reading.guessing.labels import (
    guess_classes,
    guess_labels,
    guess_shared,
    told_by_names,
    unread_words,
    written_labels,
)
from tactileforge.reading.guessing.media import VIDEOS, Part, names_still, of_endings, open_media
from tactileforge.reading.guessing.patterns import pattern_of
from tactileforge.reading.guessing.rate import guess_rate
from tactileforge.reading.guessing.sensor_names import guess_sensor, named_sensor
from tactileforge.reading.guessing.tables import guess_apart, guess_force, guess_times, guess_tracks
from tactileforge.reading.guessing.view_words import NO_VIEW, says_touch, words_of
from tactileforge.reading.records import RECORDS, sheets
from tactileforge.reading.series import names_of
from tactileforge.reading.sides import SIDE_NAMES
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.trial_rows import RECORDING_WORDS
from tactileforge.reading.trials import VERSIONS

#: Endings of tables that may be notes as well, and of all that are read.
NOTES = frozenset({".txt", ".dat"})
TABLES = frozenset({".csv", ".tsv"}) | NOTES | RECORDS
#: Folder of an object: words, which count no trials and tell no date.
_OBJECT_FOLDER = re.compile(
    rf"(?!(?:{RECORDING_WORDS}|session|day|set|part|batch)s?[\W\d_]*[a-z]?$)\D.*", re.IGNORECASE
)
#: Folder of a trial or a date, below that of an object.
_TRIAL_FOLDER = re.compile(
    rf"(?:{RECORDING_WORDS}|ep|traj|trajectory|rollout|test)[-_. ]?\d+"
    r"|(?:19|20)\d{2}([-_.]?)[01]\d\1[0-3]\d(?:[-_T ].*)?",
    re.IGNORECASE,
)
#: Folders of what came of a trial.
_OUTCOME = re.compile(
    r"(?:no|non|not)?[-_ ]?(?:success(?:es|ful)?|succeeded|fail(?:s|ed|ures?)?|slip(?:s|ped|ping)?|"
    r"stable|unstable|contact|touch|good|bad|ok|stick|drop(?:ped)?|positives?|negatives?)",
    re.IGNORECASE,
)
#: Folder of a value with its unit.
_VALUE = re.compile(r"[-+]?\d+(?:[.,]\d+)?[-_ ]?(?:[mk]?n|newtons?|k?gf?|lbf?|[mcu]?m|deg)", re.I)
#: Most files that are opened for the shape of a picture: the first ones may be damaged.
_OPENED = 5


def guess_part(part: Part) -> None:
    """Guess the layout of a part, the lines about it, and its tables."""
    layout, doubts = part.layout, part.doubts
    layout |= guess_white(part)
    layout |= guess_frames(part)
    boxes = boxes_of(part.media[0], layout.get("white"))
    shape = _shape(part)
    layout |= _sensor(part, (boxes[0][3], boxes[0][2]) if boxes else shape)
    layout |= guess_crops(boxes, shape, layout["sensor"], doubts)
    part.count()
    part.found = _families(part)
    if used := guess_shared(part):
        part.count()
    if apart := guess_apart(part):
        part.found = [*apart, *(family for family in part.found if family not in apart)]
        part.count()
    column = str(layout.get("recording", "")).strip("{}") if apart else ""
    times = guess_times(part, column)
    force, of_force = guess_force(part)
    labels: dict[str, Any] = {}
    if is_stack(part.media[0]):
        if times or "times" in force.get("force", {}):
            part.forget("each")
        elif not part.listed:
            labels, of_labels = guess_classes(part)
    if not labels:
        labels, of_labels = guess_labels(part, apart or part.found)
    if part.listed:
        labels, of_labels = _listed(part, labels, of_labels)
    if column:
        labels = {"labels": {"file": apart[0].template, "key": apart[0].key}} | labels
    if times:
        part.forget("fps")
    layout |= times | _background(part) | force
    of_films = "videos" in layout and not layout.keys() & {"times", "fps", "each"}
    if force and (part.assumes_rate or of_films) and "recording" not in layout:
        guess_rate(part, of_force[0], force["force"])
    if "sensor" in labels:
        part.forget("sensor")
    layout |= labels
    taken = [*used, *of_force, *of_labels, *apart]
    tracks, of_tracks = guess_tracks(part, [one for one in part.found if one not in taken])
    layout |= tracks
    for family in of_force[:1] if force else ():
        if family not in of_labels:
            unread_words(part, family)
    if "object" not in layout:
        layout |= _object(part)
    told_by_names(part, bool(force))
    words = (words_of(path.relative_to(part.root).as_posix()) for path in part.media)
    if len(versions := sorted(VERSIONS.intersection(chain.from_iterable(words)))) > 1:
        doubts.append(
            f"{next(iter(layout))}: {' and '.join(versions)} may be the same recordings, and each "
            "is read; give the pattern of one"
        )
    if split := SPLIT_OF_FOLDER.get(part.folder.lower()):
        layout["hold_out"] = "all" if split == "val" else "none"
    taken += of_tracks
    taken += [one for one in part.found if times and one.template == times["times"]["file"]]
    part.read |= {path for family in taken for path in family.files}


def _families(part: Part) -> list[Family]:
    """Tables beside the recordings of a part: of its folder first, then those with its name."""
    frames = {*part.media}
    tables = [path for path in of_endings(part.files, TABLES | sheets()) if path not in frames]
    tables.sort(key=lambda path: part.folder not in path.relative_to(part.root).parts)
    tables = [path for path in tables if part.names_it(path.stem) is not False]
    tables.sort(key=lambda path: part.names_it(path.stem) is None)
    found = families(tables, part.units)
    for family in found:
        family.side = part.side
    return found


def _listed(
    part: Part, labels: dict[str, Any], used: list[Family]
) -> tuple[dict[str, Any], list[Family]]:
    """Keys of labels of the list of a split, and its family."""
    own = next((one for one in part.found if one.files == [part.listed] and one.key), None)
    if own is None or (labels and labels["labels"]["file"] != own.template):
        part.doubts.append(f"hold_out: the list {part.listed} is not read beside other labels")
        return labels, used
    part.doubts.append(f"hold_out: {own.template} names the recordings for {part.folder}")
    return {**labels, "labels": {"file": own.template, "key": own.key, "only": True}}, [own]


def _background(part: Part) -> dict[str, Any]:
    """Key of the background; a picture that is one is no touch."""
    found = guess_background(part)
    still = found["background"]
    name = still.get("file", "") if isinstance(still, Mapping) else ""
    if "images" in part.layout and not names_still(PurePath(name).stem):
        # a picture that is named so, and is none, is no touch either
        part.layout["images"] = pattern_of(part, is_listed=True)
    return found


def _shape(part: Part) -> tuple[int, int]:
    """Height and width of the first readable picture; 1 and 1 without any."""
    media = islice(part.media, _OPENED)
    opened = (open_media(path, part.layout.get("white")) for path in media)
    return next((frames.shape for frames in opened if frames is not None), (1, 1))


def _sensor(part: Part, shape: tuple[int, int]) -> dict[str, Any]:
    """Key of the type of the sensor."""
    place = part.media[0].relative_to(part.root).parts
    if part.folder and (sensor := named_sensor(part.folder)):
        what = "the folder" if part.folder in place[:-1] else "the file"
        part.doubts.append(f"sensor: {sensor}, by the name of {what}")
        return {"sensor": sensor}
    return guess_sensor("_".join([part.root.name, *place]), lambda: shape, part.doubts)


def add_camera(part: Part, views: Sequence[Path]) -> None:
    """Add the key of the view of the scene beside each recording; others are left out."""
    common = {*words_of(part.media[0].relative_to(part.root).as_posix())}
    said = {path: {*words_of(path.relative_to(part.root).as_posix())} - common for path in views}
    shown = _places(part, [path for path in views if NO_VIEW.isdisjoint(said[path])])
    other = _places(part, [path for path in views if not NO_VIEW.isdisjoint(said[path])])
    units = part.units
    found = templates(shown, units)
    whole = [one for one in found if one.is_own and is_for_all(one, units)]
    rest = sorted(
        one.template for one in [*found, *templates(other, units)] if one not in whole[:1]
    )
    if whole:
        part.layout["camera"] = whole[0].template
        part.doubts.append(f"camera: {whole[0].template} is the view of the scene")
    if rest:
        part.doubts.append(
            f"touch: {', '.join(rest[:3])}{' and others' if len(rest) > 3 else ''} left out: by "
            "name a view of the scene, computed from others, or beside the recordings"
        )


def _places(part: Part, views: Sequence[Path]) -> list[Path]:
    """Paths of views, those of a film in images by their pattern."""
    if part.layout.get("each") == "touch":
        return list(views)
    touches = {path.parent for path in part.media}
    folders: dict[tuple[Path, str], list[Path]] = {}
    for path in views:
        folders.setdefault((path.parent, path.suffix), []).append(path)
    found = []
    for (folder, ending), paths in folders.items():
        if ending.lower() in VIDEOS or is_stack(paths[0]):
            found += paths
        else:
            found.append(folder / (names_of(paths) if folder in touches else f"*{ending}"))
    return found


def _object(part: Part) -> dict[str, Any]:
    """Key of objects by folder."""
    above = {path.parent for path in part.media} - {part.root}
    if part.layout.get("each") != "touch":
        return _object_of_takes(part)
    if len(above) < 2:
        return {}
    if all(_VALUE.fullmatch(path.name) for path in above):
        part.doubts.append(
            f"object: folders are named by a value ({min(above).name}), not by objects; write it "
            "into a table with a row of each image: labels: {file: labels.csv, key: file}"
        )
        return {}
    is_sensor = bool(part.folder) and all(path.name == part.folder for path in above)
    if not is_sensor and all(says_touch(words_of(path.name)) for path in above):
        return {}
    part.doubts.append(f"object: named by the folder of {'a sensor' if is_sensor else 'an image'}")
    return {"object": "{parent}" if is_sensor else "{folder}"}


def _object_of_takes(part: Part) -> dict[str, Any]:
    """Key of the object, by folders with words for names and several recordings in each.

    A folder above those of numbered trials is the object's with one trial as well.
    """
    parents = [parts for parts in part.units.files if len(parts) > 1]
    is_trial = bool(parents) and all(
        len(parts) > 2 and _TRIAL_FOLDER.fullmatch(parts[-2]) for parts in part.units.files
    )
    of_folder: dict[str, set[str]] = {}
    for parts in parents:
        # both sides of a trial are one recording of it
        name = PurePath(parts[-1]).stem.lower()
        of_folder.setdefault(parts[-3 if is_trial else -2], set()).add(
            "" if name in SIDE_NAMES else name
        )
    others = SIDE_NAMES | SPLIT_OF_FOLDER.keys() | VERSIONS
    if (
        len({*map(len, part.units.files)}) > 1
        or len({re.sub(r"\d+", "", name) for name in of_folder}) < 2
        or (min(map(len, of_folder.values())) < 2 and not is_trial)
        or not all(_OBJECT_FOLDER.fullmatch(name) for name in of_folder)
        or any(name.lower() in others or named_sensor(name) for name in of_folder)
    ):
        return {}
    if all(map(_OUTCOME.fullmatch, of_folder)):
        made = written_labels(part.layout, "outcome", '$(basename "$(dirname "$f")")')
        part.doubts.append(
            f"object: folders are named by what came of it ({', '.join(sorted(of_folder)[:2])}), "
            f"not by objects, and it is not read; a table of it is: {made}"
        )
        return {}
    if is_trial:
        part.doubts.append("object: named by the folder above that of a trial")
        return {"object": "{parent}"}
    part.doubts.append("object: named by the folder of several recordings")
    return {"object": "{folder}"}
