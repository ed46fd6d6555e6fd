"""The checks of containers: a format is four methods for the places of values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tactileforge.errors import DataError
from tactileforge.reading.container import MOST_KEYS, Container, Values
from tactileforge.testing.results import Check, CheckSubject, Violation, require

#: Arrays that are looked at, spread over all, and rows of each.
_MOST, _ROWS = 50, 3


def _arrays(subject: CheckSubject) -> Iterator[tuple[str, Values]]:
    """Some arrays with rows, by name."""
    container: Container = subject.instance
    keys = container.keys()
    for key in keys[:: max(1, len(keys) // _MOST)]:
        values = container.array(key)
        if values.facts.shape and values.facts.rows:
            yield key, values


def it_has_the_four_methods(subject: CheckSubject) -> None:
    """`keys`, `array`, `times` and `frames` are there."""
    require(isinstance(subject.instance, Container), "give keys, array, times and frames")


def keys_are_names_in_order(subject: CheckSubject) -> None:
    """Each key once, sorted, with ``/`` between groups, and the same each time."""
    keys = subject.instance.keys()
    require(isinstance(keys, list), f"keys() is {type(keys).__name__}, not a list")
    require(all(isinstance(key, str) and key for key in keys), "a key is not text, or is empty")
    require(keys == sorted(set(keys)), "keys are not sorted, or one is there twice")
    bad = [key for key in keys if key.startswith("/") or key.endswith("/") or "//" in key]
    require(not bad, f"{bad[:1]}: a part of a key is empty")
    require(len(keys) <= MOST_KEYS, f"{len(keys)} keys, where {MOST_KEYS} are the most")
    require(keys == subject.instance.keys(), "keys() gives others the second time")


def arrays_are_as_described(subject: CheckSubject) -> None:
    """Rows have the shape and type of `Facts`, come in the order asked for, and may be none."""
    for key, values in _arrays(subject):
        facts = values.facts
        rows = sorted({0, facts.rows // 2, facts.rows - 1}, reverse=True)[:_ROWS]
        found = values.rows(rows)
        want = (len(rows), *facts.shape[1:])
        require(found.shape == want, f"{key}: rows {rows} are {found.shape}, not {want}")
        require(found.dtype == facts.dtype, f"{key}: {found.dtype}, where {facts.dtype} is said")
        for row, value in zip(rows, found, strict=True):
            one = values.rows([row])
            require(_same(one[0], value), f"{key}: row {row} differs once it is read by itself")
        require(
            values.rows([]).shape == (0, *facts.shape[1:]), f"{key}: no rows have another shape"
        )


def _same(one: Any, other: Any) -> bool:
    a, b = np.asarray(one), np.asarray(other)
    if a.dtype == object or b.dtype == object:
        return bool(np.array_equal(a, b))
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def what_is_not_there_is_a_data_error(subject: CheckSubject) -> None:
    """A missing array, and a row beyond the last, are a `DataError` with their names."""
    missing = "no/such/array"
    for method in ("array", "times", "frames"):
        try:
            getattr(subject.instance, method)(missing)
        except DataError as error:
            require(missing in str(error), f"the error of {method}() does not name it: {error}")
        else:
            raise Violation(f"{method}({missing!r}) is not a DataError")
    for key, values in _arrays(subject):
        try:
            values.rows([values.facts.rows])
        except DataError:
            continue
        raise Violation(f"{key}: row {values.facts.rows} of {values.facts.rows} is not a DataError")


def times_rise(subject: CheckSubject) -> None:
    """Times are None, or float64, one per row, and never fall."""
    for key, values in _arrays(subject):
        times = subject.instance.times(key)
        if times is not None:
            good = times.dtype == np.float64 and times.shape == (values.facts.rows,)
            require(good, f"{key}: times are {times.dtype} {times.shape}, not float64, one per row")
            require(bool((np.diff(times) >= 0).all()), f"{key}: times fall")


def frames_are_pictures(subject: CheckSubject) -> None:
    """Frames are None, or RGB of 8 bits a channel, one per row."""
    for key, values in _arrays(subject):
        frames = subject.instance.frames(key)
        if frames is not None:
            require(len(frames) == values.facts.rows, f"{key}: {len(frames)} frames of its rows")
            found, want = frames.read([len(frames) - 1, 0]), (2, *frames.shape, 3)
            good = found.dtype == np.uint8 and found.shape == want
            require(good, f"{key}: frames are {found.dtype} {found.shape}, not uint8 {want}")


CHECKS: list[Check] = [
    it_has_the_four_methods,
    keys_are_names_in_order,
    arrays_are_as_described,
    what_is_not_there_is_a_data_error,
    times_rise,
    frames_are_pictures,
]
