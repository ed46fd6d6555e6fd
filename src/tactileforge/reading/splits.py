"""Held-out validation parts."""

from __future__ import annotations

import hashlib
from collections.abc import Container, Iterable, Iterator

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, unknown
from tactileforge.reading.trials import trial_of

#: Splits of data sets without one of their own.
SPLITS = ("train", "val")
#: Splits by the names that folders of them have, in lower case.
SPLIT_OF_FOLDER = {
    **dict.fromkeys(("train", "training"), "train"),
    **dict.fromkeys(("val", "valid", "validation", "dev", "eval", "test", "testing"), "val"),
}
#: Units of holding out.
HOLD_OUT = ("take", "object", "time")

#: Smallest number of names of which one is held out, whatever the share.
_FEW = 3
#: Target duration of a held-out block of a recording, s.
_BLOCK_S = 0.5


def check_share(val: float) -> None:
    """Check the share held out for validation.

    Raises:
        ConfigError: It is below 0, or leaves nothing for training.
    """
    if not 0 <= val < 1:
        raise ConfigError(f"val is {val}; give the share that is held out, 0 or more, below 1")


def check_split(split: str) -> None:
    """Check the name of a split.

    Raises:
        ConfigError: It is neither ``train`` nor ``val``.
    """
    if split not in SPLITS:
        raise ConfigError(unknown("split", split, SPLITS))


def is_held_out(name: str, share: float, few: Container[str] = ()) -> bool:
    """Whether a name falls into the held-out share, by its hash: independent of other names.

    Args:
        name: Name of a unit.
        share: Share held out, 0 to 1.
        few: Names held out besides; see `one_of_few`.

    Example:
        >>> names = [f"object {number}" for number in range(1000)]
        >>> sum(is_held_out(name, 0.1) for name in names)
        96
    """
    return name in few or _place(name) < share * 2**64


def held_out_names(names: Iterable[str], share: float) -> frozenset[str]:
    """Names in the held-out share, at least one where three or more are there.

    Args:
        names: Names of units.
        share: Share held out, 0 to 1; 0 holds out none.

    Example:
        >>> sorted(held_out_names(["a", "b", "c"], 0.01))
        ['c']
    """
    known = {*names}
    return frozenset(name for name in known if is_held_out(name, share)) | one_of_few(known, share)


def one_of_few(names: Iterable[str], share: float) -> frozenset[str]:
    """The name to hold out of few, three or more, if `is_held_out` takes none; else none.

    Args:
        names: Names of units, read up to the first that is held out by its hash.
        share: Share held out, 0 to 1; 0 holds out none.

    Example:
        >>> one_of_few(["a", "b", "c"], 0.01)
        frozenset({'c'})
        >>> one_of_few((f"object {number}" for number in range(1000)), 0.1)
        frozenset()
    """
    known = set[str]()
    if share <= 0:
        return frozenset()
    for name in names:
        if is_held_out(name, share):
            return frozenset()
        known.add(name)
    if len(known) < _FEW:
        return frozenset()
    return frozenset([min(known, key=lambda name: (_place(name), name))])


def _place(name: str) -> int:
    # File names that are not UTF-8 hold surrogates, which a plain encoding refuses.
    # `hash` of Python differs from process to process.
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).digest()
    return int.from_bytes(digest[:8], "big")


def held_out(
    recordings: Iterable[Recording], share: float, unit: str, split: str
) -> Iterator[Recording]:
    """Yields the parts of recordings in a split: each whole, or stretches of each."""
    if unit == "time":
        for recording in recordings:
            yield from split_parts(recording, share, split)
        return
    named = [
        (one.object if unit == "object" and one.object else take_of(one), one) for one in recordings
    ]
    held = held_out_names((name for name, _ in named), share)
    yield from (recording for name, recording in named if (name in held) == (split == "val"))


def take_of(recording: Recording) -> str:
    """Name of the take of a recording, common to its sensors and segments; see `trial_of`."""
    if "take" in recording.labels:  # FOLDER/TAKE/SENSOR/SEGMENT
        return "/".join(recording.key.split("/")[:-2]) or recording.key
    if "episode" in recording.labels:
        return str(recording.labels["episode"])
    return trial_of(recording.key.partition("[")[0].partition("#")[0])


def split_parts(recording: Recording, share: float, split: str) -> Iterator[Recording]:
    """Yields the parts of a recording in one side of a split by time.

    Blocks of about half a second, evenly spaced, are held out; the stretches between are for
    training. The two share no frame. A recording too short for a held-out frame is training data.
    """
    count = len(recording.times)
    seconds = float(recording.times[-1] - recording.times[0])

    blocks = max(1, round(seconds * share / _BLOCK_S))
    length = round(count * share / blocks)
    starts = [round((i + 0.5) * count / blocks - length / 2) for i in range(blocks)]
    held_out = [(start, start + length) for start in starts] if length else []
    if split == "val":
        ranges = held_out
    else:
        edges = [0, *(edge for block in held_out for edge in block), count]
        ranges = list(zip(edges[::2], edges[1::2], strict=True))
    yield from (recording.part(start, stop) for start, stop in ranges if stop > start)
