"""The surface is read below each patch, and scored along each axis."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from tactileforge.contracts import Batch, Features
from tactileforge.data.labels import displacement
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.surface import SurfaceHead
from tactileforge.objectives.surface import Surface


def moved_by(encoder: TactileViT, slot: int, row: int, column: int) -> Tensor:
    """Places of the surface changed by one token, bool (T, 32, 32)."""
    head = SurfaceHead(encoder)
    slots, rows, columns = encoder.grid
    tokens = torch.zeros(1, encoder.prefix + slots * rows * columns, encoder.width)
    tokens[0, encoder.prefix + (slot * rows + row) * columns + column] = 1.0
    views = SimpleNamespace(full=Features(tokens, tokens[:, 0], encoder.prefix, encoder.grid))
    prediction = head(views, {})
    assert prediction.shape == (1, encoder.frames, 3, *displacement.SHAPE)
    return (prediction[0] != 0).any(1)


def test_a_token_moves_its_own_patch_alone() -> None:
    moved = moved_by(TactileViT("tiny", frames=4, image_size=64), 1, 2, 3)
    want = torch.zeros_like(moved)
    want[2:4, 16:24, 24:32] = True
    assert torch.equal(moved, want)


def test_patches_that_do_not_divide_the_surface_move_what_they_cover() -> None:
    moved = moved_by(TactileViT("tiny", frames=4, image_size=48), 0, 1, 2)
    # three patches to 32 places: the second covers 10.7 to 21.3, the third 21.3 to 32
    want = torch.zeros_like(moved)
    want[:2, 11:21, 22:] = True
    assert moved[want].all()
    # beside it, what bilinear resampling spreads
    want[:2, 10:22, 21:] = True
    assert not moved[~want].any()


def test_the_loss_is_the_squared_error_in_deviations(batch: Batch) -> None:
    true = (batch["surface"].float() - displacement.NONE) / 127
    off = true.clone()
    off[:, :, 2] += 0.06
    off[~batch["surface_valid"]] = 9.0  # not labelled: it does not count
    loss, _ = Surface(deviation=(0.2, 0.2, 0.12))(off, batch)
    assert loss.item() == pytest.approx(0.25 / 3, rel=1e-5)


def test_scores_are_r2_of_all_batches(batch: Batch) -> None:
    true = (batch["surface"].float() - displacement.NONE) / 127
    said = true + 0.1 * torch.randn_like(true)
    objective = Surface()
    halves = [
        objective.sums(said[rows], {key: batch[key][rows] for key in ("surface", "surface_valid")})
        for rows in (slice(0, 4), slice(4, 8))
    ]
    scores = objective.scores(halves[0] + halves[1])
    known = batch["surface_valid"]
    for i, axis in enumerate("xyz"):
        x, y = said[known][:, :, i].double(), true[known][:, :, i].double()
        want = 1 - ((x - y) ** 2).sum() / ((y - y.mean()) ** 2).sum()
        assert scores[f"r2_{axis}"] == pytest.approx(want.item(), rel=1e-9)
    assert objective.scores(torch.zeros(4, 3, dtype=torch.float64)) == {}
