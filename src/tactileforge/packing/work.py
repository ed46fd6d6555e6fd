"""Makes one shard of its recordings, and notes what is in it.

Processes that do this import no torch.
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
from tactileforge.files import sealed, sha256, unsealed, write_text
from tactileforge.packing.options import PackOptions
from tactileforge.packing.packer import Packer
from tactileforge.packing.statistics import PackStatistics

#: Folder, beside the shards, of what is known of each: a run that was stopped goes on from there.
NOTES = ".pack"


@dataclass(frozen=True)
class ShardJob:
    """The recordings and options of one shard.

    Attributes:
        number: Number of the shard in the run.
        path: The shard.
        split: ``train`` or ``val``.
        recordings: Its recordings, in order.
        frames: Number of their frames.
        digest: Names the recordings and what is done with them.
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
        digest: Of the job that made it.
        entry: For the index; None where nothing was left to pack.
        statistics: Statistics of its recordings.
    """

    digest: str
    entry: IndexEntry | None
    statistics: PackStatistics

    @classmethod
    def of(cls, job: ShardJob) -> ShardNote | None:
        """Reads the note of an earlier run; None where the shard must be made (again)."""
        try:
            plain = unsealed(_note_path(job.path).read_bytes())
            row = plain["entry"]
            entry = None if row is None else IndexEntry.from_json(row)
            note = cls(plain["digest"], entry, PackStatistics.from_json(plain["statistics"]))
            is_there = entry is None or sha256(job.path) == entry.sha256
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return note if is_there and note.digest == job.digest else None

    def save(self, path: Path) -> None:
        """Writes it down for a shard."""
        plain = {
            "digest": self.digest,
            "entry": None if self.entry is None else self.entry.to_json(),
            "statistics": self.statistics.to_json(),
        }
        write_text(_note_path(path), sealed(plain))


def _note_path(shard: Path) -> Path:
    return shard.parent / NOTES / f"{shard.stem}.json"


def packed_job(job: ShardJob) -> bytes:
    """A job as bytes, for another process.

    Raises:
        DataError: Its frames cannot be pickled.
    """
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise DataError(_NO_PICKLE.format(job.path.name, error)) from error


def run_packed(job: bytes, tick: Callable[[int, int], None]) -> ShardNote:
    """`make_shard`, of a job that comes from another process."""
    try:
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
    """Makes a shard, and writes its note.

    Args:
        job: The shard to make.
        tick: Is told the job's number, and how many frames of it are done.

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
        except Exception as error:
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
