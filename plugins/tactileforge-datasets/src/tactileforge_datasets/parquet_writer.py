"""Touch recordings as parquet with images, a row per frame."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data import encode_image
from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import new_part

#: Frames that are in memory at once.
_AT_ONCE = 64
#: Names of files by split, as Hugging Face has them.
_FILES = {"train": "train", "val": "validation"}
_NUMBERS = ("timestamp", "force_x", "force_y", "force_z")
_TEXTS = ("recording", "sensor", "object", "text", "action", "licence")


def write_parquet(
    parts: Mapping[str, Iterable[Recording]], out: Path, file_mb: float
) -> dict[str, int]:
    """Writes tables beside their final place, then renames them.

    Columns: ``image`` (PNG, without loss), ``recording``, ``sensor``, ``timestamp`` in s,
    ``force_x`` to ``force_z`` in N, ``object``, ``text``, ``action``, ``licence``; null for no
    label.

    Args:
        parts: Recordings of each split, ``train`` and ``val``.
        out: Folder of the tables; it must not exist.
        file_mb: Size of a file from which a new one is begun, MB.

    Returns:
        Rows of each split.

    Raises:
        ConfigError: The folder exists.
        DataError: There are no recordings.
    """
    if out.exists():
        raise ConfigError(f"{out} exists: give another out=, or remove it")
    with new_part(out) as part:
        part.mkdir()
        counts = {
            split: _write(found, part, _FILES[split], file_mb) for split, found in parts.items()
        }
        if not any(counts.values()):
            raise DataError("there are no recordings to write; look at data=")
        part.replace(out)
    return {split: count for split, count in counts.items() if count}


def _write(recordings: Iterable[Recording], folder: Path, name: str, file_mb: float) -> int:
    import pyarrow as arrow
    from pyarrow import parquet

    schema = _schema(arrow)
    paths: list[Path] = []
    count, writer = 0, None
    for recording in recordings:
        for rows in _rows(recording):
            if writer is None or paths[-1].stat().st_size > file_mb * 1e6:
                if writer is not None:
                    writer.close()
                paths.append(folder / f"{name}-{len(paths):05d}.parquet")
                writer = parquet.ParquetWriter(paths[-1], schema)
            writer.write_table(arrow.Table.from_pylist(rows, schema))
            count += len(rows)
    if writer is not None:
        writer.close()
    for number, path in enumerate(paths):
        path.rename(folder / f"{name}-{number:05d}-of-{len(paths):05d}.parquet")
    return count


def _schema(arrow: Any) -> Any:
    """Types of the columns, and their features for Hugging Face's datasets."""
    image = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
    fields = [("image", image), *((name, arrow.string()) for name in _TEXTS)]
    fields += [("timestamp", arrow.float64())]
    fields += [(name, arrow.float32()) for name in _NUMBERS[1:]]
    features = {
        "image": {"_type": "Image"},
        **{name: {"dtype": "string", "_type": "Value"} for name in _TEXTS},
        "timestamp": {"dtype": "float64", "_type": "Value"},
        **{name: {"dtype": "float32", "_type": "Value"} for name in _NUMBERS[1:]},
    }
    about = {"info": {"features": features}}
    return arrow.schema(fields, metadata={"huggingface": json.dumps(about)})


def _rows(recording: Recording) -> Iterator[list[dict[str, Any]]]:
    """Rows of a recording, some at a time."""
    count = len(recording.frames)
    numbers = iter(range(count))
    while chosen := [*islice(numbers, _AT_ONCE)]:
        frames = recording.frames.read(chosen)
        yield [
            _row(recording, number, encode_image(frame, "png"))
            for number, frame in zip(chosen, frames, strict=True)
        ]


def _row(recording: Recording, number: int, image: bytes) -> dict[str, Any]:
    force = None if recording.force is None else recording.force[number]
    action = -1 if recording.action is None else int(recording.action[number])
    axes = (None, None, None) if force is None else force.tolist()
    known = (None if one is None or np.isnan(one) else one for one in axes)
    return {
        "image": {"bytes": image, "path": f"{recording.key}/{number:06d}.png"},
        "recording": recording.key,
        "sensor": recording.sensor,
        "object": recording.object,
        "text": recording.text,
        "action": ACTIONS[action] if action >= 0 else None,
        "licence": recording.licence or None,
        "timestamp": float(recording.times[number]),
        **dict(zip(_NUMBERS[1:], known, strict=True)),
    }
