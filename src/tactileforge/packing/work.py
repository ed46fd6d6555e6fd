"""Makes one shard: recordings are decoded, filtered, encoded and written.

Processes that do this import no torch.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, Recording
from tactileforge.data.shards import shards
from tactileforge.data.shards.index import IndexEntry
from tactileforge.errors import DataError
from tactileforge.files import sealed, sha256, unsealed, write_text
from tactileforge.packing import filters
from tactileforge.packing.options import PackOptions
from tactileforge.packing.statistics import PackStatistics

#: Folder, beside the shards, of what is known of each: a run that was stopped goes on from there.
NOTES = ".pack"
#: Frames that are decoded at once.
_CHUNK = 16
#: Frames of a recording that may be unreadable; with more, all of it is.
_MAX_FRAMES = 8

#: Reads frames by number: arrays (n, H, W, 3), or encoded images.
Fetch: TypeAlias = Callable[[Sequence[int]], Sequence[Any] | NDArray[np.uint8]]


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
        packer = _Packer(recording, job.options)
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
        if made is not None:
            statistics.add(made[0])
            yield made[1]
        elif not packer.bad:
            statistics.emptied += 1


class _Packer:
    """Packs one recording."""

    def __init__(self, recording: Recording, options: PackOptions) -> None:
        self.recording = recording
        self.options = options
        self.read = 0
        self.bad: list[str] = []

    def pack(self, tick: Callable[[int], None]) -> tuple[Recording, shards.Packed] | None:
        """The recording as it is kept, and its images; None where the filter leaves nothing."""
        whole = self.recording
        rows, frames = self._frames(tick)
        if not rows:
            return None
        recording = _with_rows(whole, rows)
        packed = shards.Packed(
            shards.describe_recording(recording),
            self.options.codec,
            frames,
            self._all(whole.no_contact),
            self._all(whole.image),
            [] if recording.surface is None else _lossless(recording.surface),
        )
        return recording, packed

    def _frames(self, tick: Callable[[int], None]) -> tuple[list[int], list[bytes]]:
        """Numbers of the frames that are kept, and the frames."""
        options, whole = self.options, self.recording
        wanted = filters.sample_in_time(whole.times, options.filter.every).tolist()
        threshold = options.filter.threshold(whole.sensor)
        if threshold is None or len(wanted) == 1:
            shown = self._read(self._fetch(whole.frames), wanted, tick)
        else:
            shown = self._read(whole.frames.read, wanted, tick)
            span = filters.reach(whole.times[wanted], options.filter.span)
            shown = filters.only_lively(shown, whole.times, threshold, span)
        rows, encoded = [], []
        for row, frame in shown:
            rows.append(row)
            encoded.append(self._encoded(frame))
        return rows, encoded

    def _read(
        self, fetch: Fetch, rows: Sequence[int], tick: Callable[[int], None]
    ) -> Iterator[tuple[int, Any]]:
        """Frames with their numbers, a chunk at a time; a few may be unreadable."""
        for start in range(0, len(rows), _CHUNK):
            chunk = rows[start : start + _CHUNK]
            try:
                frames = fetch(chunk)
            except DataError:
                for row in chunk:
                    yield from self._one(fetch, row)
            else:
                self.read += len(chunk)
                yield from zip(chunk, frames, strict=True)
            tick(chunk[-1])

    def _one(self, fetch: Fetch, row: int) -> Iterator[tuple[int, Any]]:
        try:
            frames = fetch([row])
        except DataError as error:
            if len(self.bad) == _MAX_FRAMES:
                raise
            self.bad.append(f"{self.recording.key}, frame {row}: {error}")
            return
        self.read += 1
        yield row, frames[0]

    def _all(self, frames: Frames | None) -> list[bytes]:
        """All images of a group, as they are kept."""
        if frames is None:
            return []
        fetch = self._fetch(frames)
        rows = range(len(frames))
        chunks = (rows[start : start + _CHUNK] for start in rows[::_CHUNK])
        return [self._encoded(picture) for chunk in chunks for picture in fetch(chunk)]

    def _fetch(self, frames: Frames) -> Fetch:
        """Reads frames; those of a shard that need not be encoded anew as they lie there."""
        is_same = isinstance(frames, shards.PackedFrames) and frames.codec == self.options.codec
        if not is_same or self.options.quality or _smaller(frames.shape, self.options.size):
            return frames.read
        packed = cast(shards.PackedFrames, frames)
        return lambda rows: [packed.encoded(row) for row in rows]

    def _encoded(self, frame: NDArray[np.uint8] | bytes) -> bytes:
        if isinstance(frame, bytes):
            return frame
        size = _smaller(frame.shape[:2], self.options.size)
        shown: NDArray[np.uint8] = frame
        if size:
            shown = cv2.resize(frame, size[::-1], interpolation=cv2.INTER_AREA)
        return shards.encode_image(shown, self.options.codec, self.options.quality)


def _lossless(frames: Frames) -> list[bytes]:
    """All images of a group that is never shrunk."""
    return [shards.encode_image(image, "png") for image in frames.read(range(len(frames)))]


def _smaller(shape: Sequence[int], size: int | None) -> tuple[int, int] | None:
    """Height and width after shrinking; None where an image stays as it is."""
    shorter = min(shape)
    if size is None or shorter <= size:
        return None
    return round(shape[0] * size / shorter), round(shape[1] * size / shorter)


def _with_rows(whole: Recording, rows: Sequence[int]) -> Recording:
    """A recording of which some frames are left, with their labels; all camera views stay."""
    if len(rows) == len(whole.frames):
        return whole
    seen = whole.image_times
    if whole.image is not None and seen is None and len(whole.image) > 1:
        seen = _view_times(whole.times, len(whole.image))
    return replace(whole.select(rows), image_times=seen)


def _view_times(times: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Times of views that are spread evenly: each is in the middle of the frames it belongs to."""
    frames = len(times)
    middle = (np.arange(count) + 0.5) * frames / count - 0.5
    return np.interp(middle, np.arange(frames), times)
