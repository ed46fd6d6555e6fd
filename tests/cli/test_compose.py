from inspect import signature
from pathlib import Path

import pytest
from hydra.errors import ConfigCompositionException
from omegaconf import OmegaConf

from tactileforge.cli._compose import compose, composed, option, plain
from tactileforge.cli._sources import node_of
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import ConfigError
from tactileforge.training.curriculum import from_config

ROOT = Path(__file__).parents[2]
PLUGINS = """
class Toy:
    def __init__(self, encoder, gain: float = 1.0, *, port, tags=("a", "b")):
        pass

class Goal:
    head = "pixel"
    needs = frozenset()
    def __init__(self, strength: float = 2.0):
        pass
"""
ENTRY_POINTS = """
[tactileforge.sensors]
toy = toy_compose:Toy
[tactileforge.objectives]
goal = toy_compose:Goal
[tactileforge.datasets]
broken = toy_compose:Missing
"""


@pytest.fixture
def toy(installed):
    installed("toy-compose", ENTRY_POINTS, {"toy_compose.py": PLUGINS})


def test_the_default_recipe_has_a_head_for_each_of_its_objectives():
    config = compose()
    assert list(config.objective) == ["pixel", "diff", "align", "match", "force"]
    assert {key: node.name for key, node in config.head.items()} == {k: k for k in config.objective}
    assert config.objective.match.weight == 0.02
    assert config.encoder.name == "tactile_vit"


def test_choosing_objectives_drops_the_other_heads_and_curriculum_rows():
    config = compose(overrides=["objective=[pixel,diff]"])
    assert list(config.objective) == ["pixel", "diff"]
    assert list(config.head) == ["pixel", "diff"]
    assert not config.curriculum.objective


def test_options_reach_the_node_of_one_plugin():
    config = compose(overrides=["objective.force.weight=0.2", "head.diff.depth=1", "data=sim"])
    assert config.objective.force.weight == 0.2
    assert (config.head.diff.depth, config.head.pixel.depth) == (1, 6)
    assert config.data.name == "sim"


def test_one_plugin_serves_twice_under_two_names():
    config = compose(overrides=["objective=[pixel]", "+objective@objective.second=diff"])
    assert {key: node.name for key, node in config.objective.items()} == {
        "pixel": "pixel",
        "second": "diff",
    }
    assert config.head.second.name == "diff"
    assert config.objective.second.weight == 1.0


def test_options_of_a_head_that_only_an_objective_brings_are_kept():
    config = compose(overrides=["objective=[pixel,dino]", "scale=tiny", "head.dino.hidden=32"])
    assert (config.head.dino.prototypes, config.head.dino.hidden) == (256, 32)
    assert config.head.dino.centring == 0.9


def test_a_second_name_can_have_a_head_of_its_own():
    overrides = [
        "+objective@objective.second=diff",
        "+head@head.second=diff",
        "head.second.depth=2",
    ]
    config = compose(overrides=overrides)
    assert (config.head.second.depth, config.head.diff.depth) == (2, 6)


@pytest.mark.parametrize(
    ("override", "listed"),
    [
        (
            "objective=[pixle]",
            [
                "did you mean 'pixel'?",
                "align, classify, denoise, diff, dino, distill, force, imitate, jepa",
            ],
        ),
        ("data=simm", ["sim", "recordings", "public_samples"]),
        ("encoder=tactile_vti", ["tactile_vit"]),
    ],
)
def test_typo_in_an_option_lists_what_there_is(override, listed):
    with pytest.raises(ConfigCompositionException) as error:
        compose(overrides=[override])
    for words in listed:
        assert words in str(error.value)


def test_typo_in_a_key_is_an_error():
    with pytest.raises(ConfigCompositionException, match="wieght"):
        compose(overrides=["objective.pixel.wieght=2"])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("objective=[]", r"no objective: choose some, e\.g\. objective=\[pixel,diff\]"),
        ("+curriculum.objective.pixle.start=0.1", r"'pixle'; did you mean 'pixel'"),
        ("+head.pixle.depth=1", r"unknown head 'pixle'; did you mean 'pixel'"),
    ],
)
def test_rows_that_contradict_the_plugins(override, message):
    with pytest.raises(ConfigError, match=message):
        compose(overrides=[override])


