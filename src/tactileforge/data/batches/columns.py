"""Extra columns of the batch: declared by heads and objectives, cut from tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import BATCH_KEYS, Column, ColumnSize, Recording
from tactileforge.data.labels.turns import check_turns
from tactileforge.errors import ConfigError, DataError, PluginError


@dataclass(frozen=True)
class CutColumns:
    """Declared columns with the size of their steps.

    Attributes:
        columns: Declared columns.
        sizes: Size of a step, by the name of the column.
    """

    columns: tuple[Column, ...]
    sizes: Mapping[str, ColumnSize]

    def cut(self, recording: Recording, rows: Sequence[int] | NDArray[np.int64]) -> dict[str, Any]:
        """Cut the columns of one clip, each with ``NAME_valid``, bool (steps,).

        Args:
            recording: Recording of the clip; without the track, no step is valid.
            rows: Frame numbers of the clip, oldest first.

        Raises:
            DataError: The size of a step differs from that of other recordings.
        """
        found: dict[str, Tensor] = {}
        for column in self.columns:
            values, valid = self._of(column, recording, steps_of(column, rows))
            found[column.name] = torch.from_numpy(values)
            found[f"{column.name}_valid"] = torch.from_numpy(valid)
        return found

    def _of(
        self, column: Column, recording: Recording, steps: NDArray[np.int64]
    ) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        shape = self.sizes[column.name].shape
        track = recording.tracks.get(column.track or column.name)
        if track is None:
            return np.zeros((len(steps), *shape), column.dtype), np.zeros(len(steps), bool)
        if track.shape[1:] != shape:
            raise DataError(
                f"{recording.key}: a step of the track {column.track or column.name!r} is "
                f"{track.shape[1:]}, and of others {shape}; give all the same"
            )
        values, inside = take_steps(track, steps)
        if np.issubdtype(values.dtype, np.floating):
            inside = inside & np.isfinite(values).reshape(len(values), -1).all(1)
            # masked steps still enter the arithmetic of a loss, where 0 times NaN would be NaN
            values = np.nan_to_num(values, posinf=0.0, neginf=0.0)
        return values.astype(column.dtype), inside


def steps_of(column: Column, rows: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    """Frame numbers of a column, also before or after the recording.

    Args:
        column: Declared column.
        rows: Frame numbers of the clip.
    """
    if column.window is None:
        return np.asarray(rows, np.int64)
    return int(rows[-1]) + np.arange(*column.window, dtype=np.int64)


def take_steps(
    track: NDArray[Any], steps: NDArray[np.int64]
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Values at frame numbers, held at both ends of the recording, and a mask.

    Args:
        track: Values of a recording, (T, ...).
        steps: Frame numbers, int64 (n,), also below 0 and above T - 1.

    Example:
        >>> values, inside = take_steps(np.array([5, 6, 7]), np.arange(1, 5))
        >>> values.tolist(), inside.tolist()
        ([6, 7, 7, 7], [True, True, False, False])
    """
    held = np.clip(steps, 0, len(track) - 1)
    return track[held], held == steps


def own_columns(plugin: type[Any], options: Mapping[str, Any]) -> Sequence[Column]:
    """Columns declared by one head or objective.

    Args:
        plugin: Class of the head or objective; its ``columns`` are a sequence, or a function of its
            options.
        options: Options of the head or objective.
    """
    declared = getattr(plugin, "columns", ())
    found: Sequence[Column] = declared(options) if callable(declared) else declared
    return found


def declared_columns(
    parts: Iterable[tuple[str, type[Any], Mapping[str, Any]]],
) -> tuple[Column, ...]:
    """Columns declared by heads and objectives, each once.

    Args:
        parts: Words for messages (such as ``head 'grip'``), class and options of each part.

    Raises:
        PluginError: A column has the name of a batch key, or two parts declare different columns
            by one name.
    """
    found: dict[str, tuple[str, Column]] = {}
    for what, plugin, options in parts:
        for column in own_columns(plugin, options):
            if column.name in BATCH_KEYS:
                raise PluginError(
                    f"{what} declares the column {column.name!r}, which every batch has; give it "
                    "another name"
                )
            owner, before = found.setdefault(column.name, (what, column))
            if before != column:
                raise PluginError(
                    f"{owner} and {what} declare other columns by the name {column.name!r}; give "
                    "one of them another name"
                )
    return tuple(column for _, column in found.values())


def measure_columns(columns: Sequence[Column], recordings: Sequence[Recording]) -> CutColumns:
    """Measure the size of a step of each column, and its statistics if declared.

    Args:
        columns: Declared columns.
        recordings: Recordings to train on.

    Raises:
        ConfigError: No recording has the track; the message lists the existing tracks.
        DataError: The sizes of steps differ, or a shape cannot turn as declared.
        PluginError: A column turns in an unknown way.
    """
    return CutColumns(tuple(columns), {one.name: _size(one, recordings) for one in columns})


def _size(column: Column, recordings: Sequence[Recording]) -> ColumnSize:
    name = column.track or column.name
    tracks = {one.key: one.tracks[name] for one in recordings if name in one.tracks}
    if not tracks:
        known = sorted({track for one in recordings for track in one.tracks})
        raise ConfigError(
            f"the column {column.name!r} is cut from the track {name!r}, which the data does not "
            f"have (it has: {', '.join(known) or 'no tracks'}); use data that has it"
        )
    # the first recording says the shape: it is named beside the one that differs
    first, shape = next((key, track.shape[1:]) for key, track in tracks.items())
    if column.shape is not None and shape != column.shape:
        raise DataError(
            f"{first}: a step of the track {name!r} is {shape}, and the column needs "
            f"{column.shape}; measure the track again"
        )
    for key, track in tracks.items():
        if track.shape[1:] != shape:
            raise DataError(
                f"{key}: a step of the track {name!r} is {track.shape[1:]}, and of {first} "
                f"{shape}; give all the same"
            )
    check_turns(column, tuple(shape))
    if not column.statistics:
        return ColumnSize(shape=tuple(shape))
    # float64: sums of squares of a long float32 track lose digits
    values = np.concatenate([*tracks.values()]).astype(np.float64).reshape(-1, *shape)
    values = values[np.isfinite(values).reshape(len(values), -1).all(1)]
    if not len(values):
        raise DataError(f"the track {name!r} has no finite value; leave out what needs it")
    mean, deviation = values.mean(0).ravel().tolist(), values.std(0).ravel().tolist()
    return ColumnSize(shape=tuple(shape), mean=tuple(mean), deviation=tuple(deviation))


def plain_sizes(columns: CutColumns | None) -> dict[str, dict[str, Any]]:
    """Sizes of columns as plain data, for the configuration of a run."""
    sizes = columns.sizes if columns else {}
    return {
        name: {k: v if v is None else list(v) for k, v in asdict(size).items()}
        for name, size in sizes.items()
    }
