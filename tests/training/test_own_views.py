"""Views and ramps of one's own: a second crop, another mask, a curve for the weight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

import tactileforge
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.views import ComputedViews
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.pages.curves import read_metrics
from tactileforge.testing import batch
from tactileforge.training.curriculum import from_config


@pytest.fixture(scope="module")
def encoder() -> TactileViT:
    torch.manual_seed(0)
    return TactileViT("tiny", frames=4, image_size=32, depth=1).eval()


def test_another_view_of_the_same_batch_is_the_same_encoder(encoder: TactileViT) -> None:
    made = batch(4)
    views = encoder.views(made)
    assert torch.equal(views.full.cls, views.other(made).full.cls)
    crop = {key: made[key][..., 8:, 8:] for key in ("frames", "background")}
    second = views.other({**made, **crop}).full
    expected = encoder(crop["frames"], crop["background"], encoder.sensor_ids(made["sensor"]))
    assert torch.equal(second.cls, expected[1])
    assert not torch.equal(second.cls, views.full.cls)
    second.cls.sum().backward()
    assert encoder.embed.weight.grad is not None


def test_a_mask_of_ones_own_shows_its_places(encoder: TactileViT) -> None:
    made = batch(2)
    kept = torch.tensor([[3, 0], [1, 2]])
    seen = encoder.views(made).other(made, kept).masked
    assert seen.kept.tolist() == [[0, 3], [1, 2]]
    assert seen.masked.tolist() == [[1, 2], [0, 3]]
    hidden = {**made, "frames": made["frames"].clone()}
    hidden["frames"][0, ..., 16:, :16] = 7  # place 2 of the first sample, which is hidden there
    again = encoder.views(made).other(hidden, kept).masked
    assert torch.equal(seen.tokens, again.tokens)


@pytest.mark.parametrize(
    "kept", [torch.zeros(3, 2, dtype=torch.int64), torch.zeros(2, 2), torch.zeros(2, 0).long()]
)
def test_places_that_do_not_fit_are_named(encoder: TactileViT, kept: torch.Tensor) -> None:
    made = batch(2)
    with pytest.raises(TactileForgeError, match=r"kept is .*; give int64 \(2, K\), K of .* 0 to 3"):
        encoder.views(made).other(made, kept)


def test_tokens_computed_once_have_no_other_view() -> None:
    with pytest.raises(TactileForgeError, match="there are no pixels"):
        ComputedViews(None).other({})


def test_a_ramp_of_ones_own_goes_behind_a_row() -> None:
    own = {"a": lambda share: share**2, "b": lambda share: 1 - share}
    config: dict[str, Any] = {"objective": {"b": {"start": 0.5, "end": 1.0}}}
    plan = from_config(config, {"a": 0.5, "b": 1.0, "c": 2.0}, 100, 10, own)
    assert plan.weights(50) == {"a": 0.125, "b": 0.0, "c": 2.0}
    assert plan.weights(100) == {"a": 0.5, "b": 1.0, "c": 2.0}
    for odd in (float("nan"), -1.0, None):
        plan = from_config({}, {"a": 1.0}, 100, 10, {"a": lambda _, odd=odd: odd})
        with pytest.raises(ConfigError, match=r"objective a: ramp\(0\.5\) is .*; give a finite"):
            plan.weights(50)


class TwoCrops(nn.Module):
    """Vectors of a clip and of its corner."""

    def __init__(self, encoder: Any, width: int = 64) -> None:
        super().__init__()
        self.layer = nn.Linear(encoder.projected, width)

    def forward(self, views: Any, batch: Any) -> Any:
        crop = {key: batch[key][..., 8:, 8:] for key in ("frames", "background")}
        second = views.other({**batch, **crop})
        return self.layer(views.full.cls), self.layer(second.full.cls)


class Contrast(nn.Module):
    """The same clip has the nearest vector; its weight falls over the run."""

    head, needs = TwoCrops, frozenset[str]()

    def forward(self, prediction: Any, batch: Any) -> Any:
        first, second = (nn.functional.normalize(x, dim=-1) for x in prediction)
        return nn.functional.cross_entropy(5 * first @ second.T, torch.arange(len(first))), {}

    def ramp(self, share: float) -> float:
        return 1 - share


@pytest.mark.slow
def test_a_local_objective_with_a_second_crop_trains(tmp_path: Path) -> None:
    run = tactileforge.train(
        *("recipe=mae", "scale=tiny", "debug=none", "data=sim", "data.scenes=3", "data.val=1"),
        *("data.size=32", "encoder.image_size=32", "encoder.depth=1", "batch.size=4"),
        *("batch.workers=0", "trainer.max_epochs=-1", "trainer.max_steps=4"),
        *("trainer.log_every_n_steps=1", "+head.contrast.width=32"),
        objective=["pixel", Contrast],
        folder=tmp_path / "run",
    )
    assert run.module is not None
    assert run.module.heads["contrast"].layer.out_features == 32
    weights = read_metrics(run.folder)["weight/contrast"].values
    assert weights == pytest.approx([1.0, 0.75, 0.5, 0.25])
    before = tactileforge.api.TouchModule.from_config(run.config, {"image"}).state_dict()
    after = run.module.state_dict()
    changed = [k for k in after if k.startswith("encoder.") and not after[k].equal(before[k])]
    assert changed
