"""Rows of one table for all recordings, each with the name or number of its recording."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import PurePosixPath
from typing import TypeAlias
from unicodedata import normalize

from tactileforge.reading.sides import SIDE_WORDS
from tactileforge.reading.text_tables import is_number
from tactileforge.reading.trials import trial_of
from tactileforge.reading.written_names import ENDING, by_ends

_NUMBERED = re.compile(r".*?(\d+)")
_WORD = re.compile(r"\d+|[^\W\d_]+")
#: Words for a recording, in names and in headers of columns.
RECORDING_WORDS = (
    "episode|trial|sequence|seq|recording|take|video|touch|clip|grasp|press|run|rep|repetition|demo"
)
_COUNTED = re.compile(RECORDING_WORDS)

#: Words of a name, numbers without leading zeros.
Words: TypeAlias = tuple[str, ...]


def recordings_of(cells: Iterable[str], names: Sequence[str]) -> Mapping[str, Sequence[str]]:
    """Recordings by the cells of a column; unknown and ambiguous cells are left out.

    A cell is the path of a recording, the end of it or its name, with or without the ending, or
    that of a folder with one recording, or with those of several sensors (``left``, ``right``);
    or, where all cells are whole numbers, the number at the end of such a name. Several words
    name what has them in this order, whatever parts them: ``mug/3`` is ``mug/03``, ``mug_03`` and
    ``mug-take3``.

    Example:
        >>> recordings_of(["mug", "bolt"], ["left/mug", "left/bolt.mp4"])
        {'mug': ['left/mug'], 'bolt': ['left/bolt.mp4']}
        >>> recordings_of(["3", "10"], ["trial_003", "trial_010"])
        {'3': ['trial_003'], '10': ['trial_010']}
        >>> recordings_of(["t0"], ["t0/left.mp4", "t0/right.mp4", "t1/left.mp4"])
        {'t0': ['t0/left.mp4', 't0/right.mp4']}
        >>> recordings_of(["mug/3", "bolt/3"], ["mug_03.mp4", "bolt_03.mp4", "bolt_13.mp4"])
        {'mug/3': ['mug_03.mp4'], 'bolt/3': ['bolt_03.mp4']}
    """
    written = [*dict.fromkeys(cells)]
    titles = {name: [name] for name in names}, _folders(names)
    bare = ((str(PurePosixPath(name).with_suffix("")), [name]) for name in names if name != ".")
    named = by_ends([*titles[0].items(), *bare]), by_ends(titles[1].items())
    told = {
        cell: found
        for cell in written
        if (text := cell.replace("\\", "/").removeprefix("./").rstrip("/"))
        and (found := named[0].get(text) or named[1].get(text))
    }
    if not all(map(str.isdecimal, written)):
        for cell in written:
            is_words = cell not in told and not is_number(cell)
            if is_words and (members := _by_words(cell, tuple(names))):
                told[cell] = members
        return told
    if told:
        return told
    for one in titles:
        numbers: dict[int, list[str]] = {}
        for title, members in one.items():
            if match := _NUMBERED.fullmatch(PurePosixPath(title).stem):
                number = int(match[1])
                numbers[number] = [] if number in numbers else members
        if told := {cell: numbers[int(cell)] for cell in written if numbers.get(int(cell))}:
            return told
    return {}


def _by_words(cell: str, names: tuple[str, ...]) -> list[str] | None:
    """The recordings named by at least two words; None for none, or others than of one trial."""
    words = _words(ENDING.sub("", cell))
    if len(words) < 2:
        return None
    for sought in dict.fromkeys((words, _short(words))):
        for is_several, index in _indices(names):
            if sought in index and (index[sought] or is_several):
                return index[sought]
    return None


@lru_cache(maxsize=2)
def _indices(names: tuple[str, ...]) -> list[tuple[bool, dict[Words, list[str] | None]]]:
    """Recordings by ends of paths, then by words within: of names, of trials and of folders."""
    trials: dict[str, list[str]] = {}
    for name in names:
        trials.setdefault(trial_of(ENDING.sub("", name)), []).append(name)
    own = {ENDING.sub("", name): [name] for name in names}
    return [
        (titles is not own, _index(titles, part, is_short))
        for part in (_ends, _runs)
        for titles in (own, trials, _folders(names))
        for is_short in (False, True)
    ]


def _index(
    titles: Mapping[str, list[str]], part: Callable[[list[Words]], Iterable[Words]], is_short: bool
) -> dict[Words, list[str] | None]:
    """Members of titles by parts of their words; None for a part of several titles."""
    found: dict[Words, list[str] | None] = {}
    whole: dict[Words, list[str] | None] = {}
    for title, members in titles.items():
        inside = [_words(one) for one in title.split("/")]
        parts = [_short(words) for words in inside] if is_short else inside
        for words in {*part(parts)}:
            found[words] = members if found.get(words, members) == members else None
        words = tuple(word for one in parts for word in one)
        whole[words] = members if whole.get(words, members) == members else None
    return found | whole


def _ends(parts: list[Words]) -> Iterable[Words]:
    return (sum(parts[start:], ()) for start in range(len(parts)))


def _runs(parts: list[Words]) -> Iterable[Words]:
    """Runs of words; one of only numbers may be a date."""
    words: Words = sum(parts, ())
    for start in range(len(words)):
        for stop in range(start + 2, len(words) + 1):
            if not all(map(str.isdecimal, words[start:stop])):
                yield words[start:stop]


def _words(text: str) -> Words:
    found = _WORD.findall(normalize("NFC", text).casefold())
    return tuple(str(int(word)) if word.isdecimal() else word for word in found)


def _short(words: Words) -> Words:
    """Words without those for a recording before its number."""
    after = (*words[1:], "")
    return tuple(
        word
        for word, following in zip(words, after, strict=True)
        if not (following.isdecimal() and _COUNTED.fullmatch(word))
    )


def _folders(names: Iterable[str]) -> dict[str, list[str]]:
    """The recordings of each folder with one, or with those of several sensors."""
    found: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        for folder in PurePosixPath(name).parents:
            found.setdefault(str(folder), []).append(name)
    sides = {
        folder: [PurePosixPath(name).stem.lower() for name in inside]
        for folder, inside in found.items()
    }
    return {
        folder: inside
        for folder, inside in found.items()
        if folder != "."
        and (
            len(inside) == 1
            # each once: those of several takes lie deeper
            or (
                len({*sides[folder]}) == len(inside)
                and all(map(SIDE_WORDS.fullmatch, sides[folder]))
            )
        )
    }
