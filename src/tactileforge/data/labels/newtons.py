"""Units of forces: their newtons, and those stated by the names of columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tactileforge.errors import ConfigError, unknown

_KILOGRAM, _POUND = 9.80665, 4.4482216152605
#: Newton of each unit of force; of a mass, those of its weight.
NEWTONS = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "kgf": _KILOGRAM, "gf": _KILOGRAM / 1000}
NEWTONS |= {"cN": 1e-2, "lbf": _POUND, "ozf": _POUND / 16}
#: Spellings in names, without case, and their units.
_SPELLED = {unit.casefold(): unit for unit in NEWTONS} | {
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("kilonewton", "kilonewtons"), "kN"),
    **dict.fromkeys(("millinewton", "millinewtons"), "mN"),
    **dict.fromkeys(("\u00b5n", "\u03bcn", "micronewton", "micronewtons"), "uN"),
    **dict.fromkeys(("kg", "kgs", "kp", "kilo", "kilos", "kilogram", "kilograms"), "kgf"),
    **dict.fromkeys(("g", "gr", "grm", "gram", "grams", "gramforce"), "gf"),
    **dict.fromkeys(("lb", "lbs", "pound", "pounds"), "lbf"),
    **dict.fromkeys(("oz", "ounce", "ounces"), "ozf"),
}
#: Units of a reading before it is a force.
_NO_FORCE = frozenset(("v", "mv", "volt", "volts", "counts", "adc", "lsb", "psi", "kpa", "mpa"))
_NO_FORCE |= {"bar", "deg", "rad"}
_PART = re.compile(r"[^\W\d_]+")
#: Spellings that are also parts of ordinary names (left, bottom: `lb`): units at the end alone.
_SHORT = frozenset(("g", "gr", "grm", "kg", "kgs", "kp", "kilo", "kilos", "lb", "lbs", "oz"))
_SHORT |= {"bar", "v"}
#: Words before a unit that is parted by a point or a slash.
_BEFORE = frozenset(("x", "y", "z", "fx", "fy", "fz", "f", "force", "forces"))
#: A unit behind the name of an axis, without a mark between them: `fzKg`, `forcemN`.
_GLUED = re.compile(
    r"(?:force|f?[xyz])(kgf?|gf|g|lbf?|lbs|ozf?|[ckm]?n)|f(kgf|gf|lbf|ozf|[ckm]?n)", re.IGNORECASE
)
#: Largest relative difference of a sign from the factor of its unit.
_CLOSE = 0.02


def named_unit(name: str) -> str:
    """The unit of force in the name of a column; "" for a name without one.

    Args:
        name: Name of a column, of a key, or of a feature.

    Example:
        >>> named_unit("fz_kg"), named_unit("Fz [lbf]"), named_unit("force_z_n"), named_unit("fz")
        ('kgf', 'lbf', 'N', '')
    """
    parts = list(_PART.finditer(name))
    units = [unit for place in range(len(parts)) if (unit := _unit_at(name, parts, place))]
    if not units and (glued := _GLUED.fullmatch(parts[-1][0] if parts else "")):
        units = [_SPELLED[(glued[1] or glued[2]).casefold()]]
    return "N" if "N" in units else units[-1] if units else ""


def _unit_at(name: str, parts: Sequence[re.Match[str]], place: int) -> str:
    part, word = parts[place], parts[place][0].casefold()
    unit = word if word in _NO_FORCE else _SPELLED.get(word, "")
    if word == "un":
        return unit if part[0] == "uN" else ""
    if word not in _SHORT:
        return unit
    rest = name[part.end() :].casefold()
    mark = name[part.start() - 1 : part.start()]
    before = parts[place - 1][0].casefold() if place else "f"
    is_last = re.fullmatch(r"[\W_]*[xyz]?", rest) is not None
    return unit if is_last and (mark not in ("/", ".") or before in _BEFORE) else ""


def newtons_of(
    names: Sequence[str], unit: str | None, sign: Sequence[float], where: str, key: str
) -> float:
    """Newton of the unit of forces.

    Args:
        names: Names of the columns x, y and z; "" for an axis without one.
        unit: Declared unit; None for newton, unless names say another.
        sign: Factors of x, y and z, which may convert units, too.
        where: Place of the unit in the configuration.
        key: Name of its key.

    Raises:
        ConfigError: The unit is unknown, or none is declared where names state another than newton.

    Example:
        >>> newtons_of(["fx_g", "fy_g", "fz_g"], "gf", (1, 1, -1), "force", "unit")
        0.00980665
    """
    if unit is not None:
        if unit not in NEWTONS:
            raise ConfigError(f"{where}: {unknown(key, unit, NEWTONS)}")
        return NEWTONS[unit]
    for name, factor in zip(names, sign, strict=True):
        said = named_unit(name) if name else ""
        if not said or said == "N":
            continue
        if said in NEWTONS and abs(abs(factor) / NEWTONS[said] - 1) <= _CLOSE:
            continue
        if said in NEWTONS:
            raise ConfigError(
                f"{where}: {name!r} is in {said} by its name, and forces are in newton: give "
                f"{key}: {said}, which converts it, or {key}: N if the name is wrong"
            )
        raise ConfigError(
            f"{where}: {name!r} is in {said} by its name, which is no force: convert it to newton, "
            f"or give {key}: N if it is"
        )
    return 1.0
