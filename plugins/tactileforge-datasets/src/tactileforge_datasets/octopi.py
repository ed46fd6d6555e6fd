"""The data set ``octopi``: PhysiCLeAR, objects pressed and rubbed by hand with a GelSight Mini."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from tactileforge.contracts import FrameSubset, Guess, Recording
from tactileforge.data import VideoFrames, video_times, without_companions
from tactileforge.errors import DataError
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    PublishedDataset,
    RecordingItem,
    is_there,
    read_text,
)
from tactileforge.specs import spec
from tactileforge_datasets.official_splits import OCTOPI_OFFICIAL

_PREFIX = "physiclear_"
_PROPERTIES = ("hardness", "roughness", "texture")
#: Films that a guess opens: the first ones may be damaged.
_LOOKED = 5
_SIDES = {"TRAIN_OBJECTS": "train", "VAL_OBJECTS": "val", "TEST_OBJECTS": "test"}


class Octopi(PublishedDataset):
    """Octopi: each video is a recording; its first frames are without contact.

    Ranks and words of three properties, and the official split, come from `constants.py` of
    Octopi's code, parsed and not executed. Objects missing from it have no ranks, and are left out
    of the official split; without the file, no object has ranks.

    Args:
        root: Checkout of Octopi, or the folder of the videos.
        split: One of ``splits``.
        val: Share of the objects held out for validation; unused by a split with its own.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "octopi"
    sensors = ("gelsight_mini",)
    tier = 4
    licence = "none stated, do not redistribute"
    citation = "Yu et al., Octopi, RSS 2024"
    url = "https://github.com/clear-nus/octopi"
    tree = """ROOT/
  utils/constants.py           (for ranks, and for the split octopi-official)
  dataset/aluminium_foil_0.mov ..."""
    splits = (ALL_FOR_TRAINING, OCTOPI_OFFICIAL)
    provides = frozenset({"object", "text"})
    marks = ("dataset/*_[0-9]*.mov", "*_[0-9]*.mov")
    doubts = ("names of films are objects and numbers",)

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; films are of objects, and of a GelSight Mini's size.

        The constants of Octopi beside them are enough.
        """
        guess = super().recognise(root)
        if guess and any(is_there(path) for path in _constants_of(root)):
            return guess
        films = [path for mark in cls.marks for path in root.glob(mark)] if guess else []
        own = {path.stem for path in films}
        beside = {
            path.stem
            for folder in {path.parent for path in films}
            for path in folder.iterdir()
            if path.suffix.lower() != ".mov"
        }
        if own & beside or len({_place(path)[0] for path in films}) < 2:
            return None  # forces of each film, or numbers of trials
        return guess if any(map(_is_of_mini, islice(films, _LOOKED))) else None

    def _items(self) -> Iterator[RecordingItem]:
        folder = self._folder("dataset", ".")
        videos = sorted(without_companions([*folder.glob("*.mov")], folder), key=_place)
        if not videos:
            raise self._missing(f"no file *.mov in {folder}")
        constants = _constants(self.root)
        sides = {str(name): side for key, side in _SIDES.items() for name in constants.get(key, ())}
        if not sides and self.split == OCTOPI_OFFICIAL.name:
            raise self._missing(f"no list of objects in {self.root / 'utils' / 'constants.py'}")
        for path in videos:
            name = _place(path)[0]
            opened = partial(self._open, path, name, _ranks(_PREFIX + name, constants))
            yield RecordingItem(
                path.stem, opened, {"list": sides.get(_PREFIX + name, "")}, group=name
            )

    def _open(self, path: Path, name: str, ranks: dict[str, tuple[float, str]]) -> Recording:
        frames = VideoFrames(path)
        # three frames, or half of a short film
        still = max(1, min(3, len(frames) // 2))
        phrases = [f"{{action}} {name}".replace("_", " "), *(word for _, word in ranks.values())]
        return self._recording(
            path.stem,
            sensor="gelsight_mini",
            frames=frames,
            times=video_times(frames, "download it again"),
            no_contact=FrameSubset(frames, range(still)),
            object=name,
            text=", ".join(phrases),
            labels={key: rank for key, (rank, _) in ranks.items()},
        )


def _is_of_mini(film: Path) -> bool:
    mini = spec(Octopi.sensors[0])
    try:
        return VideoFrames(film).shape == (mini.height, mini.width)
    except DataError:
        return False


def _place(path: Path) -> tuple[str, int]:
    """Object and number of a video; one without a number is the first."""
    name, _, number = path.stem.rpartition("_")
    return (name, int(number)) if name and number.isdigit() else (path.stem, 0)


def _constants_of(root: Path) -> list[Path]:
    """Possible places of Octopi's constants."""
    folders = (root / "utils", root / "src" / "utils", root.parent / "utils", root)
    return [folder / "constants.py" for folder in folders]


def _constants(root: Path) -> dict[str, Any]:
    """The literals of Octopi's constants, by name; {} without the file."""
    path = next(filter(is_there, _constants_of(root)), None)
    if path is None:
        return {}
    # Parsed, not imported: nothing of the checkout is executed.
    try:
        body = ast.parse(read_text(path)).body
    except (MemoryError, RecursionError, SyntaxError, ValueError) as error:
        raise DataError(
            f"{path}: not the constants of Octopi: {type(error).__name__} {error}; download it"
        ) from error
    constants = {}
    for node in body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name = node.targets[0].id
            if re.fullmatch(r"\w+_(OBJECTS|RANK|MAP)", name):
                try:
                    constants[name] = ast.literal_eval(node.value)
                except (MemoryError, RecursionError, TypeError, ValueError) as error:
                    text = f"{path}: {name} is not a literal; download it again"
                    raise DataError(text) from error
    if not constants:
        raise DataError(f"{path}: no objects, ranks or words are in it; download it again")
    return constants


def _ranks(name: str, constants: dict[str, Any]) -> dict[str, tuple[float, str]]:
    """Rank and word of each property of an object; {} without any."""
    ranks = {}
    for key in _PROPERTIES:
        rank = constants.get(f"{key.upper()}_RANK", {}).get(name)
        word = constants.get(f"{key.upper()}_MAP", {}).get(rank)
        if rank is not None and word is not None:
            ranks[key] = (float(rank), str(word))
    return ranks
