"""Headers of forces: the measured force on the gel of several in a table, and its axes."""

from __future__ import annotations

import pytest

from tactileforge.reading.guessing.force_headers import axes_of_force, axis_of


@pytest.mark.parametrize(
    ("header", "wanted"),
    [
        ("t fz_des fz_meas", "- - fz_meas"),
        ("t fz_cmd fz", "- - fz"),
        ("t fz_target fz_actual", "- - fz_actual"),
        ("t Fz_raw Fz", "- - Fz"),
        ("t Fz_raw", "- - Fz_raw"),
        ("fx_pred fy_pred fz_pred fx fy fz", "fx fy fz"),
        ("Fx_std Fy_std Fz_std Fx_mean Fy_mean Fz_mean", "Fx_mean Fy_mean Fz_mean"),
        ("fx_robot fy_robot fz_robot fx fy fz", "fx fy fz"),
        ("Fx_bias Fx Fy Fz", "Fx Fy Fz"),
        ("Fx_dot Fy_dot Fz_dot Fx Fy Fz", "Fx Fy Fz"),
        ("ee.wrench.force.z ati.wrench.force.z", "- - ati.wrench.force.z"),
        ("fx fy fz_filtered", "fx fy fz_filtered"),
        ("Force-X Force-Y Force-Z", "Force-X Force-Y Force-Z"),
        ("$F_x$ $F_y$ $F_z$", "$F_x$ $F_y$ $F_z$"),
        ("/ft/wrench/force/x /ft/wrench/force/y /ft/wrench/force/z",) * 2,
        ("Fx1 Fy1 Fz1 Tx1", "Fx1 Fy1 Fz1"),
        ("ft[0] ft[1] ft[2] ft[3]", "ft[0] ft[1] ft[2]"),
        ("wrench.0 wrench.1 wrench.2 wrench.3", "wrench.0 wrench.1 wrench.2"),
        ("Fshear Fnormal", "- - Fnormal"),
        ("F_t F_n", "- - F_n"),
        ("Normalkraft[N]", "- - Normalkraft[N]"),
        ("法向力", "- - 法向力"),
        # several alike, none of the gel, or no force
        ("fz_a fz_b", "- - -"),
        ("fx_0 fy_0 fz_0 fx_1 fy_1 fz_1", "- - -"),
        ("force_1 force_2 force_3", "- - -"),
        ("fz_cmd", "- - -"),
        ("tcp.force.z", "- - -"),
        ("normal_x normal_y normal_z", "- - -"),
        ("fx fy cx cy", "- - -"),
        ("pose_x pose_z offset_z effort_z", "- - -"),
    ],
)
def test_the_measured_force_of_several(header: str, wanted: str) -> None:
    columns = [None if name == "-" else name for name in wanted.split()][:3]
    assert axes_of_force(header.split()) == columns


def test_the_force_of_a_side() -> None:
    header = ["t", "fx_l", "fy_l", "fz_l", "fx_r", "fy_r", "fz_r"]
    assert axes_of_force(header) == [None] * 3
    assert axes_of_force(header, "left") == ["fx_l", "fy_l", "fz_l"]
    assert axes_of_force(header, "r") == ["fx_r", "fy_r", "fz_r"]
    assert axes_of_force(["fx", "fz"], "right") == ["fx", None, "fz"]
    assert axes_of_force(["left_fz"], "right") == [None] * 3


def test_other_columns_have_no_axis() -> None:
    for title in ("effx", "offset_x", "freq_x", "camera_f", "loaf_z", "Time", "F", "x", "F/T z"):
        assert axis_of(title) == ""
