"""Allocation of recordings to shards; decodes nothing."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from inspect import signature
from itertools import chain, groupby
from pathlib import Path

import numpy as np

from tactileforge.checks.doubts import Doubts
from tactileforge.contracts import Dataset, Recording
from tactileforge.data.frames.stamp import stamp_of
from tactileforge.data.labels.plausible import impossible
from tactileforge.data.shards import shards
from tactileforge.data.shards.index import sort_recordings
from tactileforge.errors import DataError
from tactileforge.packing.options import PackOptions
from tactileforge.packing.work import ShardJob

SPLITS = ("train", "val")


@dataclass(frozen=True)
class PackPlan:
    """The jobs of a run of packing.

    Attributes:
        jobs: Job of each shard.
        skipped: Line for each recording the reader could not open, by split.
        recordings: Number of recordings to pack.
        digest: Hash of all recordings and options.
        notes: Line for each kind of doubt about the recordings.
    """

    jobs: list[ShardJob]
    skipped: dict[str, list[str]]
    recordings: int
    digest: str
    notes: list[str] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of frames before filtering."""
        return sum(job.frames for job in self.jobs)


def plan_pack(dataset: Dataset, out: Path, options: PackOptions) -> PackPlan:
    """Sort the recordings of a data set, and deal them to shards.

    Args:
        dataset: Data set to pack.
        out: Folder of the shards.
        options: Options of packing.

    Raises:
        DataNotFoundError: Data is missing; see `contracts.Dataset.recordings`.
        DataError: There is no training data, two recordings have one key, or times do not fit the
            frames.
    """
    by_split: dict[str, list[Recording]] = {}
    skipped: dict[str, list[str]] = {}
    for split in SPLITS:
        before = Counter(dataset.skipped)
        by_split[split] = list(dataset.recordings(split))
        # as a difference of counts: a mixture of data sets orders its lines by data set
        skipped[split] = list((Counter(dataset.skipped) - before).elements())
    if not by_split["train"]:
        held_out = len(by_split["val"])
        raise DataError(
            f"all {held_out} recordings are held out for validation: give "
            f"{'data.val=0, or ' if 'val' in signature(type(dataset)).parameters else ''}more data"
            if held_out
            else "the data set has no recording for training; check the path of its data"
        )
    _check(by_split)
    jobs: list[ShardJob] = []
    for split, recordings in by_split.items():
        dealt = deal(sort_recordings(recordings), options.shard_frames)
        for number, members in enumerate(dealt):
            path = out / f"{split}-{number:06d}.tar"
            frames = sum(len(recording.frames) for recording in members)
            digest = _digest(members, path.name, options)
            jobs.append(ShardJob(len(jobs), path, split, members, frames, digest, options))
    # of all shards, so that a recording which moved from one to another changes it
    whole = hashlib.sha256("".join(job.digest for job in jobs).encode()).hexdigest()
    doubts = Doubts()
    for recording in chain.from_iterable(by_split.values()):
        doubts.add(recording)
    # labels only: frames are decoded by the workers, which a damaged file may take down
    told = [*doubts.of_each(), *doubts.of_all({"force"})]
    notes = [*getattr(dataset, "notes", ()), *told]
    return PackPlan(jobs, skipped, sum(map(len, by_split.values())), whole, notes)


def deal(recordings: Sequence[Recording], frames: int) -> Iterator[list[Recording]]:
    """Deal recordings to shards of at most ``frames`` frames.

    Touches of one object stay together, unless they alone have more frames.

    Args:
        recordings: Recordings in the order of `sort_recordings`.
        frames: Largest number of frames of a shard; a longer recording has its own shard.
    """
    shard: list[Recording] = []
    count = 0
    # a recording without an object is alone, by its key, which may be the name of an object
    for _, group in groupby(
        recordings,
        key=lambda recording: (recording.object is None, recording.object or recording.key),
    ):
        together = list(group)
        length = sum(len(recording.frames) for recording in together)
        pieces = [together] if length <= frames else [[recording] for recording in together]
        for piece in pieces:
            more = sum(len(recording.frames) for recording in piece)
            if shard and count + more > frames:
                yield shard
                shard, count = [], 0
            shard += piece
            count += more
    if shard:
        yield shard


def _check(by_split: dict[str, list[Recording]]) -> None:
    seen: dict[str, str] = {}
    for split, recordings in by_split.items():
        for number, recording in enumerate(recordings):
            place = (
                f"number {number} of {split} ({recording.sensor}, {len(recording.frames)} frames)"
            )
            if recording.key in seen:
                raise DataError(
                    f"two recordings are called {recording.key!r}: {seen[recording.key]} and "
                    f"{place}; give each a key of its own"
                )
            seen[recording.key] = place
            if len(recording.times) != len(recording.frames):
                raise DataError(
                    f"{recording.key}: {len(recording.frames)} frames and {len(recording.times)} "
                    "times; correct its reader"
                )
            if wrong := impossible(recording):
                raise DataError(wrong)
            if not (np.diff(recording.times) > 0).all():
                raise DataError(f"{recording.key}: its times do not increase; correct its reader")


def _digest(recordings: Sequence[Recording], file: str, options: PackOptions) -> str:
    # of descriptions and stamps of files, as a hash of the pixels would decode all of them
    digest = hashlib.sha256(json.dumps([file, options.content()], sort_keys=True).encode())
    for recording in recordings:
        pictures = recording.frames, recording.no_contact, recording.image, recording.surface
        content = [
            shards.describe_recording(recording),
            recording.frames.shape,
            [len(frames or ()) for frames in pictures],
            [stamp_of(frames) for frames in pictures],
        ]
        digest.update(json.dumps(content, sort_keys=True).encode())
    return digest.hexdigest()
