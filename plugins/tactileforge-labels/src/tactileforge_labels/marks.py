"""Marks of a recording: a state per frame, bad frames, and their CSV."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, unknown
from tactileforge.plugins import write_text
from tactileforge.reading import read_cells

#: States of a frame, in the order of their numbers; -1 is a frame without a label.
STATES = ("free", "contact", "slip")
#: Columns of the CSV.
COLUMNS = ("frame", "time", "contact", "slip", "bad")
#: Cells ``contact,slip`` of each state.
_CELLS = {-1: ("", ""), 0: ("0", "0"), 1: ("1", "0"), 2: ("1", "1")}
_NUMBERS = {cells: state for state, cells in _CELLS.items()}


@dataclass(frozen=True)
class Marks:
    """Labels of all frames of a recording.

    Attributes:
        state: int8 (T,), index in `STATES`; -1 for a frame without a label.
        bad: bool (T,), frames to leave out.
    """

    state: NDArray[np.int8]
    bad: NDArray[np.bool_]

    def message(self) -> dict[str, Any]:
        """The marks as intervals, ``[first, stop, name]`` each; see `parse_marks`."""
        states = [[a, b, STATES[s]] for a, b, s in intervals(self.state) if s >= 0]
        return {"states": states, "bad": [[a, b] for a, b, s in intervals(self.bad) if s]}


def no_marks(count: int) -> Marks:
    """Marks of a recording without labels.

    Args:
        count: Number of frames.
    """
    return Marks(np.full(count, -1, np.int8), np.zeros(count, bool))


def intervals(values: NDArray[Any]) -> list[tuple[int, int, int]]:
    """Runs of equal values: first frame, frame after the last, value.

    Example:
        >>> intervals(np.array([0, 0, 1]))
        [(0, 2, 0), (2, 3, 1)]
    """
    edges = np.flatnonzero(np.diff(values.astype(np.int8))) + 1
    starts = [0, *edges.tolist()]
    return [
        (start, stop, int(values[start]))
        for start, stop in zip(starts, [*edges.tolist(), len(values)], strict=True)
        if stop > start
    ]


def parse_marks(message: Any, count: int) -> Marks:
    """Marks from intervals as plain data.

    Args:
        message: Mapping with ``states``, a list of ``[first, stop, name]``, and ``bad``, a list of
            ``[first, stop]``; the frame ``stop`` is not included.
        count: Number of frames of the recording.

    Raises:
        DataError: An interval lies outside the recording, overlaps another, or has an unknown name.

    Example:
        >>> parse_marks({"states": [[1, 3, "slip"]], "bad": [[0, 1]]}, 4).state.tolist()
        [-1, 2, 2, -1]
    """
    if not isinstance(message, Mapping) or set(message) != {"states", "bad"}:
        raise DataError("the marks have no states and bad; reload the page")
    marks = no_marks(count)
    marked = np.zeros(count, bool)
    for first, stop, name in (_interval(row, count, 3) for row in _list(message["states"])):
        if name not in STATES:
            raise DataError(unknown("state", str(name), STATES))
        if marked[first:stop].any():
            raise DataError(f"[{first}, {stop}] overlaps another interval; give each frame one")
        marked[first:stop] = True
        marks.state[first:stop] = STATES.index(name)
    for first, stop, _ in (_interval(row, count, 2) for row in _list(message["bad"])):
        marks.bad[first:stop] = True
    return marks


def _list(rows: Any) -> Sequence[Any]:
    if not isinstance(rows, list):
        raise DataError("intervals are a list; reload the page")
    return rows


def _interval(row: Any, count: int, length: int) -> tuple[int, int, Any]:
    good = isinstance(row, list) and len(row) == length
    if not good or not all(type(frame) is int for frame in row[:2]):
        raise DataError(f"{row!r}: an interval is [first, stop] and a name; reload the page")
    first, stop = row[:2]
    if not 0 <= first < stop <= count:
        raise DataError(
            f"[{first}, {stop}] lies outside the recording, which has {count} frames; give "
            f"0 <= first < stop <= {count}"
        )
    return first, stop, row[2] if length > 2 else None


def write_marks(path: Path, marks: Marks, times: NDArray[np.float64]) -> bytes:
    """Writes a row per frame, beside its place, then renames it.

    Args:
        path: The CSV.
        marks: Marks of the recording.
        times: float64 (T,), times of the frames, s.

    Returns:
        The digest of the file, see `digest_of_file`.
    """
    rows = [",".join(COLUMNS)]
    rows += [
        f"{frame},{time:.6f},{','.join(_CELLS[int(state)])},{int(bad)}"
        for frame, (time, state, bad) in enumerate(zip(times, marks.state, marks.bad, strict=True))
    ]
    text = "\n".join(rows) + "\n"
    write_text(path, text)
    # of what was written, and not of what is there now: another program may have been quicker
    return hashlib.sha256(text.encode()).digest()


def digest_of_file(path: Path) -> bytes:
    """Digest of the content of a file; b"" where there is none.

    Raises:
        OSError: The file cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except FileNotFoundError:
        return b""


def read_marks(path: Path, count: int) -> Marks:
    """Marks of a CSV made by `write_marks`, or of one with its columns except ``time``.

    Args:
        path: The CSV; frames without a row have no label.
        count: Number of frames of the recording.

    Raises:
        DataError: A row contradicts the recording, or has other cells than 0, 1 and empty ones; or
            a file of `write_marks` has lost its end.
        ConfigError: A column is missing.
    """
    marks = no_marks(count)
    seen = np.zeros(count, bool)
    rows = read_cells(path, ["frame", "contact", "slip", "bad"])
    if rows and tuple(rows[0][1]) == COLUMNS and path.read_bytes()[-1:] not in b"\r\n":
        raise DataError(
            f"{rows[-1][0]}: no end of the line, so the file may be cut off; restore it, or end "
            "the line if it is whole"
        )
    for where, cells in rows:
        text = cells["frame"]
        frame = int(text) if text.isascii() and text.isdecimal() else -1
        if not 0 <= frame < count:
            raise DataError(
                f"{where}: frame {text!r} does not exist, the recording has 0 to {count - 1}; "
                "correct the row, or move the file away"
            )
        if seen[frame]:
            raise DataError(f"{where}: frame {frame} has a row already; remove one of them")
        state = _NUMBERS.get((cells["contact"], cells["slip"]))
        if state is None or cells["bad"] not in ("0", "1", ""):
            raise DataError(
                f"{where}: contact, slip and bad are {cells['contact']!r}, {cells['slip']!r} and "
                f"{cells['bad']!r}; give 0 or 1, no slip without contact, or empty cells"
            )
        seen[frame] = True
        marks.state[frame], marks.bad[frame] = state, cells["bad"] == "1"
    return marks
