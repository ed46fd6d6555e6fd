"""The baselines learn in the demo setting, on a few touches in half a minute each."""

import math
from pathlib import Path

import pytest
import torch

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.pages.curves import read_metrics
from tactileforge.training.module import TouchModule

pytestmark = pytest.mark.slow

TOUCHES, BATCH = 12, 16
#: Loss of an alignment that tells nothing.
CHANCE = math.log(BATCH)


def learn(
    recipe: str, folder: Path, *words: str, steps: int = 120
) -> tuple[TouchModule, dict[str, float]]:
    """A recipe after a few steps; the means of its last logged values, by name."""
    overrides = ["scale=demo", f"data.scenes={TOUCHES}", "data.val=2", "data.size=64"]
    overrides += ["encoder.image_size=64", "encoder.depth=2"]
    overrides += [f"batch.size={BATCH}"]
    overrides += [f"trainer.max_steps={steps}", f"trainer.val_check_interval={steps}"]
    module = train(compose(recipe, [*overrides, *words]), folder)
    curves = read_metrics(folder)
    return module, {name: float(curve.values[-3:].mean()) for name, curve in curves.items()}


def test_mae_fills_in_patches_better_than_the_gel_at_rest_would(tmp_path: Path) -> None:
    """The gel at rest is learned within the first steps."""
    learn("mae", tmp_path, "trainer.val_check_interval=20")
    losses = read_metrics(tmp_path)["val/pixel"].values
    assert losses[-1] < 0.98 * losses[0]
    assert losses[-1] < 1.01 * losses.min()  # does not rise again


def test_vjepa_predicts_the_features_of_this_touch(tmp_path: Path) -> None:
    """The prediction is nearer to this clip than are another clip and the mean of all."""
    module, _ = learn("vjepa", tmp_path)
    batch = next(iter(module.trainer.datamodule.val_dataloader()))
    with torch.no_grad():
        found = module.heads["jepa"](module.encoder.views(batch), batch)
    own = (found.predicted - found.target).abs().mean()
    assert own < 0.75 * (found.predicted - found.target.roll(3, 0)).abs().mean()
    assert own < 0.85 * (found.target - found.target.mean(0)).abs().mean()


def test_dino_tells_clips_apart(tmp_path: Path) -> None:
    """A student with one answer for every clip diverges by the teacher's information."""
    _, last = learn("dino", tmp_path)
    assert last["train/dino/information"] > 0.3  # nats; 0 where it has collapsed
    assert last["train/dino"] < 0.6 * last["train/dino/information"]


def test_anytouch1_learns_in_both_stages(tmp_path: Path) -> None:
    _, last = learn("anytouch1", tmp_path)
    assert last["train/pixel"] < 0.8 * float(read_metrics(tmp_path)["train/pixel"].values[0])
    for name in ("touch_text", "touch_image"):
        assert last[f"train/align/{name}"] < 0.85 * CHANCE


def test_unitouch_aligns_touch_with_images(tmp_path: Path) -> None:
    _, last = learn("unitouch", tmp_path, steps=80)
    assert last["train/touch_vision/touch_image"] < 0.85 * CHANCE


def test_t3_names_what_is_touched(tmp_path: Path) -> None:
    _, last = learn("t3", tmp_path)
    assert last["train/pixel"] < 0.8 * float(read_metrics(tmp_path)["train/pixel"].values[0])
    assert last["train/classify/accuracy"] > 3 / TOUCHES
