import numpy as np
import pytest
import torch
from tactileforge_sim.optics.border import border

SIZE = (120, 160)


def drawn(dark: float, glow: float, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    shape, lamp = (torch.Generator().manual_seed(seed + part) for part in (0, 1000))
    return border(SIZE, dark, glow, shape, lamp)


def test_a_frame_is_dark_at_the_border_and_leaves_the_middle() -> None:
    darkest = []
    for seed in range(16):
        seen, glow = drawn(0.9, 0.0, seed)
        assert seen[30:90, 40:120].min() > 0.999
        darkest.append(float(seen[[0, 0, -1, -1], [0, -1, 0, -1]].min()))
        assert not glow.any()
    assert min(darkest) == pytest.approx(0.1, abs=0.02)
    # sides may lie outside of the picture, all four together in few
    assert np.median(darkest) < 0.5


def test_without_a_frame_all_light_passes() -> None:
    seen, _ = drawn(0.0, 0.0)
    assert torch.equal(seen, torch.ones(SIZE))


def test_a_lamp_glows_green_at_one_side() -> None:
    _, glow = drawn(0.0, 100.0)
    assert torch.equal(glow.argmax(0)[glow.sum(0) > 1].unique(), torch.tensor([1]))
    left, right = glow[1, :, :40].mean(), glow[1, :, -40:].mean()
    assert max(left, right) > 20 * min(left, right)
