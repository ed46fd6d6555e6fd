"""Formats recognised by the keys of their files, and maps guessed of others."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from tactileforge.contracts import Guess
from tactileforge.errors import DataError
from tactileforge.reading import words_of
from tactileforge_episodes.find import find_files, path_values
from tactileforge_episodes.guessed_arrays import listed
from tactileforge_episodes.guessed_map import guess_map
from tactileforge_episodes.looks import Look
from tactileforge_episodes.map_files import preset_names, read_preset
from tactileforge_episodes.map_keys import EpisodeMap
from tactileforge_episodes.names import match
from tactileforge_episodes.places import Place, find_places, open_place
from tactileforge_episodes.reader import EpisodeFile
from tactileforge_episodes.statements import Statements
from tactileforge_episodes.values import EpisodeArrays

#: Files whose keys are looked at.
_FILES = 3
#: Files that a map is guessed of.
_MOST = 16
#: Doubts of numbers that only the user knows.
_RATE = "the rate is not in the files: data.fps (Hz) is to be given"
_SPAN = "the unit of the taxels is not known: data.span is the value drawn as full colour"


def guess(root: Path, touch: Sequence[str] = ()) -> Guess | None:
    """Recognises the format of a folder or file, else guesses a map; None without arrays.

    Args:
        root: Folder or file.
        touch: Keys of touch, in place of a format; () for those whose names say it.

    Raises:
        DataError: There are arrays, but none is touch by its name, or the files are damaged.
    """
    places = [*islice(find_places(root, str), _MOST)]
    if not places:
        return None
    known = None if touch else _recognise(root, places[:_FILES])
    return known or _guess_map(root, places, touch)


def _recognise(root: Path, places: Sequence[Place]) -> Guess | None:
    """The format of a map of the package; None for another."""
    best: tuple[int, str] = (0, "")
    try:
        for name in preset_names():
            best = max(best, (_fits(read_preset(name), places), name), key=lambda pair: pair[0])
        if not best[0]:
            return None
        keys = read_preset(best[1])
        options, doubts = _options(root, best[1], keys)
    except (DataError, OSError):
        return None  # damaged, or the arrays of the format, but none of touch
    return Guess(options=options, format=keys.about, score=0.9, doubts=doubts)


def _guess_map(root: Path, places: Sequence[Place], touch: Sequence[str]) -> Guess:
    """A map of the first file with touch by its names, and of others of its kind."""
    found: list[tuple[Place, dict[str, Any]]] = []
    failed: list[DataError] = []
    for place in places:
        if not found or place.kind == found[0][0].kind:
            try:
                keys = guess_map(open_place(place), _shown(root, place), root, touch)
            except DataError as error:
                failed.append(error)
            else:
                found.append((place, keys))
    if not found:
        raise failed[0]
    kind, keys = found[0][0].kind, found[0][1]
    for _, other in found[1:]:
        # touch of other files alone
        known = [{one[name] for one in keys["touch"]} for name in ("array", "finger")]
        keys["touch"] += [
            one
            for one in other["touch"]
            if one["array"] not in known[0] and one["finger"] not in known[1]
        ]
    touch_times = any("times" in one for one in keys["touch"])
    if len(places) == 1 and not touch_times and not keys.keys() & {"within", "ends", "times"}:
        array = keys["touch"][0]["array"]
        keys["doubts"].append(
            f"ends: {array} is taken for one film; if each of its rows is a touch of its own, the "
            f"map has: ends: {array}, ends_are: rows, background: none"
        )
    drawn = all("taxels" in one for one in keys["touch"])
    streams = ", ".join(one["finger"] for one in keys["touch"])
    return Guess(
        options={"root": str(root), "map": keys},
        format=f"{kind} with names of its own, touch: {streams}",
        score=0.05 if drawn else 0.5,
        doubts=["licence: nothing says it (data.licence)"],  # the reader says those of the map
    )


def listed_arrays(root: Path) -> str:
    """The arrays of the first file of a folder, with their types and shapes, a phrase."""
    place = next(find_places(root, str), None)
    if place is None:
        return "no zarr, HDF5, npz or mat is there"
    file = open_place(place)
    looks = [Look(key, file.facts(key), words_of(key)) for key in file.keys()]  # noqa: SIM118
    return f"{_shown(root, place)} has {listed(looks)}"


def _shown(root: Path, place: Place) -> str:
    """Name of a file from the folder above the root on."""
    path = Path(str(place)).absolute()
    above = root.absolute().parent
    return path.relative_to(above).as_posix() if path.is_relative_to(above) else str(place)


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
    doubts: list[str] = []  # the reader says those of the map
    if not keys.licence:
        doubts.append("each set of this format has a licence of its own: data.licence")
    file = next(iter(find_files(root, keys, Statements(), [], [])), None)
    if file is None:
        return options, doubts
    if _needs_rate(file):
        doubts.append(_RATE)
    if any(one.taxels and one.taxels.span is None for one in file.touches):
        doubts.append(_SPAN)
    return options, doubts


def _needs_rate(file: EpisodeFile) -> bool:
    """Whether the rate is in neither the file nor the map."""
    time = file.keys.times
    ref = None if time is None else file.arrays.find(time.array, file.values)
    counts = time is not None and (
        time.unit == "frames"
        or (time.unit == "numbers_or_s" and ref is not None and ref.facts.dtype.kind in "iu")
    )
    return file.rate is None and (ref is None or counts)
