from typing import Any

import pytest
import torch

from tactileforge.cli._compose import compose
from tactileforge.contracts import Batch
from tactileforge.errors import ConfigError, PluginError
from tactileforge.training import parts
from tactileforge.training.assemble import build_data
from tactileforge.training.module import TouchModule
from tactileforge.training.parts import outline
from tactileforge.util.distributed import masked_mean

SMALL = ["scale=demo", "encoder.image_size=32"]
TINY_DATA = ["data.scenes=3", "data.val=1", "data.size=32"]


def plain(*overrides: str) -> dict:
    from omegaconf import OmegaConf

    data = [] if any(word.startswith("data=") for word in overrides) else TINY_DATA
    return OmegaConf.to_container(compose("anytouch2", [*SMALL, *data, *overrides]), resolve=True)


@pytest.fixture
def module() -> TouchModule:
    return TouchModule.from_config(plain(), {"text", "image"})


ALL = dict.fromkeys(("pixel", "diff", "align", "match", "force"), 1.0)


def test_the_loss_is_the_weighted_sum(module: TouchModule, batch: Batch) -> None:
    weights = {"pixel": 1.0, "diff": 0.5, "align": 2.0, "match": 0.02, "force": 0.1}
    total, logs = module.losses(batch, weights)
    expected = sum(weights[key] * logs[key].item() for key in weights)
    assert total.item() == pytest.approx(expected, rel=1e-5)