def test_a_plugin_is_an_option_as_soon_as_it_is_installed(toy):
    made = option("sensor", ["sensor=toy", "sensor.toy.gain=3", "sensor.toy.port=COM1"])
    assert made == {"toy": {"name": "toy", "gain": 3, "port": "COM1", "tags": ["a", "b"]}}


def test_an_option_without_default_has_to_be_given(toy):
    with pytest.raises(ConfigError, match=r"give sensor\.toy\.port=\.\.\."):
        option("sensor", ["sensor=toy"])


def test_an_objective_brings_the_head_it_names(toy):
    config = compose(overrides=["objective=[goal]"])
    assert config.objective.goal == {"name": "goal", "weight": 1.0, "strength": 2.0}
    assert config.head.goal == node_of("head", "pixel")


def test_a_broken_plugin_breaks_only_the_run_that_names_it(toy):
    assert compose(overrides=["objective=[goal]"]).data.name == "sim"
    said = r"dataset 'broken' \(toy_compose:Missing, from toy-compose 1\.0\) cannot be loaded"
    with pytest.raises(ConfigCompositionException, match=said):
        compose(overrides=["data=broken"])


def test_a_package_may_ship_presets(installed):
    preset = "defaults: [sim, _self_]\nscenes: 7\n"
    modules = {"toy_conf/__init__.py": "", "toy_conf/data/toy_preset.yaml": preset}
    installed("toy-conf", "[tactileforge.conf]\ntoy = toy_conf", modules)
    data = compose(overrides=["data=toy_preset"]).data
    assert (data.name, data.scenes) == ("sim", 7)


def test_an_objective_without_a_row_of_the_curriculum_is_given_one() -> None:
    words = ["objective=[pixel,surface]", "+curriculum.objective.surface={start: 0.2, end: 0.5}"]
    config = compose("anytouch2", words)
    plan = from_config(config.curriculum, {"pixel": 1.0, "surface": 2.0}, total=100, epoch=1)
    assert [plan.weights(step)["surface"] for step in (0, 20, 35, 50, 99)] == [0, 0, 1, 2, 2]
    assert plan.weights(0)["pixel"] == 1


ENCODER = """
class Net:
    def __init__(self, width: int = 8, image_size: int = 64):
        pass
"""


@pytest.fixture
def net(installed):
    installed("net", "[tactileforge.encoders]\nnet = net_compose:Net", {"net_compose.py": ENCODER})


@pytest.mark.parametrize("scale", ["demo", "tiny", "paper", "finetune"])
@pytest.mark.parametrize("recipe", ["anytouch2", "mae", "dino"])
def test_recipes_and_scales_set_only_options_that_the_encoder_has(scale, recipe, net):
    node = compose(recipe, ["encoder=net", f"scale={scale}"]).encoder
    assert set(node) == {"name", "width", "image_size"}
    size = compose(recipe, [f"scale={scale}"]).encoder.image_size
    assert node.image_size == (64 if scale == "paper" else size), "what it has is set"


def test_an_option_that_is_typed_or_unknown_to_all_is_never_left_out(net):
    for key in ("depth", "widht"):
        with pytest.raises(ConfigError, match=f"unknown option of encoder 'net' '{key}'; did you"):
            compose("anytouch2", ["encoder=net", "scale=demo", f"++encoder.{key}=3"])


def test_a_layout_that_only_the_data_defines_may_be_null() -> None:
    words = ["data=recordings", "data.root=x", "data.layouts.cups=null"]
    assert dict(composed("train", words).data.layouts) == {"cups": None}


def test_defaults_of_batches_are_those_of_the_data_module() -> None:
    config = OmegaConf.load(ROOT / "conf/batch/default.yaml")
    defaults = {key: one.default for key, one in signature(TouchData).parameters.items()}
    assert config.pop("size") == defaults["batch_size"]
    assert not any(config.pop("shares").values())
    assert defaults["shares"] is None
    assert dict(config) == {key: defaults[key] for key in config}


def test_all_missing_values_are_named_where_others_interpolate_them() -> None:
    config = OmegaConf.create({"a": "???", "b": "${a}", "c": {"d": ["x", "???"]}})
    with pytest.raises(ConfigError, match=r"^give a=\.\.\. c\.d\.1=\.\.\.$"):
        plain(config)
