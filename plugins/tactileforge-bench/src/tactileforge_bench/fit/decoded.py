"""Cache of decoded clips, for the next encoder with the same input."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from tactileforge.contracts import Batch
from tactileforge.data import Clips
from tactileforge.plugins import part_name, sweep_parts, write_text
from tactileforge_bench.tasks.source import TaskSource

#: Bytes of clips beyond which they are decoded each time.
LIMIT = 512 * 2**20
#: Changes when the same key would give other clips.
_FORMAT = 2
_ARRAYS = ("frames", "background")


def clip_folder(folder: Path, source: TaskSource, clips: Clips, spacing: float) -> Path | None:
    """The folder of some clips; None where they are too many to keep.

    Args:
        folder: Parent folder of all stored clips.
        source: Source of the clips.
        clips: The clips.
        spacing: Seconds between their frames.
    """
    if len(clips) * (clips.frames + 1) * 3 * clips.size[0] * clips.size[1] > LIMIT:
        return None
    facts = [_FORMAT, source.fingerprint, clips.frames, spacing, clips.size]
    index = hashlib.sha256(np.ascontiguousarray(clips.index).tobytes()).hexdigest()
    key = hashlib.sha256(json.dumps([facts, index]).encode()).hexdigest()[:24]
    return folder / key


def stored_batches(folder: Path, size: int) -> Iterator[Batch] | None:
    """Batches of stored clips, in order; None if they are not stored.

    Args:
        folder: Folder of the clips; see `clip_folder`.
        size: Clips of a batch.
    """
    note = folder / "sensors.json"
    if not note.is_file():
        return None
    sensors: list[str] = json.loads(note.read_text("utf-8"))
    # mapped: a set may be as large as `LIMIT`, and is read once, in order
    frames, background = (np.load(folder / f"{name}.npy", mmap_mode="r") for name in _ARRAYS)

    def batches() -> Iterator[Batch]:
        for start in range(0, len(sensors), size):
            rows = slice(start, start + size)
            yield {
                # copied: torch warns of arrays that cannot be written to
                "frames": torch.from_numpy(np.array(frames[rows])),
                "background": torch.from_numpy(np.array(background[rows])),
                "sensor": sensors[rows],
            }

    return batches()


def store_batches(folder: Path, count: int, batches: Iterator[Batch]) -> Iterator[Batch]:
    """Passes all batches on, and keeps their clips once the last has come.

    Args:
        folder: Folder of the clips; see `clip_folder`.
        count: Clips in all.
        batches: Batches, from the first clip on.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sweep_parts(folder)
    parts = {name: part_name(folder / f"{name}.npy") for name in _ARRAYS}
    arrays: dict[str, np.memmap] = {}
    sensors: list[str] = []
    for batch in batches:
        rows = slice(len(sensors), len(sensors) + len(batch["sensor"]))
        for name in _ARRAYS:
            values = batch[name].numpy()
            if name not in arrays:
                shape = (count, *values.shape[1:])
                arrays[name] = np.lib.format.open_memmap(parts[name], "w+", np.uint8, shape)
            arrays[name][rows] = values
        sensors += batch["sensor"]
        yield batch
    # only now: a stopped pass leaves parts, which the next one sweeps
    for name, array in arrays.items():
        array.flush()
        parts[name].replace(folder / f"{name}.npy")
    # last: the clips count as stored by this file
    write_text(folder / "sensors.json", json.dumps(sensors))
