"""The recipe of AnyTouch 2 against the paper's Training Recipe and Implementation Details."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tactileforge import compose, train
from tactileforge.errors import ConfigError
from tactileforge.hub.starting_point import inflated
from tactileforge.packing import Filter

CARD = Path(__file__).parents[1] / "zoo" / "recipe" / "anytouch2.md"
#: Key of the configuration, and the paper's value (arXiv 2602.09617, appendix "Implementation
#: Details"; weights, starts and sensor tokens in section "Training Recipe", too).
EQUAL = {
    "init": "clip.vitb16",  # OpenCLIP-Base
    "text_encoder.name": "clip",
    "image_encoder.name": "clip",
    "encoder.size": "base",
    "encoder.frames": 4,  # T(t-6), T(t-4), T(t-2), T(t)
    "encoder.mask_ratio": 0.75,
    "encoder.sensor_tokens": 5,
    "head.pixel.depth": 6,
    "head.pixel.heads": 8,
    "head.pixel.width": 512,
    "head.diff.depth": 6,
    "head.diff.heads": 8,
    "head.diff.width": 512,
    "optim.name": "adamw",
    "optim.lr": 3e-4,
    "optim.schedule": "linear",
    "optim.warmup": 1 / 40,  # one epoch of 40
    "trainer.max_epochs": 40,
    "batch.size": 64,
    "objective.pixel.weight": 1.0,
    "objective.diff.weight": 1.0,
    "objective.align.weight": 1.0,
    "objective.align.alpha_tv": 0.2,
    "objective.align.alpha_tl": 0.2,
    "objective.match.weight": 0.02,
    "objective.force.weight": 0.1,
    "curriculum.objective.match.start": 20 / 40,
    "curriculum.objective.force.start": 20 / 40,
    "curriculum.objective.align.start": 30 / 40,
    "curriculum.universal.low": 0.0,
    "curriculum.universal.high": 0.75,
}
#: Key, what the paper has, what the recipe has, and how the card calls it.
LISTED = {
    "text_encoder.frozen": ("not said", True, "which stay frozen"),
    "image_encoder.frozen": ("not said", True, "which stay frozen"),
    "batch.match": ("a fixed proportion", 0.25, "A quarter of each batch"),
    "batch.spacing": ("2/30 s; four in a row of a Mini at 18 Hz", 0.0667, "18 Hz"),
    "optim.weight_decay": ("not said", 0.05, "weight decay 0.05"),
    "batch.size": ("64, on four cards", 64, "`batch.size` is of one process"),
    "augment.horizontal": ("not said", 0.5, "Flips with probability 0.5 each"),
    "optim.clip": ("not said", 1.0, "gradients are clipped at 1"),
}


@pytest.fixture(scope="module")
def config():
    return compose("anytouch2", ["data=recordings", "data.root=touches"])


@pytest.mark.parametrize("key", EQUAL)
def test_a_number_is_the_papers(config, key: str) -> None:
    found = OmegaConf.select(OmegaConf.create(config), key)
    wanted = EQUAL[key]
    assert found == (wanted if isinstance(wanted, str) else pytest.approx(wanted, abs=1e-9))


@pytest.mark.parametrize("key", LISTED)
def test_what_differs_or_is_not_said_is_on_the_card(config, key: str) -> None:
    _, ours, words = LISTED[key]
    assert OmegaConf.select(OmegaConf.create(config), key) == ours
    assert words in " ".join(CARD.read_text("utf-8").split())


def test_another_scale_or_encoder_starts_from_random_weights() -> None:
    def found(*words: str) -> list[object]:
        config = compose("anytouch2", words)
        return [config.init, config.text_encoder.name, config.image_encoder.name]

    assert found("scale=demo") == found("scale=tiny") == [None, "byte", "vit"]
    assert found("encoder=tactile_cnn") == [None, "clip", "clip"]
    assert found("encoder=tactile_cnn", "init=clip.vitb16")[0] == "clip.vitb16"
    assert found("text_encoder=byte", "init=null") == [None, "byte", "clip"]
    assert compose("mae").init is None


def test_without_a_network_the_start_says_how_to_go_on(tmp_path: Path) -> None:
    words = ["data.scenes=3", "data.val=1", "data.size=32", "debug=steps"]
    with pytest.raises(ConfigError, match=r"^init=clip.vitb16: .*zoo get clip.vitb16 accept=MIT.*"):
        train(compose("anytouch2", words), folder=tmp_path)
    with pytest.raises(ConfigError, match=r"encoder.size=base.*, or init=null"):
        inflated("clip.vitb16", {"size": "base"}, {}, {"size": "tiny"})


def test_a_set_is_packed_whole_and_the_card_says_so() -> None:
    assert Filter() == Filter(every=None, laplacian=None)
    card = " ".join(CARD.read_text("utf-8").split())
    assert "`pack.filter.laplacian` and `pack.filter.every`" in card
