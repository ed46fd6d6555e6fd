"""Trials: recordings of one take by their names, such as those of two sensors."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from tactileforge.reading.sides import SIDE_WORDS
from tactileforge.specs.published import SPECS

#: Beginning and end of a word in a name.
_BEGIN, _END = r"(?<![^\W\d_])", r"(?![^\W\d_])"
# a finger with a number is a device: without its word, the number would join the one before
_SIDE = re.compile(
    rf"[-_. ]?{_BEGIN}(?!finger[-_. ]?\d)(?:{SIDE_WORDS.pattern}){_END}", re.IGNORECASE
)
_REPEAT = re.compile(
    rf"[-_. ]?{_BEGIN}(?:rep|repeat|repetition|try|attempt)[-_. ]?\d+", re.IGNORECASE
)
#: A part of a name that is a trial of its own, whatever follows.
TRIAL = re.compile(
    r"(?:trial|take|episode|ep|demo|grasp|traj|trajectory|rollout)[-_. ]?\d+", re.IGNORECASE
)
#: A numbered sensor or camera, and a type of sensors.
_SENSORS = "|".join(sorted(SPECS, key=len, reverse=True))
_SENSORS += "|(?:gel[-_. ]?sight|gs)(?:[-_. ]?mini)?|dm[-_. ]?tac|9dtact|tac3d|wedge|geltip"
#: Words of versions of the same pictures.
VERSIONS = {
    *("raw", "processed", "preprocessed", "original", "orig", "cropped", "resized", "compressed"),
    *("rectified", "rectify", "undistorted", "filtered", "augmented"),
}
_DEVICES = (
    re.compile(
        rf"[-_. ]?{_BEGIN}(?:cam|camera|sensor|finger|gel|gelsight|digit|tac|tactile|device|ch|"
        r"channel|port|gripper|hand|arm)[-_. ]?\d(?!\d)",
        re.IGNORECASE,
    ),
    re.compile(rf"[-_. ]?{_BEGIN}(?:{_SENSORS}){_END}", re.IGNORECASE),
    # serial numbers of DIGIT
    re.compile(rf"[-_. ]?{_BEGIN}D\d{{5}}(?!\d)", re.IGNORECASE),
    re.compile(rf"[-_. ]?{_BEGIN}(?:{'|'.join(sorted(VERSIONS))}){_END}", re.IGNORECASE),
)
#: Largest number of numbered devices or channels of a trial, and of trials for words to be
#: channels.
_MOST, _FEWEST = 6, 3


def trial_of(name: str) -> str:
    """The trial of a recording, by its name alone: without sides, repetitions and folders below.

    Args:
        name: Path of a recording, without its ending; slashes separate folders.

    Example:
        >>> trial_of("day1/trial_007/left"), trial_of("mug_3_right"), trial_of("mug_3")
        ('day1/trial_007', 'mug_3', 'mug_3')
    """
    parts = name.split("/")
    for place, part in enumerate(parts):
        if found := TRIAL.match(part):
            return _plain("/".join([*parts[:place], found[0]]))
    return _plain(name)


def _plain(name: str) -> str:
    """A name without sides and repetitions; unchanged if nothing is left."""
    return _tidy(_REPEAT.sub("", _SIDE.sub("", name))) or name


def _tidy(name: str) -> str:
    return "/".join(part for one in name.split("/") if (part := one.strip("-_. ")))


def trials_of(
    names: Sequence[str], spans: Mapping[str, tuple[float, float]] = MappingProxyType({})
) -> list[str]:
    """The trials of the recordings of a data set, each held out as a whole.

    Beyond `trial_of`, these share one: recordings that differ only by the number of a device, the
    type of a sensor, or a version of the pictures (``raw``, ``cropped``), the same few words in
    each of several numbered folders, and recordings of one folder at overlapping times.

    Args:
        names: Paths of the recordings, without their endings.
        spans: Times of the first and last frame of recordings with dates, s.

    Example:
        >>> trials_of(["1/cam0", "1/cam1", "2/cam0", "2/cam1"])
        ['1', '1', '2', '2']
    """
    trials = [trial_of(name) for name in names]
    for pattern in _DEVICES:
        trials = _without(pattern, trials)
    folders: dict[str, dict[str, str]] = {}
    for name, trial in zip(names, trials, strict=True):
        if trial == name:
            above, _, last = name.rpartition("/")
            folders.setdefault(above, {})[name] = last
    words = [frozenset(ours.values()) for above, ours in folders.items() if _is_numbered(above)]
    joined: dict[str, str] = {}
    for above, ours in folders.items():
        own = frozenset(ours.values())
        is_channels = (
            _is_numbered(above)
            and 2 <= len(own) <= _MOST
            and not any(map(_is_numbered, own))
            and words.count(own) >= max(_FEWEST, len(own), len(words) / 2)
        )
        if is_channels:
            joined |= dict.fromkeys(ours, above)
        else:
            joined |= _at_once({name: spans[name] for name in ours if name in spans})
    return [joined.get(name, trial) for name, trial in zip(names, trials, strict=True)]


def _without(pattern: re.Pattern[str], names: Sequence[str]) -> list[str]:
    """Names without a device, if most of the remaining ones agree."""
    found = {name: match for name in names if (match := pattern.search(name))}
    short = {
        name: _tidy(name[: match.start()] + name[match.end() :]) for name, match in found.items()
    }
    devices: dict[str, set[str]] = {}
    for name, match in found.items():
        devices.setdefault(short[name], set()).add(match[0].strip("-_. ").lower())
    count = len(set().union(*devices.values()))
    shared = sum(len(own) > 1 for own in devices.values())
    # more trials than devices: numbers of takes would be in few folders
    if "" in devices or not 2 <= count <= min(_MOST, len(devices)) or 2 * shared < len(devices):
        return list(names)
    return [short.get(name, name) for name in names]


def _is_numbered(name: str) -> bool:
    return any(letter.isdecimal() for letter in name.rpartition("/")[2])


def _at_once(spans: Mapping[str, tuple[float, float]]) -> dict[str, str]:
    """One name for recordings overlapping in time, by each of them."""
    out: dict[str, str] = {}
    first, end = "", float("-inf")
    for name, (start, stop) in sorted(spans.items(), key=lambda item: item[1]):
        if start >= end:
            first = name
        out[name], end = first, max(stop, end)
    return out
