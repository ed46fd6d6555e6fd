"""The paper's ablations: each leaves out its part, and the rest trains."""

from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.plugins import registry

ZOO = Path(__file__).parents[1] / "zoo" / "ablation"
ALL = {"pixel", "diff", "align", "match", "force"}
TOUCHD = {"touchd_sim", "touchd_mani", "touchd_force"}
#: Ablation -> objectives that are left out.
OBJECTIVES: dict[str, set[str]] = {
    "none": set(),
    "no_diff": {"diff"},
    "no_match": {"match"},
    "no_action_match": set(),
    "no_force": {"force"},
    "no_align": {"align"},
    "no_schedule": set(),
    "two_frames": set(),
    "force_without_shear": set(),
}
#: Ablation -> sources that are left out, and objectives.
DATA: dict[str, tuple[set[str], set[str]]] = {
    "no_touchd_sim": ({"touchd_sim"}, set()),
    "no_touchd_mani": ({"touchd_mani"}, set()),
    "no_touchd_force": ({"touchd_force"}, {"force"}),
    "no_touchd": (TOUCHD, {"force"}),
    "tier1": (
        {"touch_and_go", "visgel", "tvl", "ssvtp", "objectfolder_real", "ycb_slide"}
        | {"touch_slide", "octopi", "tacquad", "touchd_sim", "touchd_mani"},
        {"align"},
    ),
}


def plain(*overrides: str) -> dict[str, Any]:
    config = compose("anytouch2", overrides)
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def test_every_ablation_is_tested() -> None:
    assert {path.stem for path in ZOO.glob("*.yaml")} == OBJECTIVES.keys() | DATA.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(OBJECTIVES.keys() - {"none"}))
def test_what_is_left_trains_two_steps(name: str, tmp_path: Path) -> None:
    overrides = [f"ablation={name}", "scale=demo", "debug=steps", "encoder.image_size=32"]
    overrides += ["batch.size=8", "data.scenes=3", "data.val=1", "data.size=32"]
    config = compose("anytouch2", overrides)
    assert set(config.objective) == set(config.head) == ALL - OBJECTIVES[name]
    assert set(config.curriculum.objective) == {"align", "match", "force"} - OBJECTIVES[name]
    module = train(config, tmp_path)
    assert module.global_step == 2
    assert set(module.objectives) == ALL - OBJECTIVES[name]


def test_no_action_match_still_matches_objects() -> None:
    match = plain("ablation=no_action_match")["objective"]["match"]
    assert match == {"name": "match", "weight": 0.02, "of_object": 1.0, "of_action": 0.0}


@pytest.mark.parametrize("scale", ["paper", "demo"])
def test_without_a_schedule_every_weight_is_whole_at_once(scale: str) -> None:
    from tactileforge.training.curriculum import from_config

    config = plain("ablation=no_schedule", f"scale={scale}")
    weights = {key: node["weight"] for key, node in config["objective"].items()}
    assert from_config(config["curriculum"], weights, total=100, epoch=10).weights(0) == weights
    scheduled = plain(f"scale={scale}")["curriculum"]
    assert from_config(scheduled, weights, total=100, epoch=10).weights(0)["force"] == 0


def test_two_frames_span_the_time_of_four() -> None:
    four, two = plain(), plain("ablation=two_frames")
    assert (four["encoder"]["frames"], two["encoder"]["frames"]) == (4, 2)
    assert 3 * four["batch"]["spacing"] == pytest.approx(two["batch"]["spacing"], rel=1e-2)
    assert two["encoder"]["spacing"] == two["batch"]["spacing"]


def test_force_without_shear_learns_the_normal_force() -> None:
    assert plain("ablation=force_without_shear")["objective"]["force"]["shear"] is False


@pytest.mark.slow
@pytest.mark.parametrize("name", DATA)
def test_tiers_are_left_out_and_objectives_that_need_them(name: str) -> None:
    sources, objectives = DATA[name]
    config = plain(f"ablation={name}", "data_folder=/somewhere")
    data = registry.build("datasets", {k: v for k, v in config["data"].items() if k != "max_bad"})
    everything = plain("data=anytouch2")["data"]["sources"].keys()
    assert len(everything) == 12
    assert data.datasets.keys() == everything - sources
    assert config["data"]["sources"]["touchd_force" if name == "tier1" else "tvl"][
        "root"
    ].startswith("/somewhere/")
    assert set(config["objective"]) == ALL - objectives
    for key in config["objective"]:
        for need in registry.get("objectives", key).needs:
            assert data.provides & set(need.split("|")), key


def test_ablations_add_up() -> None:
    assert set(plain("ablation=[no_diff,no_force]")["objective"]) == {"pixel", "align", "match"}


def test_null_leaves_an_objective_out() -> None:
    config = plain("objective.diff=null")
    assert set(config["objective"]) == set(config["head"]) == ALL - {"diff"}
