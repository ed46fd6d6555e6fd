"""Which recordings go into which shard; nothing is decoded."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.shards import shards
from tactileforge.data.shards.index import sort_recordings
from tactileforge.errors import DataError
from tactileforge.packing.options import PackOptions
from tactileforge.packing.work import ShardJob

SPLITS = ("train", "val")


@dataclass(frozen=True)
class PackPlan:
    """What is to be packed.

    Attributes:
        jobs: One a shard.
        skipped: What the reader could not open, a line each, by split.
        recordings: How many are to be packed.
        digest: Names all recordings and what is done with them.
    """

    jobs: list[ShardJob]
    skipped: dict[str, list[str]]
    recordings: int
    digest: str

    @property
    def frames(self) -> int:
        """Their frames, before filtering."""
        return sum(job.frames for job in self.jobs)


def plan_pack(dataset: Dataset, out: Path, options: PackOptions) -> PackPlan:
    """Sorts the recordings of a data set, and deals them to shards.

    Args:
        dataset: What to pack.
        out: Folder of the shards.
        options: How.

    Raises:
        DataNotFoundError: Something is missing; see `contracts.Dataset.recordings`.
        DataError: There is nothing to train on, two recordings have one key, or times are not those
            of the frames.
    """
    found: dict[str, list[Recording]] = {}
    skipped: dict[str, list[str]] = {}
    for split in SPLITS:
        before = len(dataset.skipped)
        found[split] = list(dataset.recordings(split))
        skipped[split] = list(dataset.skipped[before:])
    if not found["train"]:
        raise DataError("the data set has no recording for training; check where its data lies")
    _check(found)
    jobs: list[ShardJob] = []
    for split, recordings in found.items():
        dealt = deal(sort_recordings(recordings), options.shard_frames)
        for number, own in enumerate(dealt):
            path = out / f"{split}-{number:06d}.tar"
            frames = sum(len(one.frames) for one in own)
            digest = _digest(own, path.name, options)
            jobs.append(ShardJob(len(jobs), path, split, own, frames, digest, options))
    whole = hashlib.sha256("".join(job.digest for job in jobs).encode()).hexdigest()
    return PackPlan(jobs, skipped, sum(map(len, found.values())), whole)


def deal(recordings: Sequence[Recording], frames: int) -> Iterator[list[Recording]]:
    """Recordings of about so many frames at a time.

    What one object felt stays together, unless that alone is more.

    Args:
        recordings: In the order of `sort_recordings`.
        frames: How many a shard may have; a longer recording has one of its own.
    """
    shard: list[Recording] = []
    held = 0
    for _, group in groupby(
        recordings, key=lambda one: (one.object is None, one.object or one.key)
    ):
        together = list(group)
        length = sum(len(one.frames) for one in together)
        pieces = [together] if length <= frames else [[one] for one in together]
        for piece in pieces:
            more = sum(len(one.frames) for one in piece)
            if shard and held + more > frames:
                yield shard
                shard, held = [], 0
            shard += piece
            held += more
    if shard:
        yield shard


def _check(found: dict[str, list[Recording]]) -> None:
    seen: dict[str, str] = {}
    for split, recordings in found.items():
        for number, one in enumerate(recordings):
            place = f"number {number} of {split} ({one.sensor}, {len(one.frames)} frames)"
            if one.key in seen:
                raise DataError(
                    f"two recordings are called {one.key!r}: {seen[one.key]} and {place}; give "
                    "each a key of its own"
                )
            seen[one.key] = place
            if len(one.times) != len(one.frames):
                raise DataError(
                    f"{one.key}: {len(one.frames)} frames and {len(one.times)} times; correct "
                    "its reader"
                )
            if not (np.diff(one.times) > 0).all():
                raise DataError(f"{one.key}: its times do not increase; correct its reader")


def _digest(recordings: Sequence[Recording], file: str, options: PackOptions) -> str:
    found = hashlib.sha256(json.dumps([file, options.content()], sort_keys=True).encode())
    for one in recordings:
        lengths = [len(frames or ()) for frames in (one.frames, one.no_contact, one.image)]
        found.update(json.dumps([shards.describe_recording(one), lengths], sort_keys=True).encode())
    return found.hexdigest()
