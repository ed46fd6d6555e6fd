"""Formats recognised by the keys of their files."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge_episodes.find import find_files, path_values
from tactileforge_episodes.map_files import preset_names, read_preset
from tactileforge_episodes.map_keys import EpisodeMap
from tactileforge_episodes.names import match
from tactileforge_episodes.places import Place, find_places
from tactileforge_episodes.reader import EpisodeFile
from tactileforge_episodes.reading import Reading
from tactileforge_episodes.values import EpisodeArrays

#: Files whose keys are looked at.
_FILES = 3
#: Doubts of numbers that only the user knows.
_RATE = "the rate is not in the files: data.fps (Hz) is to be given"
_SPAN = "the unit of the taxels is not known: data.span is the value drawn as full colour"


def guess(root: Path) -> Guess | None:
    """Recognises the format of a folder or file; None for foreign ones.

    Args:
        root: Folder or file.
    """
    best: tuple[int, str] = (0, "")
    try:
        places = [*islice(find_places(root, str), _FILES)]
        for name in preset_names():
            best = max(best, (_fits(read_preset(name), places), name), key=lambda pair: pair[0])
    except (DataError, OSError):
        return None
    if not best[0]:
        return None
    keys = read_preset(best[1])
    try:
        options, doubts = _options(root, best[1], keys)
    except DataError:
        return None  # the arrays of the format, but none of touch
    return Guess(options=options, format=keys.about, score=0.9, doubts=doubts)


def _fits(keys: EpisodeMap, places: Sequence[Place]) -> int:
    """Number of keys of the format in files; 0 if one is missing."""
    files = [
        EpisodeArrays(place, {}, keys.within)
        for place in places
        if path_values(place, keys) is not None
    ]
    whole = all(match(key, file.keys) for file in files for key in keys.signature)
    return len(keys.signature) if files and whole else 0


def _options(root: Path, preset: str, keys: EpisodeMap) -> tuple[dict[str, object], list[str]]:
    """Options for a folder, and statements to be made or checked by the user."""
    options: dict[str, object] = {"root": str(root), "preset": preset}
    doubts = [*keys.doubts]
    if not keys.licence:
        doubts.append("each set of this format has a licence of its own: data.licence")
    file = next(iter(find_files(root, keys, Reading(), [], [])), None)
    if file is None:
        return options, doubts
    if _needs_rate(file):
        doubts.append(_RATE)
    if any(one.taxels and one.taxels.span is None for one in file.touches):
        doubts.append(_SPAN)
    return options, doubts


def _needs_rate(file: EpisodeFile) -> bool:
    """Whether the rate is in neither the file nor the map."""
    time = file.keys.time
    ref = None if time is None else file.arrays.find(time.key, file.values)
    counts = time is not None and (
        time.unit == "frames"
        or (time.unit == "numbers_or_s" and ref is not None and ref.facts.dtype.kind in "iu")
    )
    return file.rate is None and (ref is None or counts)
