"""Features of a frozen encoder: computed once, kept on disk, mapped into memory."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader, Subset

from tactileforge.contracts import Batch
from tactileforge.data import Clips, Packing, Readers, collate, received, start_worker
from tactileforge.errors import DataError
from tactileforge.plugins import Bar, locked, write_text
from tactileforge_bench.fit import decoded
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.tasks.source import TaskSource, refuse_broken

#: Changes when the same key would give other features.
_FORMAT = 2
#: Mirrored left to right, top to bottom.
Flip: TypeAlias = tuple[bool, bool]
PLAIN: Flip = (False, False)
FLIPS: tuple[Flip, ...] = (PLAIN, (True, False), (False, True), (True, True))
#: What is added to the name of a file of features.
_SUFFIXES = dict(zip(FLIPS, ("", "-h", "-v", "-hv"), strict=True))

Array: TypeAlias = NDArray[np.float16]


@dataclass(frozen=True)
class FeatureStore:
    """Location of features on disk, and options of their extraction.

    Attributes:
        folder: Folder of the features of all models.
        workers: Processes that read clips.
        batch: Clips that are computed at once.
        every: Batches between two notes of how far it got.
    """

    folder: Path
    workers: int = 2
    batch: int = 32
    every: int = 16


def extract_features(
    store: FeatureStore,
    subject: FrozenEncoder,
    source: TaskSource,
    clips: NDArray[np.int64],
    taps: Sequence[str],
    flips: Sequence[Flip] = (PLAIN,),
    policy: str = "error",
) -> dict[tuple[str, Flip], Array]:
    """Features of some clips of a source; what is on disk already is not computed again.

    They are float16, and only mapped: memory does not grow with the number of clips. A stopped
    extraction goes on where it was, and of two processes that need the same one computes it.

    Args:
        store: Location of the features.
        subject: The encoder.
        source: The clips.
        clips: Places of the clips to read.
        taps: ``projected``, ``tokens``.
        flips: Mirror images to read.
        policy: Policy for an unknown sensor: ``error`` or ``universal``.

    Returns:
        By tap and flip, float16 (n, ...), in the order of ``clips``.

    Raises:
        DataError: A clip cannot be read, or a feature is not finite.
        ConfigError: The model does not know a sensor.
    """
    key = _key(subject, source, clips, policy)
    wanted = {
        (tap, flip): store.folder / key / f"{tap}{_SUFFIXES[flip]}.npy"
        for tap in taps
        for flip in flips
    }

    def absent() -> dict[tuple[str, Flip], Path]:
        return {what: path for what, path in wanted.items() if not path.is_file()}

    if absent():
        locks = store.folder.parent / "locks"
        (store.folder / key).mkdir(parents=True, exist_ok=True)
        with locked(locks / key):  # another bench may be at it: it is waited for
            if missing := absent():
                _Extraction(store, subject, source, clips, missing, policy).run()
    return {what: np.load(path, mmap_mode="r") for what, path in wanted.items()}


def _key(subject: FrozenEncoder, source: TaskSource, clips: NDArray[np.int64], policy: str) -> str:
    facts = {
        "format": _FORMAT,
        "weights": subject.weights,
        "preprocessing": subject.preprocessing,
        "spacing": subject.spacing_of(source.clip),
        "data": source.fingerprint,
        "clips": hashlib.sha256(clips.tobytes()).hexdigest(),
        "policy": policy,
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:24]


class _Extraction:
    """One pass over the clips, filling several arrays."""

    def __init__(
        self,
        store: FeatureStore,
        subject: FrozenEncoder,
        source: TaskSource,
        clips: NDArray[np.int64],
        paths: Mapping[tuple[str, Flip], Path],
        policy: str,
    ) -> None:
        self.store = store
        self.subject = subject
        self.source = source
        self.paths = paths
        self.policy = policy
        self.readers = list(readers(subject, source, clips))
        self.total = len(clips)
        names = json.dumps(sorted(path.name for path in paths.values()))
        # a pass resumes only one over the same arrays: others are filled to another place
        stem = hashlib.sha256(names.encode()).hexdigest()[:8]
        self.note = next(iter(paths.values())).with_name(f"{stem}.json")

    def run(self) -> None:
        """Fills the arrays, resuming an interrupted pass, and renames them."""
        parts = {what: path.with_suffix(f".{self.note.stem}") for what, path in self.paths.items()}
        done, arrays = 0, dict[tuple[str, Flip], Array]()
        if self.note.is_file() and all(path.is_file() for path in parts.values()):
            done = int(json.loads(self.note.read_text())["done"])
            arrays = {what: np.lib.format.open_memmap(p, "r+") for what, p in parts.items()}
        flips = tuple(dict.fromkeys(flip for _, flip in self.paths))
        groups = any(tap in ("summary", "groups") for tap, _ in self.paths)
        with Bar(
            total=self.total, initial=done, desc=f"features of {self.subject.name}", unit="clip"
        ) as bar:
            for number, (places, batch) in enumerate(self._batches(done), start=1):
                for flip in flips:
                    readings = self.subject.features(batch, flip, self.policy, groups)
                    for what in [what for what in self.paths if what[1] == flip]:
                        values = _half(readings[what[0]], self.subject.name)
                        if what not in arrays:
                            shape = (self.total, *values.shape[1:])
                            arrays[what] = np.lib.format.open_memmap(
                                parts[what], "w+", np.float16, shape
                            )
                        arrays[what][places] = values
                done += len(places)
                bar.update(len(places))
                if number % self.store.every == 0:
                    # flushed first: the note may not count clips that a crash would lose
                    for array in arrays.values():
                        array.flush()  # type: ignore[attr-defined]
                    write_text(self.note, json.dumps({"done": done}))
        for array in arrays.values():
            array.flush()  # type: ignore[attr-defined]
        # unmapped before they are renamed
        arrays.clear()
        for what, path in self.paths.items():
            parts[what].replace(path)
        # the note, and what stopped passes over other sets of arrays have left
        for path in self.note.parent.iterdir():
            if path.suffix != ".npy":
                path.unlink()

    def _batches(self, done: int) -> Iterator[tuple[NDArray[np.int64], Batch]]:
        """Places among the clips, and the clips; the first ``done`` are left out."""
        for clips, places in self.readers:
            skipped = min(done, len(places))
            done -= skipped
            rest = places[skipped:]
            start = 0
            for batch in self._read(clips, range(skipped, len(places))):
                count = len(batch["sensor"])
                yield rest[start : start + count], batch
                start += count

    def _read(self, clips: Clips, rows: range) -> Iterator[Batch]:
        """Batches of some rows, decoded once for all encoders with this form of input."""
        size, spacing = self.store.batch, self.subject.spacing_of(self.source.clip)
        folder = decoded.clip_folder(
            self.store.folder.parent / "clips", self.source, clips, spacing
        )
        # a resumed pass reads no whole set, so it stores none
        if folder is None or rows.start:
            return read_batches(clips, rows, self.store, size)
        batches = decoded.stored_batches(folder, size)
        return batches or decoded.store_batches(
            folder, len(rows), read_batches(clips, rows, self.store, size)
        )


def read_batches(
    clips: Clips, rows: Sequence[int], store: FeatureStore, size: int
) -> Iterator[Batch]:
    """Batches of some rows of an index, in order, read by other processes.

    Raises:
        DataError: Clips cannot be read: training replaces them by others, a bench may not.
    """
    # no row, no worker: a pass that was stopped after its last batch has none to read
    processes = Readers(store.workers if len(rows) else 0)
    loader = DataLoader(
        Subset(clips, list(rows)),
        batch_size=size,
        num_workers=processes.count,
        multiprocessing_context=processes.context,
        collate_fn=Packing(collate),
        worker_init_fn=start_worker,
        pin_memory=torch.cuda.is_available(),
    )
    broken: dict[str, str] = {}
    for batch in received(lambda: iter(loader), processes):
        # after the first of them the others are read to be named together
        broken |= {key: line for key, (line, _) in batch["skipped"].items()}
        if not broken:
            yield batch
    refuse_broken(list(broken.values()))


def readers(
    subject: FrozenEncoder, source: TaskSource, clips: NDArray[np.int64]
) -> Iterator[tuple[Clips, NDArray[np.int64]]]:
    """Groups clips by the size a model reads them at, with their places among all."""
    index = source.index[clips]
    shapes = [subject.size_for(recording.frames.shape) for recording in source.recordings]
    for size in dict.fromkeys(shapes[number] for number in index[:, 0]):
        places = np.flatnonzero([shapes[number] == size for number in index[:, 0]])
        frames, spacing = subject.frames, subject.spacing_of(source.clip)
        reader = Clips(source.recordings, frames, spacing, source.clip.span, size, image_size=8)
        reader.index = index[places].astype(np.int32)
        yield reader, places


def _half(values: torch.Tensor, name: str) -> Array:
    out: Array = values.to(torch.float16).cpu().numpy()
    if not np.isfinite(out).all():
        raise DataError(
            f"model {name}: features that are not finite, or beyond 65504 and so no float16; its "
            "weights are damaged, or its training diverged"
        )
    return out
