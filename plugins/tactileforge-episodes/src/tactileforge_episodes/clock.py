"""Episodes of a file, and the times of their rows."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import UNITS, check_rising
from tactileforge.errors import ConfigError, DataError
from tactileforge_episodes.map_keys import EpisodeMap, ReadKeys, SplitKeys, TimeKeys
from tactileforge_episodes.names import natural
from tactileforge_episodes.places import Place
from tactileforge_episodes.refs import ArrayRef
from tactileforge_episodes.values import EpisodeArrays

#: Seconds of each unit.
#: Highest plausible rate, rows a second.
_FASTEST = 1e5


def episodes_of(arrays: EpisodeArrays, keys: EpisodeMap, rows: int) -> list[tuple[int, int]]:
    """First row of each episode, and the row after its last.

    Args:
        arrays: Arrays of the file.
        keys: The map.
        rows: Number of rows of the file.

    Raises:
        DataError: The ends fall, or are not those of the rows.
    """
    if not keys.ends:
        return [(0, rows)]
    if keys.ends_are == "rows":
        return [(row, row + 1) for row in range(rows)]
    ref = arrays.find(keys.ends, {})
    if ref is None:
        return [(0, rows)]
    ends = _ends(ref, keys.ends_are, rows)
    # writers leave chunks of zeros out, and numbers begin with them
    whole = keys.ends_are == "numbers" or not ref.lost(0, ref.facts.rows)
    if not whole or ref.is_void:
        raise DataError(f"{ref}: a chunk of the ends of episodes is missing; download it again")
    if ends.dtype.kind not in "iu" or not len(ends):
        raise DataError(f"{ref}: {ends.dtype} {ends.shape}, no ends of episodes; correct the file")
    plain = [int(end) for end in ends]
    if plain[0] < 0 or (np.diff(np.asarray(plain, np.int64)) < 0).any():
        raise DataError(f"{ref}: ends of episodes fall; they are counted from the first row on")
    if plain[-1] != rows:
        raise DataError(f"{ref}: the last episode ends at row {plain[-1]}, but touch has {rows}")
    return list(zip([0, *plain], plain, strict=False))


def _ends(ref: ArrayRef, are: str, rows: int) -> NDArray[Any]:
    """Row after the last of each episode; fractions stay as they are."""
    values = ref.whole().reshape(-1)
    if values.dtype.kind not in "iu" or not len(values):
        return values
    if are == "starts":
        if values[0]:
            raise DataError(f"{ref}: the first episode starts at row {values[0]}; correct the file")
        return np.append(values[1:], rows)
    if are == "lengths":
        return np.cumsum(values)
    if are == "numbers":
        ends = np.append(np.flatnonzero(values[1:] != values[:-1]) + 1, len(values))
        if len(np.unique(values)) != len(ends):
            raise DataError(f"{ref}: the rows of an episode are apart; correct the file")
        return ends
    return values


def splits_of(
    place: Place, keys: SplitKeys, listed: Collection[str], groups: Iterable[str]
) -> dict[str, str]:
    """The split of each group of an episode; "" for none, and {} without any in the file.

    Args:
        place: The file.
        keys: Arrays with the names of those of each split.
        listed: All arrays of the file.
        groups: Names of the groups.

    Raises:
        DataError: An episode is in both, or the names cannot be read.
    """
    said: dict[str, set[str]] = {}
    for split, key in (("train", keys.train), ("val", keys.val)):
        if key in listed:
            names = ArrayRef(place, key).whole().reshape(-1).tolist()
            said[split] = {one.decode() if isinstance(one, bytes) else str(one) for one in names}
    if len(said) == 2 and (both := sorted(said["train"] & said["val"], key=natural)):
        raise DataError(f"{place}: {both[0]} is both in {keys.train} and in {keys.val}; correct it")
    if not said:
        return {}
    other = "" if len(said) == 2 else "val" if "train" in said else "train"
    return {one: next((s for s, names in said.items() if one in names), other) for one in groups}


def rate_of(
    arrays: EpisodeArrays, keys: EpisodeMap, values: Mapping[str, str], given: float | None
) -> float | None:
    """Rows per second: as given, or as the map or the file says; None for unknown.

    Raises:
        DataError: It is not a rate.
    """
    rate = given if given is not None else keys.fps
    if isinstance(rate, ReadKeys):
        rate = arrays.value(rate, values)
    if rate is None:
        return None
    if isinstance(rate, str | list) or not 0 < rate <= _FASTEST:
        raise DataError(f"{arrays.place}: its rate is {rate!r}; give data.fps=... (Hz)")
    return float(rate)


def times_of(
    arrays: EpisodeArrays,
    time: TimeKeys | None,
    values: Mapping[str, str],
    rate: float | None,
    rows: tuple[int, int],
    stamped: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Times of the rows of an episode, s, from 0.

    Args:
        arrays: Its arrays.
        time: Where they are; None for those of the format, else regular ones.
        values: Values of placeholders.
        rate: Rows per second; None for unknown.
        rows: First row, and the one after the last.
        stamped: Times of all rows that the format has, s; None for none.

    Raises:
        ConfigError: The rate is needed, and not known.
        DataError: Times are not numbers, or do not rise.
    """
    ref = None if time is None else arrays.find(time.array, values)
    if time is None and stamped is not None:
        own: NDArray[np.float64] = stamped[rows[0] : rows[1]] - stamped[rows[0]]
        return own
    if time is None or ref is None:
        return np.arange(rows[1] - rows[0]) / _needed(rate, arrays, "has no times")
    if lost := ref.lost(*rows):
        raise DataError(f"{ref}: the chunk with the time of row {lost[0]} is missing; download it")
    found = ref.rows(range(*rows), ahead=True).reshape(rows[1] - rows[0], -1)
    if found.dtype.kind not in "iuf" or found.shape[1] != 1:
        raise DataError(f"{ref}: {found.dtype} {ref.facts.shape} are not times; correct the map")
    whole = found.dtype.kind in "iu"
    first = found[0, 0]
    seconds: NDArray[np.float64] = (found[:, 0] - first).astype(np.float64)
    if time.unit == "frames" or (time.unit == "numbers_or_s" and whole):
        seconds /= _needed(rate, arrays, f"counts frames in {ref.key}")
    else:
        seconds *= UNITS.get(time.unit, 1.0)
    steps = np.diff(seconds)
    if not np.isfinite(seconds).all() or (steps <= 0).any():
        row = int(np.flatnonzero(~(steps > 0))[0]) + 1 if len(steps) else 0
        single = found.dtype.itemsize < 8 and not whole and abs(float(first)) > 1e6
        why = "; float32 has no place for such times" if single else ""
        raise DataError(
            f"{ref}: times do not rise at row {rows[0] + row} ({found[max(0, row - 1), 0]}, then "
            f"{found[row, 0]}){why}; leave `times` out of the map and give data.fps, or "
            "correct them"
        )
    return seconds


