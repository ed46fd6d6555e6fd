"""Descriptors against closed forms, and under mirroring."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tactileforge.contracts import Batch
from tactileforge.data.labels import displacement
from tactileforge.data.labels.descriptors import (
    GROUPS,
    Descriptors,
    contact_descriptors,
    image_descriptors,
    spectrum_rings,
)


def dent(centre: tuple[float, float], depth: float, shear: tuple[float, float]) -> torch.Tensor:
    """A coded Gaussian dent, 0.2 of half the image wide: uint8 (1, 2, 3, 32, 32), first at rest."""
    x = np.linspace(-1, 1, 32, dtype=np.float32)
    shape = np.exp(-((x - centre[0]) ** 2 + (x[:, None] - centre[1]) ** 2) / (2 * 0.2**2))
    moved = np.stack([shear[0] * shape, shear[1] * shape, depth * shape], axis=2)
    last = displacement.encode_displacement(moved.astype(np.float32))
    rest = np.full_like(last, displacement.NONE)
    return torch.from_numpy(np.stack([rest, last])).permute(0, 3, 1, 2)[None]


def test_a_gaussian_dent_has_its_centre_covariance_depth_and_shear() -> None:
    said = contact_descriptors(dent((0.3, -0.2), 1.0, (0.2, -0.1)))[0]
    last, change = said[:18], said[18:]
    assert last[:2].tolist() == pytest.approx([0.3, -0.2], abs=0.01)
    assert last[2:5].tolist() == pytest.approx([0.04, 0.04, 0.0], abs=0.002)
    share = 2 * np.pi * 0.2**2 / (2 * 32 / 31) ** 2  # of a Gaussian's integral on this grid
    assert last[5].item() == pytest.approx(share, rel=0.02)
    assert last[6].item() == pytest.approx(1.0, rel=0.02)
    assert last[7:9].square().tolist() == pytest.approx(last[5:7].tolist(), rel=1e-5)
    assert last[10].item() == pytest.approx(0.2 * share, rel=0.05)
    assert last[11].item() == pytest.approx(-0.1 * share, rel=0.05)
    assert torch.equal(last, change)  # the first frame is at rest


def test_mirrored_touch_has_mirrored_descriptors() -> None:
    surface = dent((0.3, -0.2), 1.0, (0.2, -0.1))
    mirrored = displacement.mirror_displacement(surface, 0)
    flips = torch.ones(36)
    for place in (0, 4, 10, 14):  # centre x, covariance xy, shear x, twist
        flips[[place, 18 + place]] = -1
    said, other = contact_descriptors(surface), contact_descriptors(mirrored)
    assert torch.allclose(said * flips, other, atol=1e-5)


def test_no_contact_is_zero_in_the_middle() -> None:
    surface = torch.full((2, 4, 3, 32, 32), displacement.NONE, dtype=torch.uint8)
    assert not contact_descriptors(surface).any()


def test_image_descriptors_are_finite_for_blank_and_small_images() -> None:
    for size in (16, 128):
        assert image_descriptors(torch.zeros(2, 2, 3, size, size)).isfinite().all()
        assert spectrum_rings(torch.zeros(1, 3, size, size)).shape == (1, 3, 7)


def test_columns_are_in_their_groups_and_known_where_labelled(batch: Batch) -> None:
    batch = dict(batch)
    batch["surface_valid"] = torch.arange(len(batch["force"])) % 2 == 0
    batch["force_valid"] = torch.tensor([True, False, True]).expand(len(batch["force"]), 3)
    said = Descriptors.of(batch)
    assert said.values.shape == said.known.shape == (len(batch["force"]), Descriptors.COUNT)
    assert said.known[:, GROUPS["image"]].all()
    contact = said.known[:, GROUPS["contact"]]
    assert torch.equal(contact.all(1), batch["surface_valid"])
    assert torch.equal(contact.any(1), batch["surface_valid"])
    assert said.known[:, GROUPS["force"]][0].tolist() == [True, False, True] * 2
    newton = said.values[:, GROUPS["force"]][:, :3] * batch["force_scale"]
    assert torch.allclose(newton, batch["force"][:, -1].nan_to_num(), atol=1e-5)
