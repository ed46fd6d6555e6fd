"""Tables of one episode of a LeRobot data set: its numbers, times and places."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, unknown
from tactileforge_lerobot import folder
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.parquet import numbers_of, read_parquet

#: Largest relative difference between the rate of a video, or of rows, and that of the metadata.
_RATE = 0.1


class EpisodeRows:
    """Rows of one episode in its parquet file.

    Args:
        root: Folder of the data set.
        info: Metadata of the data set.
        about: Number, length and location of the episode; see `episodes.read_episodes`.
        missing: Numbers stored in place of an unknown value, which become NaN.
    """

    def __init__(
        self, root: Path, info: Info, about: dict[str, Any], missing: Sequence[float] = ()
    ) -> None:
        self.root, self.info, self.about, self.missing = root, info, about, tuple(missing)

    @property
    def number(self) -> int:
        """Number of the episode."""
        return int(self.about["episode_index"])

    def __len__(self) -> int:
        """Number of rows, after `place` has compared it with the file: an array may be made."""
        _ = self.place
        return int(self.about["length"])

    @cached_property
    def place(self) -> tuple[Path, int]:
        """Parquet file of the episode, and its first row there.

        Raises:
            DataError: The file has a different number of its rows.
        """
        path = self.info.data_file(self.root, self._fields("data"))
        numbers = read_parquet(path, ("episode_index",))["episode_index"].to_numpy()
        rows = np.flatnonzero(numbers == self.number)
        length = int(self.about["length"])
        if not length:
            raise DataError(f"{path}: episode {self.number} is empty; leave it out")
        if len(rows) != length or (np.diff(rows) != 1).any():
            raise DataError(
                f"{path}: {len(rows)} rows of episode {self.number}, but its length is "
                f"{self.about['length']}; download the data set again"
            )
        return path, int(rows[0])

    def _fields(self, group: str) -> dict[str, int]:
        """Fields of the path of the data, or of a video, of the episode."""
        if self.info.version == 2:
            return {
                "episode_chunk": self.number // self.info.chunks,
                "episode_index": self.number,
            }
        names = ("chunk_index", "file_index")
        return {name: int(self._cell(f"{group}/{name}")) for name in names}

    def video(self, feature: str) -> tuple[Path, float]:
        """Video of a feature, and the time of its first frame of the episode, s."""
        path = self.info.video_file(self.root, feature, self._fields(f"videos/{feature}"))
        start = 0.0
        if self.info.version == 3:
            start = self._cell(f"videos/{feature}/from_timestamp")
        return path, start

    def _cell(self, name: str) -> float:
        value: Any = self.about.get(name)
        if type(value) not in (int, float) or not 0 <= value < 1 << 40:
            raise DataError(
                f"{self.root}/meta/episodes: {name} of episode {self.number} is {value!r}, not a "
                "number; download the data set again"
            )
        return float(value)

    def dtype(self, feature: str) -> str:
        """Type of a numeric feature.

        Raises:
            DataError: It holds no numbers.
        """
        dtype = str(self.info.features[feature]["dtype"])
        if dtype not in folder.NUMBERS:
            raise DataError(
                f"{self.root / folder.INFO}: {feature} is of dtype {dtype!r}, no numbers "
                f"({', '.join(folder.NUMBERS)}); give another feature, or correct it"
            )
        return dtype

    def shape(self, feature: str) -> list[int]:
        """Shape of a row of a feature, by the metadata."""
        return [int(size) for size in self.info.features[feature]["shape"]]

    def numbers(self, feature: str, columns: Sequence[int] | None = None) -> NDArray[Any]:
        """Reads a numeric feature, (N, numbers of a row), or some columns of it.

        Raises:
            DataError: The feature holds no numbers, contradicts its shape, or lacks a column.
        """
        path, start = self.place
        dtype = self.dtype(feature)
        column = read_parquet(path, (feature,))[feature].slice(start, len(self))
        values = self.cleaned(numbers_of(column, dtype, f"{path}: {feature}"))
        self.check_size(feature, values.shape[1])
        if columns is None:
            return values
        if max(columns) >= values.shape[1]:
            raise DataError(
                f"{path}: {feature} has {values.shape[1]} columns, but force_columns="
                f"{list(columns)}"
            )
        return values[:, list(columns)]

    def check_size(self, feature: str, size: int) -> None:
        """Raises a `DataError` if a row has a different number of numbers than the metadata say."""
        shape = self.shape(feature)
        if int(np.prod(shape, dtype=int)) != size:
            raise DataError(
                f"{self.place[0]}: {feature} has {size} numbers a row, where "
                f"{self.root / folder.INFO} says {shape}; correct the shape"
            )

    def cleaned(self, values: NDArray[Any]) -> NDArray[Any]:
        """Replaces the numbers in place of an unknown value by NaN, in floats."""
        if not self.missing or values.dtype.kind != "f":
            return values
        return np.where(np.isin(values, np.asarray(self.missing, values.dtype)), np.nan, values)

    def times(self, feature: str) -> NDArray[np.float64]:
        """Reads the stored times of the frames; without them, the regular times of the rows.

        Raises:
            DataError: Rows come at a different rate than the metadata say, or their times fall.
        """
        if feature in self.info.features:
            return self.numbers(feature)[:, 0].astype(np.float64)
        if "timestamp" in self.info.features:
            stamps = self.numbers("timestamp")[:, 0].astype(np.float64)
            where = f"{self.place[0]}: timestamp"
            self.check_rate(where, stamps)
            if not np.isfinite(stamps).all() or (np.diff(stamps) <= 0).any():
                row = int(np.flatnonzero(~(np.diff(stamps, prepend=-np.inf) > 0))[0])
                raise DataError(
                    f"{where} of episode {self.number} does not rise at row {row} "
                    f"({stamps[row]:g} s); download it again"
                )
        return np.arange(len(self)) / self.info.fps

    def check_rate(self, what: str, times: NDArray[np.float64]) -> None:
        """Raises a `DataError` if the rate of times differs from the rate in the metadata."""
        fps = self.info.fps
        step = float(np.median(np.diff(times))) if len(times) > 1 else 1 / fps
        if not abs(step * fps - 1) <= _RATE:
            said = f"{1 / step:.4g} times a second" if step > 0 else "without a step in time"
            raise DataError(
                f"{what} comes {said}, where {self.root / folder.INFO} says fps: {fps:g}; correct "
                "the one that is wrong, or convert the video"
            )


def check_feature(root: Path, info: Info, feature: str, what: str) -> str:
    """Checks the name of a feature, and returns it.

    Args:
        root: Folder of the data set.
        info: Metadata of the data set.
        feature: Name of the feature.
        what: Origin of the name, for the message.

    Raises:
        DataError: There is no such feature; the message names the nearest.
    """
    if feature not in info.features:
        raise DataError(f"{root}: {unknown(f'feature in {what}', feature, info.features)}")
    return feature
