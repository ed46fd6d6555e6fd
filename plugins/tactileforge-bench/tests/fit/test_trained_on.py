"""Training data of a model against the held-out data of the gate."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_bench.fit.trained_on import seen, trained_on
from videos import write_video

from tactileforge.cli._compose import option
from tactileforge.datasets.recordings import Recordings
from tactileforge.hub.header import Header
from tactileforge.reading.splits import is_held_out

HEADER = Header(
    format=1, name="", encoder={"name": "a"}, package="", package_version="", sensors={},
    input={}, spacing=0.0, dtype="float32", licence="MIT",
)  # fmt: skip
SLIP = {"path": "gsmini_slip_franka", "videos": ["a", "b"], "hold_out": "object"}


def of(**data: Any) -> Header:
    return replace(HEADER, recipe={"data": data})


@pytest.mark.parametrize(
    ("data", "sets", "told"),
    [
        ({"name": "sim"}, ["sim"], []),
        (
            {"name": "recordings", "val": 0.5, "layouts": {"slip": SLIP, "left_out": None}},
            ["gsmini_slip_franka"],
            [],
        ),
        (
            {"name": "recordings", "val": 0.1, "layouts": {"slip": SLIP}},
            ["gsmini_slip_franka"],
            ["gsmini_slip_franka (val=0.1, not 0.5)"],
        ),
        (
            {"name": "mixture", "sources": {
                "sim": {"name": "sim"},
                "octopi": {"name": "recordings", "val": 0.1, "layouts": {
                    "octopi": {"path": "octopi_physiclear", "videos": "*.mov", "split": "{split}"}
                }},
                "wedge": {"name": "recordings", "layouts": {"w": {"path": "wedge_ball_presses"}}},
                "mini": {"name": "recordings", "layouts": {
                    "cable": {"path": "anytouch2_umi_cable"}, "slam": {"path": "gelslam_mini"},
                    "balls": {"path": "digit_ball_presses"},
                }},
            }},
            ["anytouch2_umi_cable", "digit_ball_presses", "gelslam_mini",
             "octopi_physiclear/*.mov", "sim", "wedge_ball_presses"],
            ["anytouch2_umi_cable (held out)", "gelslam_mini (held out)",
             "octopi_physiclear (val=0, not 0.5)", "wedge_ball_presses (held out)"],
        ),
    ],
)  # fmt: skip
def test_training_data_is_named(data: Any, sets: list[str], told: list[str]) -> None:
    header = of(**data)
    assert trained_on(header) == sets
    assert seen(header) == told


def test_a_file_without_a_recipe_says_what_it_knows() -> None:
    assert trained_on(replace(HEADER, data={"name": "ToucHD"})) == ["ToucHD"]
    assert trained_on(HEADER) == ["unknown"]


@pytest.mark.slow
@pytest.mark.realdata
def test_training_and_the_gate_agree_on_the_slip_objects(realdata: Path) -> None:
    words = ["data=gsmini_slip", f"data.root={realdata}"]
    node = option("data", words)
    assert seen(of(**node)) == []
    data = Recordings(node["root"], node["layouts"], node["val"])
    objects = {side: {r.object for r in data.recordings(side)} for side in ("train", "val")}
    assert objects["train"] == {
        name for name in objects["train"] if not is_held_out(str(name), 0.5)
    }
    assert objects["val"] == {name for name in objects["val"] if is_held_out(str(name), 0.5)}
    assert (len(objects["train"]), len(objects["val"])) == (14, 11)


def test_the_published_grasps_hold_out_the_same_objects(tmp_path: Path) -> None:
    """A clone of the repository: objects of the gate by their hash, all others are trained on."""
    node = option("data", ["data=incipient_slip", f"data.root={tmp_path}"])
    names: dict[str, list[str]] = {}
    for key, layout in node["layouts"].items():
        for pattern in layout["videos"]:
            path = tmp_path / layout["path"] / pattern.replace("*/*.avi", "exp_num_1/camera_0.avi")
            write_video(path, [np.full((32, 48, 3), 90, np.uint8)] * 16)
            names.setdefault(key.split("_")[0], []).append(path.parts[-3])
    data = Recordings(node["root"], node["layouts"], node["val"])
    held_out = {name for name in names["gate"] if is_held_out(name, 0.5)}
    assert (len(names["gate"]), len(names["more"]), len(held_out)) == (25, 14, 11)
    assert {r.object for r in data.recordings("val")} == held_out
    trained = {r.object for r in data.recordings("train")}
    assert trained == {*names["gate"], *names["more"]} - held_out
    node["val"] = 0.1
    found = [name for name in seen(of(**node)) if "val=0.1" in name]
    assert found == ["franka-servo/datasets/base_data_for_training (val=0.1, not 0.5)"]