def times_beside(
    arrays: EpisodeArrays, own: TimeKeys, frames: TimeKeys | None, values: Mapping[str, str]
) -> NDArray[np.float64]:
    """Times of rows with a clock of their own, s after the first frame.

    Args:
        arrays: Arrays of the episode.
        own: Times of the rows.
        frames: Times of the frames, by the same clock.
        values: Values of placeholders.

    Raises:
        DataError: There are no such times, they do not rise, or frames have none.
    """
    refs = [None if keys is None else arrays.find(keys.array, values) for keys in (own, frames)]
    if refs[0] is None or refs[1] is None or frames is None:
        raise DataError(
            f"{arrays.place}: force has times of its own ({own.array}), and "
            f"{'frames have none' if refs[0] else 'they are not there'}; correct the map"
        )
    times, first = refs[0].rows(range(refs[0].facts.rows)).reshape(-1), refs[1].rows([0])
    zero = first.reshape(-1)[0]
    if own.unit == frames.unit and times.dtype.kind == zero.dtype.kind == "i":
        seconds: NDArray[np.float64] = (times - zero).astype(np.float64)
        seconds *= UNITS.get(own.unit, 1.0)
    else:
        seconds = times.astype(np.float64) * UNITS.get(own.unit, 1.0)
        seconds = seconds - float(zero) * UNITS.get(frames.unit, 1.0)
    check_rising(seconds, str(refs[0]), "correct them, or leave the force out of the map", "row")
    return seconds


def _needed(rate: float | None, arrays: EpisodeArrays, why: str) -> float:
    if rate is None:
        raise ConfigError(f"{arrays.place}: {why}; give its rate: data.fps=... (Hz)")
    return rate
