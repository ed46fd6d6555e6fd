import pytest
import torch

from tactileforge.specs.published import spec
from tactileforge.testing import batch


def test_batch_has_every_key_of_the_contract():
    made = batch(size=6, frames=2, image=24)
    shapes = {key: tuple(value.shape) for key, value in made.items() if not isinstance(value, list)}
    assert shapes == {
        "frames": (6, 2, 3, 24, 24),
        "background": (6, 3, 24, 24),
        "force": (6, 2, 3),
        "force_valid": (6, 3),
        "force_scale": (6, 3),
        "action": (6,),
        "object": (6,),
        "image": (6, 3, 24, 24),
        "image_valid": (6,),
        "surface": (6, 2, 3, 32, 32),
        "surface_valid": (6,),
        "group": (6,),
        "aspect": (6,),
        "upright": (6,),
    }
    assert made["sensor"] == ["gelsight", "digit"] * 3
    assert all(made["text"])
    assert torch.equal(made["frames"], batch(size=6, frames=2, image=24)["frames"])
    assert not torch.equal(made["frames"], batch(size=6, frames=2, image=24, seed=1)["frames"])


def test_batch_presses_deeper_as_the_force_rises():
    made = batch()
    change = (made["frames"].float() - made["background"][:, None].float()).abs().mean((2, 3, 4))
    assert (change.diff(dim=1) > 0).all()
    assert (made["force"][..., 2].diff(dim=1) > 0).all()


def test_force_scales_are_those_of_the_sensors():
    scale = batch(size=2)["force_scale"]
    for row, name in zip(scale.tolist(), ("gelsight", "digit"), strict=True):
        assert row == pytest.approx(spec(name).force_scale)
