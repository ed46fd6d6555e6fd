"""Patterns of the files of a guessed layout, and no others beside them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path, PurePath

from tactileforge.reading.guessing.media import Part, names_still, of_endings
from tactileforge.reading.series import common_start

#: Largest number of folders that a pattern names.
_MOST_NAMED = 8
#: Name with a number before its ending.
_COUNTED = re.compile(r"[0-9]\.[^.]*$")


def pattern_of(part: Part, is_listed: bool = False) -> str | list[str]:
    """Pattern of files, with their common folders by name; several where one does not fit."""
    endings = sorted({path.suffix.lower() for path in part.media})
    above = _folders(part)
    patterns = _of_arrays(part.media, above) if endings == [".npy"] else []
    if not patterns:
        names = _names(part, endings, is_listed)
        patterns = [f"{one}{name}" for one in _named(part, above, endings) for name in names]
    return patterns[0] if len(patterns) == 1 else patterns


def _folders(part: Part) -> str:
    """Pattern of the folders of files."""
    paths = [path.relative_to(part.root).parts[:-1] for path in part.media]
    if len({*map(len, paths)}) > 1:
        # of several depths, those that all lie in: others are of another layout
        common = takewhile(lambda column: len({*column}) == 1, zip(*paths, strict=False))
        return "".join(f"{column[0]}/" for column in common) + "**/"
    others = {path.relative_to(part.root).parts[:-1] for path in part.files} - {*paths}
    # a folder by its name where others lie beside it
    return "".join(
        f"{column[0]}/"
        if len({*column}) == 1 and any(len(o) > i and o[i] != column[0] for o in others)
        else "*/"
        for i, column in enumerate(zip(*paths, strict=True))
    )


def _named(part: Part, above: str, endings: Sequence[str]) -> list[str]:
    """Patterns of folders, by their names if other pictures lie beside them."""
    if not above.endswith("*/") or above.endswith("**/"):
        return [above]
    named = {path.parent.name for path in part.media}
    folders = {path.parent.relative_to(part.root) for path in of_endings(part.files, {*endings})}
    depth = above.count("/")
    unlike = {
        folder.name for folder in folders if len(folder.parts) == depth and folder.match(above)
    } - named
    if not unlike or (len(named) > _MOST_NAMED and not any(map(names_still, unlike))):
        return [above]
    return [f"{above.removesuffix('*/')}{name}/" for name in sorted(named)]


def _of_arrays(media: Sequence[Path], above: str) -> list[str]:
    """Pattern of arrays by their one name, or the one end of their names; [] for others."""
    if len({path.name for path in media}) == 1:
        return [f"{above}{media[0].name}"]
    ends = {path.name.rpartition("_")[2] for path in media}
    return [f"{above}*_{ends.pop()}"] if len(ends) == 1 else []


def _names(part: Part, endings: Sequence[str], is_listed: bool) -> list[str]:
    """Patterns of the names of files, and not of others in their folders."""
    own, folders = {*part.media}, {path.parent for path in part.media}
    strangers = [
        path
        for path in of_endings(part.files, {*endings})
        if path.parent in folders and path not in own
    ]
    # a background that is used is not a touch, whatever the pattern is
    is_listed |= any(not names_still(path.stem) for path in strangers)
    found: list[str] = []
    for ending in endings:
        names = [path.name for path in part.media if path.suffix.lower() == ending]
        others = {path.name for path in strangers if path.suffix.lower() == ending}
        apart = _apart(names, others, is_listed) if others else []
        found += apart or [f"*{ending}"]
    return found


def _apart(names: Sequence[str], others: set[str], is_listed: bool) -> list[str]:
    """Patterns of names, and not of others in the same folders; else the names, or none."""
    # numbers count: those that are alike by chance say nothing
    start = common_start(names).rstrip("0123456789")
    stem = common_start([name[::-1] for name in names])[::-1].lstrip("0123456789")
    ending = PurePath(names[0]).suffix
    if len({*names}) > 1 and start and not any(name.startswith(start) for name in others):
        return [f"{start}*{ending}"]
    if len({*names}) > 1 and len(stem) > len(ending) and not any(x.endswith(stem) for x in others):
        return [f"*{stem}"]
    if all(_COUNTED.search(name) for name in names) and not any(map(_COUNTED.search, others)):
        return [f"*[0-9]{ending}"]
    return sorted({*names}) if is_listed else []
