"""Headers of columns of forces: their axes and their other words."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.reading.guessing.view_words import (
    COMMANDS,
    DERIVED_FORCES,
    ROBOT,
    apart_by_capitals,
    words_of,
)
from tactileforge.reading.sides import SIDES

#: Force, in English, German, Dutch, Spanish, Italian and Chinese.
FORCE = r"(?:forces?|kraft|kracht|fuerza|forza|力)"
#: Words for a force along an axis.
_WORDS = {axis: rf"(?:shear|tangential|lateral)(?:[_ ]?force)?[_ ]?{axis}" for axis in "xy"}
_WORDS["z"] = (
    r"(?:f[_ ]?normal|f_?n|normal(?:[_ ]?force)?|force[_ ]?normal|normalkraft|druckkraft|法向力)"
    r"(?![_ .]?[xyz](?![a-z]))"
)
#: Headers of columns by axis: what stands before (a sensor, a message, a file), and behind.
_AXES = {
    axis: re.compile(
        rf"(?:.*[\W_])?(?:(?:{FORCE}[\W_]{{0,2}}|f[_ .-]?){axis}|{axis}[_ .-]?{FORCE}"
        rf"|{_WORDS[axis]})(?![^\W\d_]).*"
    )
    for axis in "xyz"
}
#: Headers of columns by their place in a list.
_PLACED = re.compile(
    r"(?:.*[\W_])?(?:forces?|wrench(?:es)?|ft|f|fxyz|force_?torques?)(?:_\w+)?"
    r"(?:[_.]([012])|\[([012])\])"
)
_LAST_NUMBER = re.compile(r"\d+(?=\D*$)")
#: Header of the only force, without an axis; and words that need a unit.
_ALONE = re.compile(
    rf"(?:\S*[./])?(?:{FORCE}|load|load_?cell|fn)(?:[_ (\[]+\w+[)\]]?)?|grams?|newtons?|kgf|gf|lbf"
)
_WEIGHED = re.compile(rf"(?:\S*[./])?(?:weight|{FORCE}|load|f)(?![^\W_])")
#: Words of a force that say nothing of whose it is.
_PLAIN = {
    *("f", "fx", "fy", "fz", "fn", "fxyz", "x", "y", "z", "force", "forces", "torque", "torques"),
    *("ft", "wrench", "wrenches", "normal", "shear", "tangential", "lateral", "field", "in"),
}
#: Words of a force that is taken where there is no other.
_LAST = {"raw", "uncalibrated", "est", "estimate", "estimated"}
#: Words of a force that is not measured on the gel.
_ELSEWHERE = ROBOT | COMMANDS | DERIVED_FORCES


def axis_of(title: str) -> str:
    """The axis of a force by its header; "" for another column.

    Example:
        >>> axis_of("ati_Fx [N]"), axis_of("Force-Z"), axis_of("wrench.force.y"), axis_of("pose_x")
        ('x', 'z', 'y', '')
    """
    plain = apart_by_capitals(title.strip()).lower()
    named = next((axis for axis, pattern in _AXES.items() if pattern.fullmatch(plain)), "")
    place = None if named else _PLACED.fullmatch(plain)
    return "xyz"[int(place[1] or place[2])] if place else named


def axes_of_force(header: Sequence[str], side: str = "") -> list[str | None]:
    """Columns of the force along x, y and z by their names; None for an axis without one.

    The axes of one force have the same other words. Of several forces, the one with the fewest
    other words is taken. Those of the robot, of commands and of what is computed are not.

    Example:
        >>> axes_of_force(["t", "fz_des", "fz_meas"]), axes_of_force(["fz_a", "fz_b"])
        ([None, None, 'fz_meas'], [None, None, None])
        >>> axes_of_force(["Fx_l", "Fz_l", "Fx_r", "Fz_r"], "right")
        ['Fx_r', None, 'Fz_r']
    """
    forces: dict[tuple[str, ...], dict[str, str]] = {}
    for title in header:
        if (axis := axis_of(title)) and (words := _others(title, header)) is not None:
            forces.setdefault(words, {}).setdefault(axis, title)
    sides = {words: {SIDES[word] for word in words if word in SIDES} for words in forces}
    if side and any(sides.values()):
        own = {SIDES.get(side, side)}
        forces = {words: axes for words, axes in forces.items() if sides[words] <= own}
    whole = [words for words, axes in forces.items() if "z" in axes and not is_elsewhere(words)]
    best = min(map(_rank, whole), default=None)
    taken = [words for words in whole if _rank(words) == best]
    if len(taken) != 1:
        return [None] * 3
    # one axis of several may have a word of its own: fx, fy, fz_filtered
    found = forces.get((), {}) | forces[taken[0]]
    return [found.get(axis) for axis in "xyz"]


def is_elsewhere(words: Sequence[str]) -> bool:
    """Whether words say another force than the measured one on the gel."""
    return not _ELSEWHERE.isdisjoint(words)


def is_alone(title: str) -> bool:
    """Whether a header is of a force or load without an axis, or of a weight in a unit."""
    plain = apart_by_capitals(title.strip()).lower()
    if is_elsewhere(words_of(title)):
        return False
    weighs = _WEIGHED.match(plain) is not None and named_unit(title) in NEWTONS
    return weighs or _ALONE.fullmatch(plain) is not None


def _rank(words: Sequence[str]) -> tuple[bool, int]:
    return not _LAST.isdisjoint(words), len(words)


def _others(title: str, header: Sequence[str]) -> tuple[str, ...] | None:
    """Words of a force besides its axis and unit; None for a place in a list without a first."""
    plain, words = apart_by_capitals(title.strip()).lower(), words_of(title)
    if not any(pattern.fullmatch(plain) for pattern in _AXES.values()):
        if _LAST_NUMBER.sub("0", title) not in header:
            return None
        words = words[:-1]
    return tuple(word for word in words if word not in _PLAIN and not named_unit(word))
