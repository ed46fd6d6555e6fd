"""The data set ``feats``: presses on a GelSight Mini with dots, with a force for each cell."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Guess, Recording
from tactileforge.data import EncodedFrames, LazyImages
from tactileforge.errors import DataError
from tactileforge.reading import OfficialSplit, PublishedDataset, RecordingItem, load_pickled_array
from tactileforge_datasets.checks import numbers, value_of, word_before_number

_GRIDS = ("grid_x", "grid_y", "grid_z")
_SUMS = ("f_x", "f_y", "f_z")
#: Start of the names of files of scales.
_SCALES = "normalization"
#: Largest difference of a force and the sum of its cells, N: that of rounding.
_ROUNDED = 0.01
_OFFICIAL = OfficialSplit(
    "feats-official",
    "folders train, val and test of FEATS; its test folders of other gels are test too",
    "folder",
    frozenset({"train"}),
    frozenset(
        {
            *("test", "test_diff_sensor_new_gel", "test_diff_sensor_old_gel"),
            "test_unknown_indenters",
        }
    ),
    frozenset({"val"}),
)


class Feats(PublishedDataset):
    """FEATS: a press is a recording of one frame, with its force and the forces of 24 x 32 cells.

    The source's z is negative when pressing, and is turned; x and y are as they are there: their
    directions in the picture were not checked, so that no actions are derived. Forces of the cells
    are the track ``force_map``, float32 (1, rows, columns, 3), N, in the same axes. Nothing in the
    pickled files is executed. No frame is known to be without contact: nothing is subtracted.

    Args:
        root: Folder with ``labels``, or that folder itself.
        split: One of ``splits``.
        val: Share of the indenters held out for validation, of the split ``all``.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "feats"
    sensors = ("gelsight_mini",)
    tier = 1
    licence = "MIT, as stated by others; see its page"
    citation = "Helmut et al., Learning Force Distribution Estimation for the GelSight Mini, 2024"
    url = "https://huggingface.co/datasets/erikhelmut/FEATS"
    tree = """ROOT/labels/
  train/sphere_0.npy ...       (val, test alike)"""
    splits = (_OFFICIAL, *PublishedDataset.splits)
    provides = frozenset({"force", "object"})
    marks = ("labels/train/*.npy", "train/*.npy")
    doubts = ("directions of x and y in the picture were not checked", "no times: single frames")

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; the first press decides."""
        guess = super().recognise(root)
        files = sorted(path for mark in cls.marks for path in root.glob(mark)) if guess else []
        try:
            presses = (_read(path) for path in files if not path.name.startswith(_SCALES))
            return guess if "gs_img" in next(presses, {}) else None
        except DataError:
            return None

    def __init__(self, root: str, split: str = "feats-official", val: float = 0.1) -> None:
        super().__init__(root, split, val)

    def _items(self) -> Iterator[RecordingItem]:
        labels = self._folder("labels", ".")
        files = sorted(path for path in labels.glob("*/*.npy") if not path.name.startswith(_SCALES))
        if not files:
            raise self._missing(f"no file train/NAME.npy in {labels}")
        for path in files:
            key = f"{path.parent.name}/{path.stem}"
            facts = {"folder": path.parent.name}
            opened = partial(self._open, key, path)
            yield RecordingItem(key, opened, facts, group=word_before_number(path.stem))

    def _open(self, key: str, path: Path) -> Recording:
        sample, where = _read(path), str(path)
        _picture(str(path), 0)  # a picture of another kind is named now
        maps = [
            numbers(value_of(sample, name, where), (None, None), name, where) for name in _GRIDS
        ]
        for grid, name in zip(maps, _GRIDS, strict=True):
            numbers(grid, maps[0].shape, name, where)
        force = np.array([_number(sample, name, where) for name in _SUMS])
        off = np.abs(force - [grid.sum() for grid in maps])
        if (off > _ROUNDED * np.maximum(1, np.abs(force))).any():
            raise DataError(
                f"{path}: f_x, f_y, f_z are {force.round(3).tolist()} N, the sums of their cells "
                f"{[round(float(grid.sum()), 3) for grid in maps]} N; download it again"
            )
        turned = np.array([1, 1, -1], np.float32)
        return self._recording(
            key,
            sensor="gelsight_mini",
            frames=EncodedFrames(str(path), LazyImages(1, partial(_picture, str(path)))),
            times=np.zeros(1),
            no_contact=None,
            force=force[None].astype(np.float32) * turned,
            object=f"feats_{word_before_number(path.stem)}",
            tracks={"force_map": np.stack(maps, -1)[None].astype(np.float32) * turned},
        )


def _read(path: Path) -> dict[str, Any]:
    sample = load_pickled_array(path)
    if not isinstance(sample, dict):
        raise DataError(f"{path}: a {type(sample).__name__}, where a dict of a press belongs")
    return sample


def _number(sample: dict[str, Any], name: str, where: str) -> float:
    return float(numbers(np.ravel(value_of(sample, name, where)), (1,), name, where)[0])


def _picture(path: str, _: int) -> NDArray[np.uint8]:
    """Picture of a press, uint8 (H, W, 3), RGB."""
    picture = value_of(_read(Path(path)), "gs_img", path)
    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8 or picture.ndim != 3:
        raise DataError(
            f"{path}: gs_img is {getattr(picture, 'dtype', type(picture).__name__)} "
            f"{np.shape(picture)}, where uint8 (H, W, 3) belongs; download it again"
        )
    return picture
