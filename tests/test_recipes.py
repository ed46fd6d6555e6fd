"""Every recipe of the zoo composes, names installed plugins, has a card, and trains two steps."""

from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.errors import ConfigError
from tactileforge.heads.jepa import JepaHead
from tactileforge.testing import batch as touches
from tactileforge.training.curriculum import from_config
from tactileforge.training.module import TouchModule

ZOO = Path(__file__).parents[1] / "zoo" / "recipe"
RECIPES = sorted(path.stem for path in ZOO.glob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("recipe", RECIPES)
def test_two_steps(recipe: str, tmp_path: Path) -> None:
    overrides = ["scale=demo", "debug=steps", "encoder.image_size=32", "batch.size=8"]
    overrides += ["data.scenes=3", "data.val=1", "data.size=32"]
    module = train(compose(recipe, overrides), tmp_path / "run")
    assert module.global_step == 2
    assert (tmp_path / "run" / "report.html").exists()
    assert (ZOO / f"{recipe}.md").read_text().startswith("---\ntitle:")


def test_anytouch2_is_the_papers() -> None:
    config = compose("anytouch2")
    assert config.encoder.size == "base"
    assert (config.encoder.frames, config.encoder.tube, config.encoder.mask_ratio) == (4, 2, 0.75)
    assert [config.head.pixel[k] for k in ("width", "depth", "heads")] == [512, 6, 8]
    assert {k: v.weight for k, v in config.objective.items()} == {
        "pixel": 1.0,
        "diff": 1.0,
        "align": 1.0,
        "match": 0.02,
        "force": 0.1,
    }
    assert (config.objective.align.alpha_tv, config.objective.align.alpha_tl) == (0.2, 0.2)
    starts = {key: row.start * 40 for key, row in config.curriculum.objective.items()}
    assert starts == {"match": 20, "force": 20, "align": 30}
    assert (config.curriculum.universal.low, config.curriculum.universal.high) == (0.0, 0.75)
    assert (config.batch.size, config.optim.lr, config.trainer.max_epochs) == (64, 3e-4, 40)
    assert config.optim.warmup * 40 == 1


def test_mae_is_sparshs() -> None:
    config = compose("mae")
    assert list(config.objective) == ["pixel"]
    assert (config.encoder.size, config.encoder.frames, config.encoder.tube) == ("base", 2, 2)
    assert list(config.encoder.image_size) == [320, 240]
    assert [config.head.pixel[k] for k in ("width", "depth", "heads")] == [512, 8, 16]
    assert (config.encoder.mask_ratio, config.optim.lr, config.trainer.max_epochs) == (
        0.75,
        1e-4,
        200,
    )


def test_vjepa_and_dino_are_sparshs() -> None:
    vjepa, dino = compose("vjepa"), compose("dino")
    assert (vjepa.encoder.frames, vjepa.encoder.tube, vjepa.encoder.positions) == (4, 2, "learned")
    assert [vjepa.head.jepa[k] for k in ("width", "depth", "heads")] == [384, 12, 12]
    assert (vjepa.optim.lr, dino.optim.lr) == (6.25e-4, 1e-4)
    assert (dino.encoder.frames, dino.encoder.registers) == (2, 1)
    assert (dino.head.dino.prototypes, dino.head.dino.momentum) == (65536, 0.998)
    assert list(dino.objective.dino.teacher_temperature) == [0.04, 0.07]
    assert dino.optim.warmup * dino.trainer.max_epochs == 30


def test_anytouch1_has_two_stages() -> None:
    """20 epochs of masked frames, then 12 with alignment and matching; a step is an epoch here."""
    plain = OmegaConf.to_container(compose("anytouch1"), resolve=True)
    weights = {key: node["weight"] for key, node in plain["objective"].items()}
    plan = from_config(plain["curriculum"], weights, total=32, epoch=1)
    assert plan.weights(19) == {"pixel": 1.0, "align": 0.0, "match": 0.0}
    assert plan.weights(20) == plan.weights(31) == {"pixel": 1.0, "align": 1.0, "match": 0.1}
    assert (plan.universal(0), plan.universal(32)) == (0.0, 0.75)
    assert plain["objective"]["match"]["of_action"] == 0  # objects across sensors only


def test_unitouch_trains_touch_against_a_frozen_image_tower() -> None:
    small = ["encoder.size=tiny", "encoder.image_size=28", "image_encoder=vit"]
    plain = OmegaConf.to_container(compose("unitouch", small), resolve=True)
    module = TouchModule.from_config(plain, {"text", "image"})
    head = module.heads["touch_vision"]
    assert head.text_encoder is None
    assert not any(p.requires_grad for p in head.image_encoder.parameters())
    batch = touches(size=4, frames=1)
    module.losses(batch, {"touch_vision": 1.0})[0].backward()
    assert all(p.grad is None for p in head.image_encoder.parameters())
    for part in (module.encoder.sensor_table, module.encoder.embed.weight, head.log_scale):
        assert part.grad.abs().max() > 0
    with pytest.raises(ConfigError, match=r"'touch_vision' has nothing to align with: .* text;"):
        TouchModule.from_config(plain, {"text"})


def test_t3_gives_each_sensor_a_stem_and_then_labels() -> None:
    config = compose("t3")
    assert config.encoder.stems == len(config.encoder.sensors) == len(config.encoder.pixels.mean)
    assert (config.encoder.frames, config.encoder.mask_ratio, config.encoder.stem_depth) == (
        1,
        0.4,
        3,
    )
    assert config.curriculum.objective.classify.start == 0.5


@pytest.mark.slow
def test_what_follows_the_encoder_starts_with_it_and_goes_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run's own weights, step by step, give its slow copy by the closed form."""
    seen: list[tuple[int, int, torch.Tensor]] = []
    follow = JepaHead.after_step

    def note(head: JepaHead, encoder: PlainViT, step: int, total: int) -> None:
        seen.append((step, total, encoder.norm_out.bias.detach().clone()))
        follow(head, encoder, step, total)

    monkeypatch.setattr(JepaHead, "after_step", note)
    overrides = ["scale=demo", "debug=steps", "encoder.image_size=32", "batch.size=8"]
    overrides += ["data.scenes=3", "data.val=1", "data.size=32", "head.jepa.momentum=0.5"]
    module = train(compose("vjepa", [*overrides, "optim.lr=0.1", "optim.warmup=1.0"]), tmp_path)
    assert [(step, total) for step, total, _ in seen] == [(0, 2), (1, 2), (2, 2)]
    biases = [bias for _, _, bias in seen]
    slow = module.heads["jepa"].target.network.norm_out.bias
    torch.testing.assert_close(slow, 0.75 * biases[0] + 0.25 * biases[1])  # the last keeps all
    assert (biases[0] - biases[1]).abs().max() > 1e-3
