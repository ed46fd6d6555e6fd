"""Films and images of a folder, as a guess sees them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.contracts import Frames
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.data.frames.stacks import is_stack, open_film
from tactileforge.data.frames.video import VIDEO_SUFFIXES
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.families import Family, Units
from tactileforge.reading.guessing.sensor_names import named_sensor
from tactileforge.reading.guessing.view_words import DERIVED, says_touch, words_of
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import name_prefix
from tactileforge.reading.sides import SIDE_NAMES, side_of
from tactileforge.reading.splits import SPLIT_OF_FOLDER

#: Endings of films that are taken for data: a gif shows something, and .ts is a program as well.
VIDEOS = VIDEO_SUFFIXES - {".gif", ".ts"}
#: Frames per second where nothing tells them: the usual rate of the cameras in such sensors.
ASSUMED_FPS = 30
BACKGROUND = re.compile(
    r"background|reference|hintergrund|(?:no|non|without)[-_ ]?(?:contact|touch)|undeformed|"
    r"unpressed|untouched|(?<![a-z])(?:ref|bg|blank)(?![a-z])"
)
#: Whole names of pictures without contact that may be those of an object or a take as well.
_STILL = re.compile(
    r"(?:base|baseline|empty|flat|init|initial|rest|undisturbed|zero)"
    r"(?:[-_ ]?(?:frame|image|img|picture))?[-_ ]?\d*"
)
#: Word of a picture before contact, where one of the same name has ``after`` for it.
_BEFORE = re.compile(r"(?<![a-z])before(?![a-z])")
#: White of 16 bits.
DEEPEST = 65535
#: Largest number of arrays whose headers are read.
_MOST_ARRAYS = 500


@dataclass
class Part:
    """Files of a layout, of one sensor, side or split, and the guesses so far.

    Attributes:
        root: Folder of the layout.
        folder: Name of the folder, or word in names, of its files; "" for all files.
        media: Films or images of touch.
        files: All files of the root.
        layout: Keys that are known.
        doubts: Lines to be checked.
        read: Tables that are read.
        listed: Table with the names of the recordings of a split; None for none.
        found: Families of the tables beside the recordings.
        units: The recordings, by the known keys; see `count`.
    """

    root: Path
    folder: str
    media: Sequence[Path]
    files: Sequence[Path]
    layout: dict[str, Any] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)
    read: set[Path] = field(default_factory=set)
    listed: Path | None = None
    found: list[Family] = field(default_factory=list)
    units: Units = field(init=False)

    def count(self) -> None:
        """Count the recordings by the known keys."""
        each = "video" if "videos" in self.layout else self.layout["each"]
        files: dict[tuple[str, ...], list[Path]] = {}
        for path in self.media:
            unit = path.parent if each == "sequence" else path
            if self.layout.get("recording") == "{prefix}":
                unit /= name_prefix(path.stem)
            files.setdefault(unit.relative_to(self.root).parts, []).append(path)
        first = next(iter(files.values()))
        frames = open_media(first[0], self.layout.get("white")) if each == "video" else None
        count = len(frames) if frames is not None else len(first)
        own = getattr(frames, "times", None)
        seconds = float(own[-1]) if own is not None else count / self.layout.get("fps", ASSUMED_FPS)
        is_dated, is_timed = False, self.layout.get("times") == "names"
        if is_timed:
            clock = name_times([path.stem for path in first], None)
            is_dated = clock.start is not None
            seconds = seconds if clock.times is None else float(clock.times[-1])
        self.units = Units(self.root, each, files, count, seconds, is_timed, is_dated)

    @property
    def assumes_rate(self) -> bool:
        """Whether nothing tells the rate of the frames."""
        return any(line.startswith(f"fps: {ASSUMED_FPS} is assumed") for line in self.doubts)

    def forget(self, *keys: str) -> None:
        """Drops keys with a better source, and the lines about them."""
        self.doubts[:] = [line for line in self.doubts if line.partition(":")[0] not in keys]
        for key in keys:
            self.layout.pop(key, None)

    def names_it(self, stem: str) -> bool | None:
        """Whether a name is of the sensor, split or side of the folder; None for a name of none."""
        if sensor := named_sensor(self.folder):
            named = named_sensor(stem)
            return named == sensor if named else None
        if split := SPLIT_OF_FOLDER.get(self.folder.lower()):
            splits = {SPLIT_OF_FOLDER.get(word, "") for word in words_of(stem)} - {""}
            return split in splits if splits else None
        sides = SIDE_NAMES & {*words_of(stem)}
        return self.side in sides if sides and self.side else None

    @property
    def side(self) -> str:
        """Side of the folder, such as ``left``; "" for none."""
        return side_of(self.folder)


def stacks(files: Sequence[Path]) -> list[Path]:
    """Stacks of pictures: TIFF of several pages, or arrays of pixels."""
    tiffs = of_endings(files, {".tif", ".tiff"})
    if tiffs and is_stack(tiffs[0]):
        return tiffs
    found, names = [], dict[str, bool]()
    for path in of_endings(files, {".npy"}):
        # files of one name hold the same
        if path.name not in names and len(names) < _MOST_ARRAYS:
            # those of 16 bits may be of anything, such as a depth
            words = words_of(path.stem)
            is_touch = says_touch(words) and DERIVED.isdisjoint(words)
            names[path.name] = open_media(path, DEEPEST if is_touch else None) is not None
        if names.get(path.name):
            found.append(path)
    return found


def names_still(stem: str) -> bool:
    """Whether a picture or film may be without contact, by its name.

    Example:
        >>> names_still("no_touch_1"), names_still("init_frame"), names_still("flat_screw")
        (True, True, False)
    """
    return bool(BACKGROUND.search(stem.lower()) or _STILL.fullmatch(stem.lower()))


def stills_among(files: Sequence[Path], root: Path) -> set[Path]:
    """Pictures and films without contact, by their names or their folder's.

    A name that may be an object's too, such as ``flat``, is one of these only where the other
    pictures of its folder differ by numbers, or where it has pictures of no other name beside it.
    Those called ``before`` are, where each has one called ``after`` beside it.
    """
    media = [path for path in files if path.suffix.lower() in VIDEOS | IMAGE_SUFFIXES]
    found, beside = _before(media, root), dict[Path, set[str]]()
    for path in media:
        folders = path.relative_to(root).parts[:-1]
        above = [re.sub(r"[-_ ]?\d*s?$", "", name.lower()) for name in folders]
        if BACKGROUND.search(path.stem.lower()) or any(map(BACKGROUND.fullmatch, above)):
            found.add(path)
        elif not _STILL.fullmatch(path.stem.lower()):
            beside.setdefault(path.parent, set()).add(re.sub(r"\d+", "", path.stem.lower()))
    parents = {folder for own in beside for folder in own.parents}
    for path in media:
        names = beside.get(path.parent, set())
        alone = not names and path.parent in parents
        if _STILL.fullmatch(path.stem.lower()) and (len(names) == 1 or alone):
            found.add(path)
    return found if len(found) < len(media) else set()


def _before(media: Sequence[Path], root: Path) -> set[Path]:
    """Pictures before contact; none if one of them has no picture after it."""
    names = {path.relative_to(root).as_posix().lower(): path for path in media}
    befores = [name for name in names if _BEFORE.search(name)]
    later = ("after", "during")
    has_after = (any(_BEFORE.sub(word, name) in names for word in later) for name in befores)
    return {names[name] for name in befores} if all(has_after) else set()


def of_endings(files: Sequence[Path], endings: frozenset[str] | set[str]) -> list[Path]:
    """Files with one of some endings, in small letters."""
    return [path for path in files if path.suffix.lower() in endings]


def open_media(path: Path, white: float | None = None) -> Frames | None:
    """Frames of a film, stack or image; None for an unreadable one."""
    is_film = path.suffix.lower() in VIDEOS or is_stack(path)
    try:
        return open_film(path, white=white) if is_film else ImageFrames([path], white=white)
    except TactileForgeError:
        return None
