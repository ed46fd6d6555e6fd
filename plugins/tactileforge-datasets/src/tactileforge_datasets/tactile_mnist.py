"""The data set ``tactile_mnist``: printed digits touched with a GelSight Mini by a robot."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset, Guess, Recording
from tactileforge.data import EncodedFrames, LazyImages
from tactileforge.errors import DataError
from tactileforge.reading import OfficialSplit, PublishedDataset, RecordingItem, add_once
from tactileforge_datasets import parquet
from tactileforge_datasets.checks import numbers, rising
from tactileforge_datasets.videos import TableVideo

_OFFICIAL = OfficialSplit(
    "tactile-mnist-official",
    "splits train and test of Tactile MNIST: other prints",
    "file",
    frozenset({"train"}),
    frozenset({"test"}),
)
_POSE = ("gel_pose_cell_frame.position", "gel_pose_cell_frame.quaternion")
_POSES = ("gel_pose_cell_frame_seq.position", "gel_pose_cell_frame_seq.quaternion")
_LENGTH, _TIMES = "video_length_frames", "time_stamp_rel_seq"
_TOUCH = ("touch_start_time_rel", "touch_end_time_rel")
_ROW = ("id", "label", "object_id", "pos_in_cell", *_POSE, *_POSES, _LENGTH, _TIMES, *_TOUCH)


class TactileMnist(PublishedDataset):
    """Tactile MNIST, the real sets: a touch is a recording, of one frame or a film.

    Sets with ``sensor_video`` are films. Their times and poses are padded in the table, and cut to
    the length of the video; the frames before the touch begins are the background. Poses of the gel
    in the cell are the track ``pose``, float32 (T, 7): x, y, z in m, and the quaternion in the
    order of the source. Every press has the same commanded depth, and no force.

    Args:
        root: Folder of the parquet files.
        split: One of ``splits``.
        val: Share of the prints held out for validation.

    Raises:
        ConfigError: An unknown split, or ``val`` outside 0..1.
    """

    name = "tactile_mnist"
    sensors = ("gelsight_mini",)
    tier = 4
    licence = "CC-BY-2.0, as stated by others; see its page"
    citation = "Schneider et al., Tactile MNIST, 2025"
    url = "https://huggingface.co/TimSchneider42"
    tree = """ROOT/data/                     (or ROOT itself)
  train-00000-of-00010.parquet ...
  test-00000-of-00002.parquet ..."""
    splits = (_OFFICIAL, *PublishedDataset.splits)
    provides = frozenset({"object"})
    marks = ("*.parquet", "data/*.parquet")
    certainty = 1.0
    doubts = ("order of the quaternion is that of the source", "columns were not seen in a file")

    def __init__(self, root: str, split: str = "tactile-mnist-official", val: float = 0.1) -> None:
        super().__init__(root, split, val)

    @classmethod
    def recognise(cls, root: Path) -> Guess | None:
        """See `PublishedDataset.recognise`; the columns of a file decide."""
        guess = super().recognise(root)
        try:
            known = parquet.column_names(_files(root)[0]) if guess else []
        except (DataError, IndexError):
            return None
        is_ours = {"pos_in_cell", "label"} <= {*known} and _pictures(known) != ""
        return guess if is_ours else None

    def _items(self) -> Iterator[RecordingItem]:
        self._folder(".")
        files = _files(self.root)
        if not files:
            raise self._missing(f"no file data/train-*.parquet in {self.root}")
        for path in files:
            try:
                yield from self._of_file(path)
            except DataError as error:
                add_once(self.skipped, error)

    def _of_file(self, path: Path) -> Iterator[RecordingItem]:
        pictures = _pictures(parquet.column_names(path)) or "sensor_image"
        needed = [_LENGTH, _TIMES] if pictures == "sensor_video" else []
        parquet.check_columns(path, ["id", "label", pictures, *needed])
        side = path.name.split("-")[0].split(".")[0]
        for number, row in enumerate(parquet.read_rows(path, _ROW, at_once=1)):
            where = f"{path}, row {number}"
            name = str(row.get("object_id") or row["id"])
            for touch in range(_touches(row, path, pictures, number)):
                key = f"{side}/{row['id']}/{touch}"
                opened = partial(self._open, key, path, number, _of_touch(row, touch), where)
                yield RecordingItem(key, opened, {"file": side}, group=name)

    def _open(
        self, key: str, path: Path, number: int, touch: dict[str, Any], where: str
    ) -> Recording:
        where, i = f"{where}, touch {key.rpartition('/')[2]}", int(key.rpartition("/")[2])
        frames: Frames
        if _LENGTH in touch:
            frames, times, free = _film(path, number, i, touch, where)
        else:
            read = partial(_picture, str(path), number, i)
            frames, times, free = EncodedFrames(where, LazyImages(1, read)), np.zeros(1), []
        names = _POSES if _LENGTH in touch else _POSE
        tracks = _pose(touch, names, len(times), where)
        if touch.get("pos_in_cell") is not None:
            place = numbers(touch["pos_in_cell"], (2,), "pos_in_cell", where)
            tracks["pos_in_cell"] = np.repeat(place[None].astype(np.float32), len(times), axis=0)
        return self._recording(
            key,
            sensor="gelsight_mini",
            frames=frames,
            times=times,
            no_contact=FrameSubset(frames, free) if free else None,
            object=f"tactile_mnist_{touch.get('object_id') or touch['id']}",
            labels={"digit": float(touch["label"])},
            tracks=tracks,
        )


def _files(root: Path) -> list[Path]:
    return sorted((*root.glob("*.parquet"), *root.glob("data/*.parquet")))


def _pictures(names: list[str]) -> str:
    """Column of the pictures: films if there are any; "" for a file of something else."""
    return next((name for name in ("sensor_video", "sensor_image") if name in names), "")


def _touches(row: dict[str, Any], path: Path, pictures: str, number: int) -> int:
    """Number of touches of a row, from its labels, or from its pictures without any."""
    lists = (row.get(name) for name in (_LENGTH, "pos_in_cell", *_POSE))
    labels = next((values for values in lists if isinstance(values, list)), None)
    if labels is None:
        labels = parquet.read_cell(str(path), pictures, number) or []
    return len(labels)


def _of_touch(row: dict[str, Any], i: int) -> dict[str, Any]:
    """Values of one touch of a row; lists of touches give their item, None beyond their end."""
    return {
        name: (value[i] if i < len(value) else None) if isinstance(value, list) else value
        for name, value in row.items()
    }


def _film(
    path: Path, number: int, i: int, touch: dict[str, Any], where: str
) -> tuple[TableVideo, NDArray[np.float64], list[int]]:
    """Frames, times and numbers of the frames before the contact."""
    length = touch[_LENGTH]
    padded = numbers(touch[_TIMES], (None,), _TIMES, where, empty=True)
    if not isinstance(length, int) or not 0 < length <= len(padded):
        raise DataError(
            f"{where}: {_LENGTH} is {length}, with {len(padded)} times; download it again"
        )
    stamps = numbers(padded[:length], (length,), _TIMES, where)
    times = rising(stamps, where)
    start = touch.get(_TOUCH[0])
    free = np.flatnonzero(stamps < start).tolist() if start is not None else []
    return TableVideo(partial(_video, str(path), number, i), length, where), times, free


def _pose(
    touch: dict[str, Any], names: tuple[str, str], count: int, where: str
) -> dict[str, NDArray[Any]]:
    """The track of poses, cut to the length of the film; none where the table has none."""
    if any(touch.get(name) is None for name in names):
        return {}
    parts = []
    for name, width in zip(names, (3, 4), strict=True):
        values = touch[name] if names is _POSES else [touch[name]]
        parts.append(numbers(values[:count], (count, width), name, where))
    return {"pose": np.concatenate(parts, axis=1).astype(np.float32)}


def _picture(path: str, row: int, touch: int, _: int) -> bytes:
    return _item(path, "sensor_image", row, touch)


def _video(path: str, row: int, touch: int) -> bytes:
    return _item(path, "sensor_video", row, touch)


def _item(path: str, column: str, row: int, touch: int) -> bytes:
    where, cell = f"{path}, row {row}, touch {touch}", parquet.read_cell(path, column, row)
    if not isinstance(cell, list) or touch >= len(cell):
        raise DataError(f"{where}: {column} has {len(cell or ())} touches; download it again")
    return parquet.image_bytes(cell[touch], where)
