"""The data set ``unitac_nv``: arrays of taxels pressed on four shapes, with the wrench."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import EncodedFrames, LazyImages
from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import load_json
from tactileforge.reading import PublishedDataset, RecordingItem, read_rows
from tactileforge.sensors import TaxelLayout
from tactileforge_datasets.checks import numbers, pressing_sign, rising

#: Rows, columns and axes of the taxels by folder, and the change drawn as full colour.
_ARRAYS = {"xela": ((4, 6, 3), 5000.0), "papillarray": ((3, 3, 3), 5.0)}
#: Most rows at rest, whose mean is the zero of taxels and wrench, as in the source's own scripts.
#: At most a quarter of a file, so that a short one keeps its contact.
_REST = 100
#: Pixels of a taxel in the picture.
_ZOOM = 8
_MICROSECOND = timedelta(microseconds=1)
_COLUMNS = ("time", "number", "force", "displacement", "FT", "pose")


class _Rows(NamedTuple):
    """Numbers of a file: times (T,), taxels (T, rows, columns, 3), wrench (T, 6), pose (T, 6)."""

    times: NDArray[np.float64]
    taxels: NDArray[np.float64]
    moved: NDArray[np.float64]
    wrench: NDArray[np.float64]
    pose: NDArray[np.float64]


class UniTacNv(PublishedDataset):
    """UniTac-NV: a file of an array of taxels is a recording, with a wrench and a pose a row.

    Taxels less their mean at rest are drawn: red, green and blue are x, y and z. Their values are
    the track ``taxels``, float32 (T, rows, columns, 3), counts of xela, N of papillarray, whose x
    and y are turned as the source does; ``displacement`` (papillarray), ``torque`` (T, 3) in N m,
    ``pose`` (T, 6) in m and rad are tracks too. Forces are the wrench less its mean at rest, turned
    about z, and with the sign that makes z positive on average; their directions in the picture
    were not checked. Literals in cells are read as data.

    Args:
        root: Folder of the shapes, or of ``UniTac-NV Dataset``.
        split: One of ``splits``.
        val: Share of the shapes held out for validation.
        sensor: Type of sensor of the recordings, one of arrays.
        drop: Rows left out at the start of a file.
        turn: Angle of the wrench's axes to those of the taxels about z, degrees.

    Raises:
        ConfigError: A negative number of rows; an unknown split, or ``val`` outside 0..1.
    """

    name = "unitac_nv"
    sensors = ("serial_array",)
    tier = 1
    licence = "none stated"
    citation = "Hou et al., UniTac-NV, 2025"
    url = "https://github.com/JiannnH/UniTac-NV"
    tree = """ROOT/
  square_PLA/xela/sensor_data_20250101_120000.csv ...
  square_PLA/papillarray/sensor_data_20250101_120000.csv ..."""
    provides = frozenset({"force", "object"})
    marks = (
        "*/xela/sensor_data_*.csv",
        "*/papillarray/sensor_data_*.csv",
        "*/*/xela/sensor_data_*.csv",
        "*/*/papillarray/sensor_data_*.csv",
    )
    certainty = 1.0
    doubts = ("unit of xela is counts", "directions of x and y in the picture were not checked")

    def __init__(
        self,
        root: str,
        split: str = "all",
        val: float = 0.1,
        sensor: str = "serial_array",
        drop: int = 10,
        turn: float = 45.0,
    ) -> None:
        super().__init__(root, split, val)
        if drop < 0:
            raise ConfigError(f"{self.name}: drop is {drop}, but must be 0 or more")
        self.sensor, self.drop, self.turn = sensor, drop, turn

    def _items(self) -> Iterator[RecordingItem]:
        root = self._folder("UniTac-NV Dataset", ".")
        files = sorted(
            path for array in _ARRAYS for path in root.glob(f"*/{array}/sensor_data_*.csv")
        )
        if not files:
            raise self._missing(f"no file SHAPE_MATERIAL/xela/sensor_data_*.csv in {root}")
        for path in files:
            key = path.relative_to(root).with_suffix("").as_posix()
            shape = path.parents[1].name.rpartition("_")[0] or path.parents[1].name
            yield RecordingItem(key, partial(self._open, key, path), group=shape)

    def _open(self, key: str, path: Path) -> Recording:
        shape, span = _ARRAYS[path.parent.name]
        rows = _read(path, shape, self.drop)
        still = slice(0, max(1, min(_REST, len(rows.times) // 4)))
        rest = rows.taxels[still].mean(0).reshape(-1, 3)
        layout = TaxelLayout(shape[:2], span=span)
        pictures = LazyImages(len(rows.times), partial(_draw, layout, rows.taxels, rest))
        frames = EncodedFrames(str(path), pictures)
        wrench = _turned(rows.wrench - rows.wrench[still].mean(0), self.turn)
        sign = pressing_sign(wrench[:, 2])
        name, _, material = path.parents[1].name.rpartition("_")
        tracks = {"taxels": rows.taxels, "torque": wrench[:, 3:], "pose": rows.pose}
        if path.parent.name == "papillarray":  # that of xela is always 0
            tracks["displacement"] = rows.moved
        return self._recording(
            key,
            sensor=self.sensor,
            frames=frames,
            times=rows.times,
            no_contact=FrameSubset(frames, list(range(still.stop))),
            force=(wrench[:, :3] * [1, 1, sign]).astype(np.float32),
            object=f"unitac_{name or material}",
            labels={"material": material, "array": path.parent.name},
            tracks={track: values.astype(np.float32) for track, values in tracks.items()},
        )


def _draw(
    layout: TaxelLayout, taxels: NDArray[np.float64], rest: NDArray[np.float64], i: int
) -> NDArray[np.uint8]:
    picture = layout.draw(taxels[i].reshape(-1, 3), rest)
    return picture.repeat(_ZOOM, axis=0).repeat(_ZOOM, axis=1)


def _turned(wrench: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Wrenches, (T, 6), in axes turned about z."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    out: NDArray[np.float64] = (wrench.reshape(-1, 2, 3) @ about_z.T).reshape(-1, 6)
    return out


def _read(path: Path, shape: tuple[int, int, int], drop: int) -> _Rows:
    """Numbers of a file, after its header and some rows."""
    columns: list[list[object]] = [[], [], [], [], []]
    for number, cells in enumerate(read_rows(path)[1:]):
        if number >= drop and cells:
            for column, value in zip(columns, _row(cells, path, number), strict=True):
                column.append(value)
    if not columns[0]:
        raise DataError(f"{path}: no row after the first {drop}; lower data.drop, or remove it")
    where, count = str(path), len(columns[0])
    stamps = numbers(columns[0], (count,), "time", where)  # whole microseconds: exact
    times = rising((stamps - stamps[0]) / 1e6, where)
    taxels = numbers(columns[1], (count, *shape), "force", where)
    moved = numbers(columns[2], (count, *shape), "displacement", where)
    if path.parent.name == "papillarray":
        taxels, moved = taxels * [-1, -1, 1], moved * [-1, -1, 1]
    wrench, pose = (
        numbers(values, (count, 6), name, where)
        for values, name in zip(columns[3:], _COLUMNS[4:], strict=True)
    )
    return _Rows(times, taxels, moved, wrench, pose)


def _row(cells: list[str], path: Path, number: int) -> tuple[object, ...]:
    """Time, microseconds, and the literals of a row, as data."""
    where = f"{path}, row {number}"
    if len(cells) != len(_COLUMNS):
        raise DataError(
            f"{where}: {len(cells)} cells, where {len(_COLUMNS)} belong ({', '.join(_COLUMNS)}); "
            "download it again"
        )
    try:
        clock = datetime.fromisoformat(cells[0].strip())
        return (clock - datetime(1970, 1, 1)) // _MICROSECOND, *map(load_json, cells[2:])
    except (TypeError, ValueError) as error:
        raise DataError(
            f"{where}: not a time and four lists of numbers ({error}); download it again"
        ) from error
