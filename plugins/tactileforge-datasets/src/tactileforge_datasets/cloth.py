"""The data set ``cloth``: a robot grasps clothing with a GelSight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.errors import DataError
from tactileforge.plugins import load_json
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_times,
    read_text,
)
from tactileforge_datasets.official_splits import ANYTOUCH2_CLOTH, CLOTH_OFFICIAL

_LISTS = {
    CLOTH_OFFICIAL.name: ("train_data.json", "test_data.json"),
    ANYTOUCH2_CLOTH.name: ("train_data_new.json", "test_data_new.json"),
}


class Cloth(PublishedDataset):
    """Active Clothing: each grasp is a recording, its first frame without contact.

    `cloth_metadata.json` has eleven integers per cloth; the last is its class of textile, one of
    20. They become the labels ``attribute_0`` to ``attribute_9`` and ``class``.

    Args:
        root: The folder ``Data_ICRA18``.
        split: One of ``splits``; all but `all` read their lists from the root.
        val: Share of the cloths held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "cloth"
    sensors = ("gelsight",)
    tier = 5
    citation = "Yuan et al., Active Clothing Material Perception, ICRA 2018"
    url = "http://data.csail.mit.edu/active_clothing/Data_ICRA18.tar"
    tree = """ROOT/
  cloth_metadata.json
  train_data.json, test_data.json          (those of AnyTouch 2 end in _new.json)
  Data/12/3/gelsight_frame/0001.png ...    (cloth, trial)"""
    splits = (CLOTH_OFFICIAL, ANYTOUCH2_CLOTH, ALL_FOR_TRAINING)
    provides = frozenset({"object"})
    marks = ("cloth_metadata.json",)
    certainty = 1.0
    doubts = ("the split is one of the lists beside the data",)

    def __init__(
        self, root: str, split: str = "cloth-official", val: float = 0.1, fps: float = 30.0
    ) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        data = self._folder("Data")
        sides = self._sides()
        classes = self._read("cloth_metadata.json")
        folders = sorted(data.glob("*/*/gelsight_frame"))
        if not folders:
            raise self._missing(f"no folder CLOTH/TRIAL/gelsight_frame in {data}")
        for folder in folders:
            cloth, trial = folder.parts[-3:-1]
            key = f"{cloth}/{trial}"
            opened = partial(self._open, key, folder, classes.get(_plain(cloth), []))
            side = sides.get((_plain(cloth), _plain(trial)), "")
            # held out by cloth: trials of one look alike
            yield RecordingItem(key, opened, {"list": side}, group=cloth)

    def _open(self, key: str, folder: Path, classes: Any) -> Recording:
        touch = NumberedImages(folder, r"\d+")
        frames = touch.frames(self._index)
        return self._recording(
            key,
            sensor="gelsight",
            frames=frames,
            times=frame_times(list(touch.files), self.fps),
            no_contact=FrameSubset(frames, [0]),
            object=f"cloth_{_plain(key.split('/')[0])}",
            labels=_labels(key, classes),
        )

    def _sides(self) -> dict[tuple[str, str], str]:
        """Side of the split by cloth and trial, from the split's lists."""
        sides = {}
        for side, name in zip(("train", "test"), _LISTS.get(self.split, ()), strict=False):
            for entry in self._read(name).values():
                try:
                    place = _plain(entry["cloth_index"]), _plain(entry["trial_index"])
                except (KeyError, TypeError) as error:
                    raise DataError(
                        f"{self.root / name}: {entry!r} has no cloth_index and trial_index; "
                        "download it again"
                    ) from error
                sides[place] = side
        return sides

    def _read(self, name: str) -> Mapping[str, Any]:
        """A JSON object from a file in the root, its keys without leading zeros."""
        path = self.root / name
        if not path.is_file():
            raise self._missing(f"no file {path}")
        try:
            content = load_json(read_text(path))
            return {_plain(key): value for key, value in content.items()}
        except (AttributeError, ValueError) as error:
            raise DataError(f"{path}: not a JSON object: {error}; download it again") from error


def _labels(key: str, classes: Any) -> dict[str, float]:
    """Attributes of a cloth, and its class, the last of them.

    Raises:
        DataError: They are no numbers.
    """
    try:
        values = [float(value) for value in (classes if isinstance(classes, list) else [classes])]
    except (TypeError, ValueError) as error:
        raise DataError(
            f"{key}: its classes {str(classes)[:60]} are no numbers; download cloth_metadata.json "
            "again"
        ) from error
    names = [f"attribute_{i}" for i in range(len(values) - 1)] + ["class"] * bool(values)
    return dict(zip(names, values, strict=True))


def _plain(number: Any) -> str:
    """A number without leading zeros: folders and lists differ in them."""
    text = str(number)
    return str(int(text)) if text.isdigit() else text