def test_at_most_one_pass_a_view(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes: list[tuple[str, int]] = []
    for name in ("encode", "encode_both"):
        old = getattr(module.encoder, name)
        monkeypatch.setattr(
            module.encoder,
            name,
            lambda *a, old=old, name=name, **k: passes.append((name, len(a))) or old(*a, **k),
        )
    module.losses(batch, ALL)
    assert passes == [("encode_both", 3)]  # in one pass
    passes.clear()
    masked = ALL | {"align": 0.0, "match": 0.0, "force": 0.0}
    module.losses(batch, masked)
    assert passes == [("encode", 3)]  # the full view is not computed
    passes.clear()
    module.losses(batch, ALL | {"pixel": 0.0, "diff": 0.0})
    assert passes == [("encode", 2)]
    passes.clear()
    # a measured objective is differentiated alone: its graph holds no other view
    module.balance.every = 1
    module.losses(batch, ALL)
    assert sorted(passes) == [("encode", 2), ("encode", 3)]


def test_a_head_that_does_not_say_what_it_reads_has_its_view(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(0)
    said, _ = module.losses(batch, ALL)
    for head in module.heads.values():
        monkeypatch.delattr(type(head), "reads")
    torch.manual_seed(0)
    torch.testing.assert_close(module.losses(batch, ALL)[0], said)


def test_an_objective_of_weight_0_is_not_computed(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def called(*_: object) -> None:
        raise AssertionError("computed")

    monkeypatch.setattr(module.heads["force"], "forward", called)
    monkeypatch.setattr(module.objectives["force"], "forward", called)
    total, logs = module.losses(batch, ALL | {"force": 0.0})
    total.backward()
    assert "force" not in logs
    assert all(p.grad is None for p in module.heads["force"].parameters())


def test_a_step_does_not_wait_for_a_number(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On an accelerator each of these would stop the host until the device is done."""

    def waits(*_: object) -> None:
        raise AssertionError("the step waits for the device")

    for name in ("item", "tolist", "__bool__", "__float__", "__int__", "nonzero", "numpy"):
        monkeypatch.setattr(torch.Tensor, name, waits)
    module.losses(batch, ALL)[0].backward()


def test_samples_without_a_label_change_nothing(module: TouchModule, batch: Batch) -> None:
    """Force, text and image of the labelled alone, and among others without."""
    nothing = torch.zeros(8, dtype=torch.bool)
    changed = batch | {
        "force": torch.where(batch["force_valid"][:, None], batch["force"], 1e6),
        "image": torch.where(batch["image_valid"][:, None, None, None], batch["image"], 7),
    }
    for name in ("force", "align"):
        torch.manual_seed(0)
        loss = module.losses(batch, {name: 1.0})[0]
        torch.manual_seed(0)
        assert module.losses(changed, {name: 1.0})[0].item() == loss.item() > 0
    bare = batch | {
        "force_valid": nothing[:, None].expand(8, 3),
        "image_valid": nothing,
        "text": [""] * 8,
    }
    bare |= {"group": torch.full((8,), -1)}
    assert module.losses(bare, {"force": 1.0, "align": 1.0, "match": 1.0})[0].item() == 0


def test_towers_are_built_for_what_the_data_has() -> None:
    module = TouchModule.from_config(plain(), {"text"})
    assert module.heads["align"].image_encoder is None
    assert module.heads["align"].text_encoder is not None


def test_a_text_tower_is_no_touch_encoder() -> None:
    with pytest.raises(ConfigError, match="encoder=byte encodes text, not touch"):
        TouchModule.from_config(plain() | {"encoder": {"name": "byte"}}, set())
    with pytest.raises(ConfigError, match="text_encoder=vit encodes image, not text"):
        TouchModule.from_config(plain() | {"text_encoder": {"name": "vit"}}, {"text"})


def test_a_label_that_the_data_does_not_have_is_an_error_before_training(tmp_path) -> None:
    import cv2
    import numpy as np

    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((32, 32, 3), np.uint8))
    (tmp_path / "tactileforge.yaml").write_text(
        "layouts: {s: {images: '*.png', each: touch, sensor: digit, background: none}}\n"
    )
    config = plain("data=recordings", f"data.root={tmp_path}", "objective=[pixel,force]")
    with pytest.raises(ConfigError, match="objective 'force' needs force, which the data does not"):
        build_data(config)


def test_sensors_of_the_data_get_rows_and_the_configuration_says_so() -> None:
    config = plain("+encoder.sensors={digit: 4}")
    table = build_data(config)[1]["sensors"]
    assert table["digit"] == 4
    assert len(set(table.values())) == len(table) == 3


def test_an_encoder_of_any_size_is_refused_before_it_is_built(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = {"name": "tactile_vit", "size": "tiny", "image_size": 32}
    before = torch.random.get_rng_state()
    outline(node)
    assert torch.equal(torch.random.get_rng_state(), before), "it draws nothing"
    with pytest.raises(ConfigError, match=r"image_size=\[32, 100000\]: at most 8192"):
        outline(node | {"image_size": [32, 100000]})
    monkeypatch.setattr(parts, "_MOST", 1000)
    with pytest.raises(ConfigError, match="weights, and at most 1,000 are built"):
        outline(node)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["encoder.mask_ratio=0"], "encoder.mask_ratio=0 hides none of 4 places"),
        (["encoder.frames=1", "encoder.tube=1", "objective=[diff]"], "head.diff reads frames 2"),
        (["encoder.frames=1", "encoder.tube=1", "objective=[force]"], "head.force reads frames 2"),
        (["encoder.frames=0"], "frames=0, tube=2"),
        (["encoder.pixels.std=[0,1,1]"], "std above 0"),
        (["balance=gradnorm", "balance.keep=-3", "objective=[force]"], "balance.keep"),
    ],
)
def test_numbers_with_which_nothing_is_learned_are_named(words: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        TouchModule.from_config(plain(*words), {"force"})


def test_validation_leaves_out_what_has_no_label(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Means are over labels: a batch with few of them counts little, one without not at all."""
    shown: dict[str, float] = {}
    monkeypatch.setattr(module, "current_weights", lambda: {"force": 1.0, "pixel": 1.0})
    monkeypatch.setattr(module, "log_dict", lambda row, **_: shown.update(row))

    def validated(*batches: Batch) -> dict[str, float]:
        shown.clear()
        for number, each in enumerate(batches):
            module.validation_step(each, number)
        module.on_validation_epoch_end()
        return dict(shown)

    bare = batch | {"force_valid": torch.zeros(8, 3, dtype=torch.bool)}
    one = bare | {"force_valid": bare["force_valid"].clone()}
    one["force_valid"][0] = True
    full = batch | {"force_valid": torch.ones(8, 3, dtype=torch.bool)}
    few, many = (validated(each)["val/force"] for each in (one, full))
    assert few != pytest.approx(many, rel=1e-3)
    assert validated(full, one, bare)["val/force"] == pytest.approx((8 * many + few) / 9)
    nothing = validated(bare)
    assert "val/pixel" in nothing
    assert not [name for name in nothing if name.startswith("val/force")]
    monkeypatch.setattr(module, "current_weights", lambda: {"align": 1.0})
    seen = batch | {"image_valid": torch.ones(8, dtype=torch.bool)}
    blind = batch | {"image_valid": torch.zeros(8, dtype=torch.bool)}
    of_images = validated(seen)["val/align/touch_image"]
    assert of_images > 0.1
    assert validated(seen, blind, blind)["val/align/touch_image"] == pytest.approx(of_images)


class TwoParts(torch.nn.Module):
    """A loss over forces and one over every clip; what is logged of them is scaled and copied."""

    head, needs = "force", frozenset({"force"})

    def forward(self, prediction: Any, batch: Batch) -> tuple[Any, dict[str, Any]]:
        error = prediction.force.abs().mean((1, 2))
        some = masked_mean(error, batch["force_valid"][:, 2])
        every = masked_mean(error, torch.ones_like(batch["force_valid"][:, 2]))
        return 0.5 * some + every, {
            "plain": some,
            "scaled": 1000 * some.detach(),
            "copied": some.clone().float(),
            "root": some.map(torch.sqrt).map(torch.square),
            "every": every,
            "clips": error.detach().mean(),
        }


def test_what_is_made_of_a_mean_keeps_its_weight(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean over three batches is that over their labels, however the value was changed."""
    shown: dict[str, float] = {}
    module.objectives["force"] = TwoParts()
    monkeypatch.setattr(module, "current_weights", lambda: {"force": 1.0})
    monkeypatch.setattr(module, "log_dict", lambda row, **_: shown.update(row))
    errors, labelled = [], []
    for number, count in enumerate((1, 5, 0)):
        made = batch | {"force_valid": torch.zeros(8, 3, dtype=torch.bool)}
        made["force_valid"][:count] = True
        made["frames"] = batch["frames"].roll(40 * number, dims=-1)
        hook = module.heads["force"].register_forward_hook(
            lambda *said: errors.append(said[2].force.detach().abs().mean((1, 2)))
        )
        module.validation_step(made, number)
        hook.remove()
        labelled.append(made["force_valid"][:, 2])
    module.on_validation_epoch_end()
    some, every = torch.cat(errors)[torch.cat(labelled)].mean().item(), torch.cat(errors).mean()
    for name in ("plain", "copied", "root"):
        assert shown[f"val/force/{name}"] == pytest.approx(some, rel=1e-5), name
    assert shown["val/force/scaled"] == pytest.approx(1000 * some, rel=1e-5)
    for name in ("every", "clips"):
        assert shown[f"val/force/{name}"] == pytest.approx(every.item(), rel=1e-5), name
    assert some != pytest.approx(every.item(), rel=1e-3)


def test_an_objective_of_the_old_form_is_named(module: TouchModule, batch: Batch) -> None:
    def root(prediction: Any, made: Batch) -> tuple[Any, dict[str, Any]]:
        mean = masked_mean(prediction.force.abs().mean((1, 2)), made["force_valid"][:, 2])
        return mean.sqrt(), {}

    module.objectives["force"].forward = root
    with pytest.raises(PluginError, match=r"objective 'force': .*'sqrt': write mean\.map"):
        module.losses(batch, {"force": 1.0})
    module.objectives["force"].forward = lambda *_: (0.5, {})
    with pytest.raises(PluginError, match="objective 'force': the loss is no Mean and no tensor"):
        module.losses(batch, {"force": 1.0})


class _Returns(torch.nn.Module):
    """An objective with a given result, made of the prediction's first tensor."""

    def __init__(self, make: Any) -> None:
        super().__init__()
        self.make, self.calls = make, 0

    def forward(self, prediction: Any, batch: Batch) -> Any:
        self.calls += 1
        return self.make(batch["frames"].float().mean((1, 2, 3, 4)))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda x: (x, {}), r"objective 'pixel': the loss has shape \(\d+,\); it must be a scalar"),
        (lambda x: (x[:1], {}), r"the loss has shape \(1,\); it must be a scalar"),
        (lambda x: (x.mean(), {"rate": x}), r"objective 'pixel': rate has shape \(\d+,\)"),
        (lambda x: x.mean(), r"forward returned only a tensor of shape \(\); it must return the l"),
        (lambda x: x[:2], r"forward returned only a tensor of shape \(2,\)"),
        (lambda x: masked_mean(x, x > 0), "forward returned only a Mean"),
        (lambda x: (x.mean(), None), r"forward returned \(Tensor, NoneType\)"),
        (lambda x: None, "forward returned NoneType; it must return the loss and a mapping"),
    ],
)
def test_what_an_objective_returns_is_told_by_its_contract(
    module: TouchModule, batch: Batch, make: Any, said: str
) -> None:
    module.objectives["pixel"] = _Returns(make)
    with pytest.raises(PluginError, match=said):
        module.losses(batch, {"pixel": 1.0})


def test_shapes_are_looked_at_once(
    module: TouchModule, batch: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []
    monkeypatch.setattr(
        "tactileforge.training.module.check_scalars", lambda key, term: looked.append(key)
    )
    for _ in range(3):
        module.losses(batch, {"pixel": 1.0, "diff": 1.0})
    assert looked == ["pixel", "diff"]
