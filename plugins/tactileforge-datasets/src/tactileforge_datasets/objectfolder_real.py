"""The data set ``objectfolder_real``: a robot presses a GelSlim on a hundred objects."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.errors import DataError
from tactileforge.reading import (
    NumberedImages,
    PublishedDataset,
    RecordingItem,
    add_once,
    frame_times,
    is_there,
    matches,
    read_rows,
)


class ObjectFolderReal(PublishedDataset):
    """ObjectFolder Real: a folder ``gelsight`` is a recording, its first frame the background.

    Camera images and touches have different names: `contact_text_obj.csv` of TacQuad pairs them
    (touch, vision, number of a text). A recording has one view for each listed touch, at its time;
    without the file, recordings have no view.

    Args:
        root: Folder with ``tactile``, or that folder itself.
        split: One of ``splits``.
        val: Share of the recordings held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "objectfolder_real"
    sensors = ("gelslim",)
    tier = 5
    citation = "Gao et al., The ObjectFolder Benchmark, CVPR 2023"
    url = "https://objectfolder.stanford.edu/objectfolder-real-download"
    tree = """ROOT/
  contact_text_obj.csv         (from https://huggingface.co/datasets/xxuan01/TacQuad)
  tactile/1/CONTACT/gelsight/0.png ..."""
    provides = frozenset({"object", "image"})
    marks = (
        "contact_text_obj.csv",
        *(f"tactile/{number}/*/gelsight" for number in ("[1-9]", "[1-9][0-9]", "100")),
    )
    doubts = ("the rate is 30 frames a second unless fps says otherwise",)

    def __init__(self, root: str, split: str = "all", val: float = 0.1, fps: float = 30.0) -> None:
        super().__init__(root, split, val)
        self.fps = fps

    def _items(self) -> Iterator[RecordingItem]:
        tactile = self._folder("tactile", "real/tactile", ".")
        views, missing = _views(tactile)
        for line in missing:
            add_once(self.notes, line)
        folders = sorted(path for path in matches(tactile, "**/gelsight") if path.is_dir())
        if not folders:
            raise self._missing(f"no folder gelsight in {tactile}")
        for folder in folders:
            place = folder.parent.relative_to(tactile)
            key = place.as_posix()
            yield RecordingItem(
                key, partial(self._open, key, place.parts[0], folder, views[folder])
            )

    def _open(self, key: str, name: str, folder: Path, views: Mapping[int, Path]) -> Recording:
        touch = NumberedImages(folder, r"\d+")
        frames = touch.frames(self._index)
        numbers = list(touch.files)
        times = frame_times(numbers, self.fps)
        rows = [row for row, number in enumerate(numbers) if number in views]
        return self._recording(
            key,
            sensor="gelslim",
            frames=frames,
            times=times,
            no_contact=FrameSubset(frames, [0]),
            object=f"objectfolder_{name}",
            image=self._pictures([views[numbers[row]] for row in rows]) if rows else None,
            image_times=times[rows] if rows else None,
        )


def _views(tactile: Path) -> tuple[dict[Path, dict[int, Path]], list[str]]:
    """The camera image of each listed touch, by folder and number; and lines about missing ones."""
    pairs: dict[Path, dict[int, Path]] = defaultdict(dict)
    index = tactile.parent / "contact_text_obj.csv"
    rows = read_rows(index) if is_there(index) else [[]]
    if not rows:
        raise DataError(f"{index}: empty; download it again, or remove it")
    missing: list[Path] = []
    for i, row in enumerate(rows, start=1):
        if not row:
            continue
        if len(row) < 2:
            raise DataError(
                f"{index}, line {i}: {row} is not a touch, a view and a number; download it again"
            )
        touch, view = tactile / row[0], tactile / row[1]
        if touch.stem.isdecimal() and is_there(view):
            pairs[touch.parent][int(touch.stem)] = view
        elif is_there(touch):
            missing.append(view)
    if not missing:
        return pairs, []
    return pairs, [
        f"{index}: the views of {len(missing)} touches are not there, such as {missing[0]}"
    ]
