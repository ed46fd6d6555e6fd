"""Units of forces, stated by names or declared."""

import numpy as np
import pytest

from tactileforge.data.labels.newtons import NEWTONS, named_unit, newtons_of
from tactileforge.errors import ConfigError


@pytest.mark.parametrize(
    ("unit", "names"),
    {
        "kgf": ["fz_kg", "Fz [kgf]", "force_kg", "force.kg.z", "Fz(kg)", "fzKg", "forceKgf", "kg"],
        "gf": ["force_g", "fz (g)", "Fz [gf]", "fz_grams", "FORCE_G", "fzg", "force_g_z"],
        "lbf": ["Fz [lbf]", "fz_lb", "fz_lbs", "force-pounds", "fzlbf", "Fz/lbf"],
        "ozf": ["fz_oz", "Fz [ozf]", "force ounces"],
        "mN": ["fz_mN", "Fz [mN]", "forcemN"],
        "kN": ["fz_kN", "F_z in kN"],
        "cN": ["Fz[cN]", "force_cN", "fzcN"],
        "v": ["Fz [V]", "force_v"],
        "uN": ["fz_uN", "Fz [µN]"],
        "N": ["fz_n", "Fz [N]", "force_newton", "fzN", "FN", "fz_kg_in_N"],
        "mv": ["fz_mV"],
        "counts": ["Fz [counts]"],
        "": ["fz", "force_z", "f.z", "Force Z", "z", "gel_fz", "", "data/6d_force", "fz_raw", "Fg"],
    }.items(),
)
def test_units_are_read_from_names(unit: str, names: list[str]) -> None:
    assert {name: named_unit(name) for name in names} == dict.fromkeys(names, unit)


@pytest.mark.parametrize(
    "name",
    [
        "force.gr_left",
        "bar_force_z",
        "force_kp1",
        "force_v2_z",
        "obs/force_rg/g",
        "fz_un",
        "lb_force_z",
    ],
)
def test_parts_of_ordinary_names_are_no_units(name: str) -> None:
    assert not named_unit(name)


def test_newtons_of_units() -> None:
    """Standard gravity is 9.80665 m/s^2, a pound .45359237 kg, an ounce a sixteenth of it."""
    np.testing.assert_allclose(NEWTONS["lbf"], 9.80665 * 0.45359237, rtol=1e-9)
    np.testing.assert_allclose(NEWTONS["ozf"] * 16, NEWTONS["lbf"], rtol=1e-12)
    np.testing.assert_allclose(NEWTONS["gf"] * 1000, NEWTONS["kgf"], rtol=1e-12)
    assert newtons_of(["", "", "fz_kg"], None, (1, 1, -9.81), "x", "unit") == 1, "the sign converts"
    assert newtons_of(["", "", "fz_kg"], "N", (1, 1, 1), "x", "unit") == 1, "declared"
    assert newtons_of(["", "", "fz"], "kgf", (1, 1, 1), "x", "unit") == NEWTONS["kgf"]


@pytest.mark.parametrize(
    ("name", "unit", "sign", "words"),
    [
        ("fz_kg", None, 1, "'fz_kg' is in kgf by its name.*force_unit: kgf"),
        ("fz_kg", None, 0.00981, "is in kgf by its name"),
        ("fz_mV", None, 1, "is in mv by its name, which is no force"),
        ("fz", "stone", 1, "unknown force_unit 'stone'"),
    ],
)
def test_units_that_are_not_declared(name: str, unit: str | None, sign: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        newtons_of(["", "", name], unit, (1, 1, sign), "x", "force_unit")
