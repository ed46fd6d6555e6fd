"""The data set ``feelanyforce``: presses on a GelSight Mini with forces in three axes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.reading import (
    OfficialSplit,
    PublishedDataset,
    RecordingItem,
    check_regular,
    is_there,
    read_cells,
    still_background,
)
from tactileforge_datasets.checks import inside, numbers, pressing_sign, word_before_number

_SIDES = ("train", "val", "test")
_OFFICIAL = OfficialSplit(
    "feelanyforce-official",
    "tables of train, val and test of FeelAnyForce",
    "table",
    *(frozenset({side}) for side in ("train", "test", "val")),
)


class FeelAnyForce(PublishedDataset):
    """FeelAnyForce: a press is a recording of one frame, with force, torque and a depth picture.

    Rows of the tables without a picture are left out: its recorder fills tables made before. The
    source's Fz is turned so that its mean over all tables is positive; its unit and the directions
    of x and y are not published, and taken for newton and as they are. Torques are the track
    ``torque``, float32 (1, 3). The background is ``background.png`` of the recording's folder.

    Args:
        root: Folder of the tables; paths in them begin here.
        split: One of ``splits``.
        val: Share of the objects held out for validation, of the split ``all``.
        depth: Whether depth pictures are read too, as the track ``depth``, float32 (1, H, W), in
            the unit of the source, which is not published. Each stays in memory.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "feelanyforce"
    sensors = ("gelsight_mini",)
    tier = 1
    licence = "none found; CC-BY-4.0, as stated by others"
    citation = "Shahidzadeh et al., FeelAnyForce, ICRA 2025"
    url = "https://huggingface.co/datasets/amirsh1376/FeelAnyForce"
    tree = """ROOT/
  TacForce_train_set.csv       (val, test alike: tactile,depth,FT)
  dataset/RECORDING/tactile/1000.png ...
  dataset/RECORDING/depth/1000.npy ...
  dataset/RECORDING/background.png"""
    splits = (_OFFICIAL, *PublishedDataset.splits)
    provides = frozenset({"force", "object"})
    marks = ("TacForce_*_set.csv",)
    certainty = 1.0
    doubts = ("unit and axes of the forces are not published", "single presses: no films")

    def __init__(
        self, root: str, split: str = "feelanyforce-official", val: float = 0.1, depth: bool = False
    ) -> None:
        super().__init__(root, split, val)
        self.depth = depth

    def _items(self) -> Iterator[RecordingItem]:
        tables = [(side, self.root / f"TacForce_{side}_set.csv") for side in _SIDES]
        if not any(is_there(path) for _, path in tables):
            raise self._missing(f"no table {tables[0][1]}")
        rows = [
            (side, where, cells)
            for side, path in tables
            if is_there(path)
            for where, cells in read_cells(path, ["tactile", "depth", "FT"])
            if any(cells.values())
        ]
        forces = [_wrench(cells["FT"]) for _, _, cells in rows]
        sign = pressing_sign(wrench[2] for wrench in forces if len(wrench) == 6)
        for (side, where, cells), wrench in zip(rows, forces, strict=True):
            place = Path(cells["tactile"])
            folder = place.parents[1].name if len(place.parts) > 2 else ""
            key = place.with_suffix("").as_posix() or where
            opened = partial(
                self._open, key, where, cells, wrench, sign, word_before_number(folder)
            )
            yield RecordingItem(key, opened, {"table": side}, group=word_before_number(folder))

    def _open(
        self,
        key: str,
        where: str,
        cells: dict[str, str],
        wrench: NDArray[np.float64],
        sign: float,
        name: str,
    ) -> Recording:
        path = inside(self.root, cells["tactile"], where)
        numbers(wrench, (6,), f"FT {cells['FT']!r}", where)
        frames = self._pictures([path])
        tracks: dict[str, NDArray[Any]] = {"torque": wrench[None, 3:].astype(np.float32)}
        if self.depth:
            tracks["depth"] = _depth(inside(self.root, cells["depth"], where), frames.shape)
        stamp = path.stem
        return self._recording(
            key,
            sensor="gelsight_mini",
            frames=frames,
            times=np.zeros(1),
            no_contact=still_background(path.parents[1] / "background.png", frames),
            force=(wrench[None, :3] * [1, 1, sign]).astype(np.float32),
            object=f"feelanyforce_{name}" if name else None,
            labels={"unix_ms": float(stamp)} if stamp.isdigit() else {},
            tracks=tracks,
        )


def _wrench(cell: str) -> NDArray[np.float64]:
    """Numbers of a cell; NaN, of the same number and of 3 at least, for anything else."""
    words = cell.split()
    try:
        return np.array([float(word) for word in words] or [np.nan] * 3)
    except ValueError:
        return np.full(max(3, len(words)), np.nan)


def _depth(path: Path, shape: tuple[int, int]) -> NDArray[np.float32]:
    try:
        check_regular(path)
        depth = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: no array of depth ({error}); download it again") from error
    return numbers(depth, shape, "the depth", str(path))[None].astype(np.float32)
