"""The order of files by the numbers in their names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from tactileforge.errors import DataError

#: Text and number, alternating, of a name.
Natural: TypeAlias = list[tuple[str, float]]

_WHOLE = re.compile(r"(\D*)(\d*)")
#: A fraction, not part of a version (1.2.3) or of a date (2026.11.25).
_FRACTION = re.compile(r"(?<![\d.])(\d+)\.(\d+)(?!\.?\d)")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
#: From this many consecutive numbers after the point on, 1.1 to 1.10, they are not fractions.
_PARTS = 10


def natural(name: str, fractions: bool = False) -> Natural:
    """A sort key of names by the values of their numbers, 2 before 10.

    Args:
        name: File name, without its folders.
        fractions: Whether numbers with a point are fractions: 8.27 before 8.5.

    Example:
        >>> sorted(["f8.5", "f8.27", "f10"], key=lambda name: natural(name, fractions=True))
        ['f8.27', 'f8.5', 'f10']
    """
    if not fractions:
        return [(text, int(digits or 0)) for text, digits in _WHOLE.findall(name)]
    out: Natural = []
    at = 0
    for found in _FRACTION.finditer(name):
        before = natural(name[at : found.start()])[:-1]  # without the empty end
        last = before.pop() if before and not name[: found.start()][-1:].isdigit() else ("", 0.0)
        out += [*before, (last[0], float(found[0]))]
        at = found.end()
    return out + natural(name[at:])


def has_fractions(stems: Iterable[str]) -> bool:
    """Whether points in names mark fractions (8.05, 8.5), not parts (1.9, 1.10)."""
    names = list(stems)
    parts: dict[tuple[str, str], set[str]] = {}
    is_any = False
    for name in names:
        for found in _FRACTION.finditer(name):
            is_any = True
            parts.setdefault((name[: found.start()], found[1]), set()).add(found[2])
    if not is_any:
        return False
    if max(Counter(map(str, (natural(name, fractions=True) for name in names))).values()) > 1:
        return False  # as fractions, 1.1 and 1.10 would be equal
    for ends in parts.values():
        whole = sorted(int(end) for end in ends)
        counts_up = whole == list(range(whole[0], whole[0] + len(whole))) and whole[0] in (0, 1)
        if len(whole) >= _PARTS and counts_up and not any(e[0] == "0" < e[1:] for e in ends):
            return False
    return True


def name_keys(paths: Iterable[Path]) -> Mapping[Path, tuple[Any, ...]]:
    """Sort keys of the files within each folder.

    If all names of a folder are numbers, these are compared, -1.5 before 0.25; otherwise all
    numbers in the names, one after another.
    """
    folders: dict[Path, list[Path]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path)
    keys: dict[Path, tuple[Any, ...]] = {}
    for files in folders.values():
        fractions = has_fractions({path.stem for path in files})
        is_number = all(_NUMBER.fullmatch(path.stem) for path in files)
        for path in files:
            key = natural(path.name) if not fractions else natural(path.stem, fractions=True)
            keys[path] = ([("", float(path.stem)), *key] if is_number else key, [(path.name, 0)])
    return keys


def name_prefix(stem: str) -> str:
    """The part of a name before its last number or word.

    Example:
        >>> name_prefix("mug_1700000000.033"), name_prefix("mug_2_00012"), name_prefix("00012")
        ('mug', 'mug_2', '')
        >>> name_prefix("trial_0_frames"), name_prefix("frames")
        ('trial_0', '')
    """
    last = r"\d[\d.]*$" if stem[-1:].isdigit() else r"(?:^|[_\-. ])[^_\-. ]*$"
    return re.sub(last, "", stem).rstrip("_-. ")


def name_rest(stem: str) -> str:
    """The part of a name after its first word; "" for a name of one.

    Example:
        >>> name_rest("Left_trial1"), name_rest("video-2_b"), name_rest("trial1")
        ('trial1', '2_b', '')
    """
    return re.sub(r"^[^_\-. ]+[_\-. ]*", "", stem)


def by_pattern(paths: Sequence[Path], pattern: str, layout: str) -> list[Path]:
    """Images sorted by a number in their names, found by a pattern.

    Raises:
        DataError: A name does not match, or two have the same number.
    """
    parts = (re.escape(part).replace(r"\*", ".*?") for part in pattern.split("{number}"))
    wanted = re.compile(r"(-?\d+(?:\.\d+)?)".join(parts))
    numbers: dict[float, Path] = {}
    for path in paths:
        found = wanted.search(path.stem)
        if not found:
            raise DataError(
                f"{path}: no number where order: {pattern!r} of layout {layout!r} looks for one; "
                "correct the pattern, or move the file out"
            )
        other = numbers.setdefault(float(found[1]), path)
        if other != path:
            raise DataError(
                f"{path}: has the number of {other.name} by order: {pattern!r} of layout "
                f"{layout!r}; give a pattern for a number that differs"
            )
    return [numbers[number] for number in sorted(numbers)]


def other_order(paths: Sequence[Path]) -> str:
    """Another plausible order of the images, in words; "" without one.

    It is that of another number counting 1, 2, 3 over all images, or that with points read as
    separators (1.9 before 1.10).
    """
    stems = [path.stem for path in paths]
    if len(stems) < 3:
        return ""
    tokens = [re.findall(r"\d+(?:\.\d+)?", stem) for stem in stems]
    if len({len(row) for row in tokens}) > 1:
        return ""
    for column in zip(*tokens, strict=True):
        if any("." in cell for cell in column):
            continue
        numbers = [int(cell) for cell in column]
        first = min(numbers)
        if first in (0, 1) and sorted(numbers) == list(range(first, first + len(numbers))):
            if numbers == sorted(numbers):
                return ""  # a counter agrees with the order
            place = stems[numbers.index(first)]
            return f"by the number that counts {first} to {max(numbers)}, {place!r} is the first"
    found = [end for stem in stems for _, end in _FRACTION.findall(stem)]
    if not has_fractions(stems) or any(end[0] == "0" and end != "0" for end in found):
        return ""  # no fractions; or 8.05, unambiguous with its leading zero
    turned = sorted(stems, key=natural)
    if turned == stems or all(map(_NUMBER.fullmatch, stems)):
        return ""
    i = next(i for i, pair in enumerate(zip(turned, stems, strict=True)) if pair[0] != pair[1])
    return f"with points that are not fractions, {turned[i]!r} comes before {stems[i]!r}"


def order_doubt(paths: Sequence[Path]) -> str:
    """A phrase about an ambiguous order of images; "" without doubt. See `other_order`."""
    other = other_order(paths)
    if not other:
        return ""
    return (
        f"two orders are possible: {paths[0].stem!r} is read first, but {other}; give order: "
        "'f{number}', with the text before the number that counts, or a column"
    )
