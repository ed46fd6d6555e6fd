"""Recordings to label, with their marks, proposals and files."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Dataset, Recording
from tactileforge.errors import ConfigError, DataError, TactileForgeError
from tactileforge.pages import difference_image, page_jpeg
from tactileforge.sensors import ContactOptions
from tactileforge_labels.marks import (
    STATES,
    Marks,
    digest_of_file,
    intervals,
    no_marks,
    parse_marks,
    read_marks,
    write_marks,
)
from tactileforge_labels.propose import SlipMotion, imprint, propose

#: End of the key of a part of a recording; see `Recording.part`.
_PART = re.compile(r"\[\d+:\d+\]$")


class ConflictError(TactileForgeError):
    """Another window of the page, or another program, has written the marks meanwhile."""


@dataclass
class Entry:
    """A recording to label.

    Attributes:
        recording: The recording.
        path: CSV of its marks.
        marks: Marks as last written or read.
        revision: Number of the writes so far, to tell windows of the page apart.
        problem: Error of its CSV, which is then left as it is; "" for none.
        proposal: Proposals as plain data, computed on request.
        digest: Digest of the CSV as last written or read; b"" where there was none.
    """

    recording: Recording
    path: Path
    marks: Marks
    revision: int = 0
    problem: str = ""
    proposal: dict[str, Any] = field(default_factory=dict)
    background: NDArray[np.uint8] | None = None
    digest: bytes = b""

    @property
    def labeled(self) -> float:
        """Share of the frames with a label or marked as bad, 0 to 1."""
        return float(((self.marks.state >= 0) | self.marks.bad).mean())


class LabelSession:
    """Recordings of a data set with a CSV each in a folder.

    Args:
        dataset: Data set; all recordings of both splits are listed.
        folder: Folder of the CSVs; they are named by the keys of the recordings.
        contact: Thresholds of contact for proposals.
        slip: Thresholds of slip for proposals.

    Attributes:
        entries: Recordings to label.
        skipped: One line for each recording that cannot be labelled, or file that cannot be read.

    Raises:
        ConfigError: The data set has no recording that can be labelled.
    """

    def __init__(
        self, dataset: Dataset, folder: Path, contact: ContactOptions, slip: SlipMotion
    ) -> None:
        self.folder, self.contact, self.slip = folder, contact, slip
        self.skipped: list[str] = []
        self.entries = self._opened(
            recording for split in ("train", "val") for recording in dataset.recordings(split)
        )
        self.skipped += [line for line in dataset.skipped if line not in self.skipped]
        if not self.entries:
            why = f": {self.skipped[0]}" if self.skipped else ""
            raise ConfigError(f"no recording to label{why}")
        # readers of files are not made for several threads, and a page asks in several
        self._lock = threading.Lock()

    def _opened(self, recordings: Iterable[Recording]) -> list[Entry]:
        entries: dict[Path, Entry] = {}
        for recording in recordings:
            path = csv_path(self.folder, recording.key)
            if _PART.search(recording.key):
                self.skipped.append(
                    f"{recording.key}: a part of a recording; read whole ones, for example by "
                    "hold_out: recording in the layout"
                )
            elif path is None:
                self.skipped.append(f"{recording.key!r}: its key is not a name of a file; left out")
            elif path in entries:
                self.skipped.append(f"{recording.key}: a second recording of this key; left out")
            else:
                entries[path] = _entry(recording, path)
        return list(entries.values())

    def overview(self) -> dict[str, Any]:
        """The recordings as plain data, in order."""
        return {
            "folder": str(self.folder),
            "skipped": self.skipped,
            "recordings": [
                {
                    "key": one.recording.key,
                    "sensor": one.recording.sensor,
                    "frames": len(one.recording.times),
                    "labeled": one.labeled,
                    "problem": one.problem,
                }
                for one in self.entries
            ],
        }

    def marks(self, number: int) -> dict[str, Any]:
        """Marks and times of a recording as plain data."""
        one = self.entries[number]
        times = [round(float(time), 6) for time in one.recording.times]
        return {"times": times, "revision": one.revision, **one.marks.message()}

    def write(self, number: int, message: Any) -> dict[str, Any]:
        """Writes the marks of a recording to its CSV.

        Args:
            number: Number of the recording.
            message: Mapping with ``states`` and ``bad``, see `marks.parse_marks`, and the
                ``revision`` of the marks that were changed.

        Raises:
            DataError: The marks do not fit the recording, or its CSV is damaged.
            ConflictError: They were written in another window, or its CSV by another program,
                meanwhile; the marks of the message are kept beside the CSV.
        """
        one = self.entries[number]
        if not isinstance(message, dict):
            raise DataError("marks are a mapping; reload the page")
        if one.problem:
            raise DataError(one.problem)
        rest = {key: value for key, value in message.items() if key != "revision"}
        marks = parse_marks(rest, len(one.recording.times))
        with self._lock:
            try:
                self._check_conflict(one, message.get("revision"), marks)
                one.digest = write_marks(one.path, marks, one.recording.times)
            except OSError as error:
                raise DataError(f"{one.path}: cannot be written ({error.strerror})") from error
            one.marks, one.revision = marks, one.revision + 1
        return {"revision": one.revision, "labeled": one.labeled, "file": str(one.path)}

    def _check_conflict(self, one: Entry, revision: Any, marks: Marks) -> None:
        """Refuse marks that would undo those of others, which are read; keep the refused ones.

        Raises:
            ConflictError: Marks were written in another window, or by another program, meanwhile.
            OSError: A file cannot be read or written.
        """
        who = "another window has written its marks" if revision != one.revision else ""
        if digest_of_file(one.path) != one.digest:
            who = f"another program has changed {one.path}"
            # read now, so that a page that is loaded again shows what is there
            there = _entry(one.recording, one.path)
            one.marks, one.problem, one.digest = there.marks, there.problem, there.digest
            one.revision += 1
        if who:
            kept = one.path.with_name(f"{one.path.name}.conflict")
            write_marks(kept, marks, one.recording.times)
            raise ConflictError(
                f"{one.recording.key}: {who} meanwhile; reload. Your marks are kept in {kept}"
            )

    def proposal(self, number: int) -> dict[str, Any]:
        """Proposed states of a recording, and the change of each frame, as plain data.

        Raises:
            DataError: A frame cannot be decoded.
        """
        one = self.entries[number]
        with self._lock:
            if not one.proposal:
                one.proposal = self._proposed(one)
        return one.proposal

    def _proposed(self, one: Entry) -> dict[str, Any]:
        background = self._background(one)
        bound = {"begin": self.contact.begin, "states": [], "change": []}
        if background is None:
            return {**bound, "none": "no frames without contact are known, so nothing is proposed"}
        seen = imprint(one.recording, background, self.contact.begin)
        found = propose(seen, one.recording.times, self.contact, self.slip)
        states = [[first, stop, STATES[state]] for first, stop, state in intervals(found)]
        return {**bound, "states": states, "change": seen.change.round(2).tolist(), "none": ""}

    def _background(self, one: Entry) -> NDArray[np.uint8] | None:
        if one.background is None:
            one.background = one.recording.background()
        return one.background

    def picture(self, number: int, frame: int, difference: bool) -> bytes | None:
        """JPEG of a frame, or of its difference from the background; None without one.

        Raises:
            DataError: The frame cannot be decoded.
        """
        one = self.entries[number]
        with self._lock:
            (image,) = one.recording.frames.read([frame])
            if difference:
                background = self._background(one)
                if background is None:
                    return None
                image = difference_image(image, background)
        return page_jpeg(image)


def csv_path(folder: Path, key: str) -> Path | None:
    """Path of the CSV of a recording; None for a key with a path outside the folder.

    Example:
        >>> csv_path(Path("labels"), "cups/a.mp4#left").as_posix()
        'labels/cups/a.mp4#left.csv'
        >>> csv_path(Path("labels"), "../a.mp4") is None
        True
    """
    parts = PurePosixPath(key).parts
    odd = any(part in ("..", "/") or not part.isprintable() or "\\" in part for part in parts)
    return None if odd or not parts else folder.joinpath(*parts[:-1], f"{parts[-1]}.csv")


def _entry(recording: Recording, path: Path) -> Entry:
    """A recording with the marks of its CSV; a damaged CSV is kept, and named."""
    count = len(recording.times)
    if not path.is_file():
        return Entry(recording, path, no_marks(count))
    try:
        # before it is read: a change in between is a conflict later, and not lost
        digest = digest_of_file(path)
        return Entry(recording, path, read_marks(path, count), digest=digest)
    except (DataError, ConfigError) as error:
        return Entry(recording, path, no_marks(count), problem=str(error))
    except OSError as error:
        problem = f"{path}: cannot be read ({error.strerror})"
        return Entry(recording, path, no_marks(count), problem=problem)
