"""The recipes of the zoo learn in the demo setting, on a few touches in a minute."""

from pathlib import Path

import pytest
import torch

from tactileforge.compose import compose
from tactileforge.module import TouchModule
from tactileforge.report.metrics import read_metrics
from tactileforge.train import train

pytestmark = pytest.mark.slow

STEPS = 200


def learn(recipe: str, folder: Path, *words: str) -> tuple[TouchModule, dict[str, float]]:
    """A recipe after a minute; the means of its last logged values, by name."""
    overrides = ["scale=demo", "data.scenes=12", "data.val=2", "data.size=64", "batch.size=16"]
    overrides += [f"trainer.max_steps={STEPS}", f"trainer.val_check_interval={STEPS}"]
    module = train(compose(recipe, [*overrides, *words]), folder)
    curves = read_metrics(folder)
    return module, {name: float(curve.values[-3:].mean()) for name, curve in curves.items()}


def test_mae_fills_in_patches(tmp_path: Path) -> None:
    _, last = learn("mae", tmp_path)
    first = float(read_metrics(tmp_path)["train/pixel"].values[0])
    assert last["train/pixel"] < 0.8 * first


def test_vjepa_predicts_the_features_of_this_touch(tmp_path: Path) -> None:
    """Its prediction is nearer to the features of the clip than to those of another one."""
    module, last = learn("vjepa", tmp_path)
    assert last["train/jepa/spread"] > 0.1, "the encoder has collapsed"
    batch = next(iter(module.trainer.datamodule.val_dataloader()))
    with torch.no_grad():
        found = module.heads["jepa"](module.encoder.views(batch), batch)
    own = (found.predicted - found.target).abs().mean()
    other = (found.predicted - found.target.roll(3, 0)).abs().mean()
    assert own < 0.8 * other


def test_dino_tells_clips_apart(tmp_path: Path) -> None:
    _, last = learn("dino", tmp_path)
    assert last["train/dino/information"] > 0.5  # nats; 0 where it has collapsed
    first = float(read_metrics(tmp_path)["train/dino"].values[0])
    assert last["train/dino"] < first


def test_anytouch1_learns_in_both_stages(tmp_path: Path) -> None:
    _, last = learn("anytouch1", tmp_path)
    first = float(read_metrics(tmp_path)["train/pixel"].values[0])
    assert last["train/pixel"] < 0.6 * first
    assert last["train/align/touch_text"] < 0.9 * float(torch.tensor(16.0).log())


def test_unitouch_aligns_touch_with_images(tmp_path: Path) -> None:
    _, last = learn("unitouch", tmp_path)
    assert last["train/touch_vision/touch_image"] < 0.9 * float(torch.tensor(16.0).log())


def test_t3_names_what_is_touched(tmp_path: Path) -> None:
    _, last = learn("t3", tmp_path)
    first = float(read_metrics(tmp_path)["train/pixel"].values[0])
    assert last["train/pixel"] < 0.8 * first
    assert last["train/classify/accuracy"] > 3 / 12  # of twelve touches
