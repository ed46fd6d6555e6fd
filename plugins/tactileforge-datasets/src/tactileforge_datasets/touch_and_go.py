"""The data set ``touch_and_go``: objects and surfaces touched with a GelSight, filmed."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.reading import (
    ALL_FOR_TRAINING,
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    frame_times,
    label_runs,
    read_text,
    still_background,
)
from tactileforge_datasets.official_splits import (
    ANYTOUCH2_MATERIAL,
    ANYTOUCH2_ROUGH,
    TAG_MATERIAL,
    TAG_ROUGH,
)

#: Materials by label, from `category_reference.txt` of the data set.
MATERIALS = (
    *("concrete", "plastic", "glass", "wood", "metal", "brick", "tile", "leather"),
    *("synthetic fabric", "natural fabric", "rubber", "paper", "tree", "grass", "soil"),
    *("rock", "gravel", "sand", "plants", "others"),
)

#: Soft materials, from the data set's own code for hard against soft.
SOFT = ("leather", "synthetic fabric", "natural fabric", "paper", "grass")

#: The lists of a split by side, below the root.
_LISTS = {
    ALL_FOR_TRAINING.name: {"train": "label.txt"},
    TAG_MATERIAL.name: {"train": "train.txt", "test": "test.txt"},
    TAG_ROUGH.name: {"train": "train_rough.txt", "test": "test_rough.txt"},
    ANYTOUCH2_MATERIAL.name: {"train": "train_bg.txt", "test": "test_bg.txt"},
    ANYTOUCH2_ROUGH.name: {"train": "train_rough_bg.txt", "test": "test_rough_bg.txt"},
}


class _Row(NamedTuple):
    """A labelled frame of a list."""

    number: int
    image: str
    label: int
    background: str


class TouchAndGo(PublishedDataset):
    """Touch and Go, after its ``extract_frame.py``: runs of labelled frames are recordings.

    A run ends at a gap in the numbers or a change of the label. Frames labelled -1 are left out.
    Camera and gel do not share a clock: each touch frame is paired with the camera frame of the
    nearest number. Only the lists of AnyTouch 2 name a frame without contact; with the others
    nothing is subtracted.

    Args:
        root: Folder with ``dataset`` and the lists.
        split: One of ``splits``; selects the lists.
        val: Share of the films held out for validation.
        fps: Frames per second of the films.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "touch_and_go"
    sensors = ("gelsight",)
    tier = 5
    citation = "Yang et al., Touch and Go, NeurIPS 2022 Datasets and Benchmarks"
    url = "https://touch-and-go.github.io"
    tree = """ROOT/
  label.txt                     (or the lists of the split)
  dataset/20220410_031604/
    gelsight_frame/0000000000.jpg ...
    video_frame/0000000000.jpg ..."""
    splits = (ALL_FOR_TRAINING, TAG_MATERIAL, TAG_ROUGH, ANYTOUCH2_MATERIAL, ANYTOUCH2_ROUGH)
    provides = frozenset({"text", "image"})
    marks = ("dataset/*/gelsight_frame", "Dataset/*/gelsight_frame")
    beside = tuple(name for lists in _LISTS.values() for name in lists.values())
    certainty = 1.0
    doubts = ("nothing is subtracted without the lists of AnyTouch 2",)

    def __init__(self, root: str, split: str = "all", val: float = 0.1, fps: float = 30.0) -> None:
        super().__init__(root, split, val)
        self.fps = fps
        if "rough" in split:
            self.provides = frozenset({"image"})

    def _items(self) -> Iterator[RecordingItem]:
        folder = self._folder("dataset", "Dataset")
        for side, name in _LISTS[self.split].items():
            path = self.root / name
            if not path.is_file():
                raise self._missing(f"no list {path}")
            for film, rows in _read(path).items():
                views = NumberedImages(folder / film / "video_frame")
                for part in label_runs([row.number for row in rows], [row.label for row in rows]):
                    key = f"{film}/{rows[part][0].number:010d}"
                    if len(_LISTS[self.split]) > 1:
                        key = f"{side}/{key}"
                    opened = partial(self._open, key, folder / film, rows[part], views)
                    yield RecordingItem(key, opened, {"list": side}, group=film)

    def _open(self, key: str, film: Path, rows: list[_Row], views: NumberedImages) -> Recording:
        touch, numbers = film / "gelsight_frame", [row.number for row in rows]
        frames = self._pictures([touch / row.image for row in rows])
        label, background = rows[0].label, rows[0].background
        labels: dict[str, str | float] = {"rough": float(label)}
        text = None
        if "rough" not in self.split:
            material = MATERIALS[label] if label < len(MATERIALS) else f"material {label}"
            hardness = "soft" if material in SOFT else "hard"
            labels = {"label": float(label), "material": material, "hardness": hardness}
            text = f"touching {material}"
        return self._recording(
            key,
            sensor="gelsight",
            frames=frames,
            times=frame_times(numbers, self.fps),
            no_contact=still_background(touch / background, frames) if background else None,
            text=text,
            image=views.nearest(numbers),
            labels=labels,
        )


def _read(path: Path) -> dict[str, list[_Row]]:
    """Labelled frames of a list ``FILM/FRAME.jpg,LABEL[,BACKGROUND.jpg]`` by film, in order."""
    films: dict[str, dict[int, _Row]] = {}
    for i, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        try:
            place, label, *background = (cell.strip() for cell in line.split(","))
            film, image = place.split("/")
            row = _Row(int(Path(image).stem), image, int(label), (background or [""])[0])
        except ValueError:
            raise DataError(
                f"{path}, line {i}: {line!r} is not FILM/NUMBER.jpg,LABEL; download it again"
            ) from None
        if row.label >= 0:
            films.setdefault(film, {})[row.number] = row
    return {film: [rows[i] for i in sorted(rows)] for film, rows in sorted(films.items())}
