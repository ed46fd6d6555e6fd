"""Work of packing: one shard from its recordings, with a note on it.

Nothing here imports torch, as each process would take seconds and memory for it.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tactileforge.contracts import Recording
from tactileforge.data.shards import shards
from tactileforge.data.shards.index import IndexEntry
from tactileforge.errors import DataError
from tactileforge.packing.options import PackOptions
from tactileforge.packing.packer import Packer
from tactileforge.packing.statistics import PackStatistics
from tactileforge.util.files import sealed, sha256, unsealed, write_text

#: Folder of the notes, beside the shards: a stopped run continues from them.
NOTES = ".pack"


@dataclass(frozen=True)
class ShardJob:
    """Recordings and options of one shard.

    Attributes:
        number: Number of the shard in the run.
        path: Path of the shard.
        split: ``train`` or ``val``.
        recordings: Recordings, in order.
        frames: Number of frames before filtering.
        digest: Hash of recordings and options.
        options: Options of packing.
    """

    number: int
    path: Path
    split: str
    recordings: Sequence[Recording]
    frames: int
    digest: str
    options: PackOptions


@dataclass(frozen=True)
class ShardNote:
    """Entry and statistics of a finished shard.

    Attributes:
        digest: Digest of the job.
        entry: Row of the index; None for a shard without recordings.
        statistics: Statistics of its recordings.
    """

    digest: str
    entry: IndexEntry | None
    statistics: PackStatistics

    @classmethod
    def of(cls, job: ShardJob) -> ShardNote | None:
        """Read the note of an earlier run; None if the shard has to be made (again)."""
        try:
            plain = unsealed(_note_path(job.path).read_bytes())
            row = plain["entry"]
            entry = None if row is None else IndexEntry.from_json(row)
            note = cls(plain["digest"], entry, PackStatistics.from_json(plain["statistics"]))
            # by its bytes: a shard that was damaged since is made anew
            is_there = entry is None or sha256(job.path) == entry.sha256
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return note if is_there and note.digest == job.digest else None

    def save(self, path: Path) -> None:
        """Write the note of a shard."""
        plain = {
            "digest": self.digest,
            "entry": None if self.entry is None else self.entry.to_json(),
            "statistics": self.statistics.to_json(),
        }
        write_text(_note_path(path), sealed(plain))


def _note_path(shard: Path) -> Path:
    return shard.parent / NOTES / f"{shard.stem}.json"


def packed_job(job: ShardJob) -> bytes:
    """Pickle a job for another process.

    Raises:
        DataError: The frames of a recording cannot be pickled.
    """
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise DataError(_NO_PICKLE.format(job.path.name, error)) from error


def run_packed(job: bytes, tick: Callable[[int, int], None]) -> ShardNote:
    """Unpickle a job of the parent process, and make its shard."""
    try:
        # bytes of the parent process alone, never of a file
        unpickled: ShardJob = pickle.loads(job)
    except (pickle.UnpicklingError, AttributeError, ImportError, TypeError) as error:
        raise DataError(_NO_PICKLE.format("a shard", error)) from error
    return make_shard(unpickled, tick)


_NO_PICKLE = (
    "the recordings of {} cannot be handed to another process ({}): pack.processes=1 packs in "
    "this one"
)


def make_shard(
    job: ShardJob, tick: Callable[[int, int], None] = lambda number, frames: None
) -> ShardNote:
    """Make a shard, and write its note.

    Args:
        job: Job of the shard.
        tick: Callback with the number of the job and of its finished frames.

    Raises:
        OSError: The shard cannot be written.
    """
    statistics = PackStatistics()
    shards.write_shard(job.path, _packed(job, statistics, partial(tick, job.number)))
    if statistics.recordings:
        entry = IndexEntry.of(job.path)
        statistics.bytes = entry.bytes
    else:
        entry = None
        job.path.unlink()
    # after the shard: a note without its shard would be believed by the next run
    note = ShardNote(job.digest, entry, statistics)
    note.save(job.path)
    return note


def _packed(
    job: ShardJob, statistics: PackStatistics, tick: Callable[[int], None]
) -> Iterator[shards.Packed]:
    done = 0
    for recording in job.recordings:
        packer = Packer(recording, job.options)
        try:
            made = packer.pack(lambda frames, done=done: tick(done + frames))  # type: ignore[misc]
        except (DataError, OSError) as error:
            made = None
            packer.bad.append(f"{recording.key}: {error}")
        except Exception as error:  # a bug of a reader: names the recording, and stops the run
            error.add_note(f"while packing {recording.key} for {job.path}")
            raise
        done += len(recording.frames)
        tick(done)
        statistics.read += packer.read
        statistics.damaged += bool(packer.bad)
        statistics.skipped += packer.bad
        if packer.unmarked:
            statistics.unmarked += 1
            statistics.skipped.append(packer.unmarked)
        if made is not None:
            statistics.add(made[0])
            yield made[1]
        elif not packer.bad:
            statistics.emptied += 1
