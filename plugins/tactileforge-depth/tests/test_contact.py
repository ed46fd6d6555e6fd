import math

import pytest
import torch
from planes import plane
from tactileforge_depth import contact
from tactileforge_depth.gel import Gel, kernel
from tactileforge_sim.mechanics.touch import contacts
from torch import Tensor


def press(
    gel: Gel, overlap: Tensor, spacing: float, tolerance: float = contact.TOLERANCE
) -> tuple[Tensor, Tensor]:
    """Pressure, and force in N."""
    pressure = contact.press(kernel(gel, overlap.shape[-1], spacing), overlap, tolerance=tolerance)
    return pressure, pressure.sum((1, 2)) * spacing**2


def sphere(radius: float, depths: Tensor, points: int, spacing: float) -> Tensor:
    x, y = plane(points, spacing)
    rise = radius - torch.sqrt((radius**2 - x**2 - y**2).clamp(min=0))
    return depths[:, None, None] - rise


@pytest.mark.slow
def test_hertz_over_a_decade_of_depth() -> None:
    radius = 10.0
    for depth in (0.03, 0.1, 0.3):
        wanted = math.sqrt(radius * depth)
        gel, spacing = Gel(thickness=100 * wanted, poisson=0.4), 2.6 * wanted / 64
        plane_modulus = gel.modulus / (1 - gel.poisson**2)
        x, y = plane(64, spacing)
        pressure, force = press(gel, (depth - (x**2 + y**2) / (2 * radius))[None], spacing)
        hertz = 4 / 3 * plane_modulus * math.sqrt(radius) * depth**1.5
        assert float(force) == pytest.approx(hertz, rel=0.02)
        measured = math.sqrt(float((pressure > 0).sum()) * spacing**2 / math.pi)
        assert measured == pytest.approx(wanted, rel=0.03)


@pytest.mark.slow
def test_flat_punch_is_sneddons() -> None:
    gel, radius, depth, spacing = Gel(thickness=200.0, poisson=0.4), 2.0, 0.1, 5 / 128
    x, y = plane(128, spacing)
    away = torch.hypot(x, y)
    overlap = torch.where(away < radius, depth, -4.0)[None]
    pressure, force = press(gel, overlap, spacing, tolerance=1e-4)
    plane_modulus = gel.modulus / (1 - gel.poisson**2)
    assert float(force) == pytest.approx(2 * plane_modulus * radius * depth, rel=0.03)
    middle = away < 0.75 * radius
    wanted = plane_modulus * depth / (math.pi * torch.sqrt(radius**2 - away[middle] ** 2))
    torch.testing.assert_close(pressure[0][middle], wanted, rtol=0.03, atol=0)


def test_bonded_layer_is_dimitriadis() -> None:
    gel, radius = Gel(), 7.5
    depths = torch.tensor([0.5, 1.0, 1.5, 2.0])
    _, force = press(gel, sphere(radius, depths, 64, 0.22), 0.22)
    x = torch.sqrt(radius * depths) / gel.thickness
    series = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
    wanted = 16 / 9 * gel.modulus * math.sqrt(radius) * depths**1.5 * series
    torch.testing.assert_close(force, wanted, rtol=0.10, atol=0)


def test_forces_measured_on_a_gelsight_mini() -> None:
    """A sphere of 15 mm, with FEATS' friction of 1 (Helmut et al., 2024)."""
    poses = torch.zeros(1, 13, 6)
    poses[0, :, 3] = torch.linspace(0, 2, 13)
    height = -sphere(7.5, torch.zeros(1), 64, 0.22)
    moments = list(contacts(height, 0.22, [Gel(friction=1.0)], poses, [30.0]))
    force = torch.stack([moments[i].force[0, 2] for i in (3, 6, 9, 12)])
    measured = torch.tensor([1.650, 5.964, 13.526, 23.253])
    torch.testing.assert_close(force, measured, rtol=0.1, atol=0)


def test_refinement_converges() -> None:
    forces = []
    for points in (24, 48, 96):
        spacing = 12 / points
        x, y = plane(points, spacing)
        square = 6 * torch.maximum(x.abs() - 3.1, y.abs() - 1.9).clamp(min=0)
        tip = torch.maximum(square, (x**2 + y**2) / 40)
        forces.append(float(press(Gel(), (0.8 - tip)[None], spacing)[1]))
    assert abs(forces[2] - forces[1]) < 0.5 * abs(forces[1] - forces[0])
    assert forces[1] == pytest.approx(forces[2], rel=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_complementarity_of_random_scenes(seed: int) -> None:
    random = torch.Generator().manual_seed(seed)
    n, spacing = 48, 0.22
    waves = torch.randn(3, 1, 6, 6, generator=random)
    bumps = torch.nn.functional.interpolate(waves, (n, n), mode="bicubic")[:, 0]
    depths = torch.tensor([0.1, 0.6, -0.2])
    overlap = depths[:, None, None] + 0.3 * (bumps - bumps.amax((1, 2), keepdim=True))
    grid = kernel(Gel(), n, spacing)
    pressure = contact.press(grid, overlap)
    gap = grid.press(pressure) - overlap
    allowed = contact.TOLERANCE * 0.6
    assert bool((pressure >= 0).all())
    assert float(gap.min()) > -allowed
    assert float((gap * (pressure > 0)).abs().max()) < allowed
    assert float(pressure[2].max()) == 0
    assert bool((pressure[:2].sum((1, 2)) > 0).all())


def test_start_of_the_frame_before_changes_nothing_but_the_time() -> None:
    grid = kernel(Gel(), 48, 0.22)
    overlap = sphere(4.0, torch.tensor([0.8]), 48, 0.22)
    wanted = contact.press(grid, overlap, tolerance=1e-4)
    for start in (0 * wanted, 2 * wanted, wanted.roll(1, 2)):
        pressure = contact.press(grid, overlap, start, tolerance=1e-4)
        assert float(pressure.sum()) == pytest.approx(float(wanted.sum()), rel=2e-3)


def test_a_start_that_leads_nowhere_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A corner just on the gel, from a start a thousand times too high."""
    gel = Gel()
    x, y = plane(48, 0.2)
    corner = 0.0112 - 0.05 * (x + y + 2.2).abs() - 0.02 * (x - y).abs()
    settled, _ = press(gel, corner[None], 0.2)
    solver, steps = kernel(gel, 48, 0.2), contact._STEPS
    tried = []
    first = contact._first
    monkeypatch.setattr(contact, "_first", lambda *given: tried.append(1) or first(*given))
    monkeypatch.setattr(contact, "_STEPS", 1)
    with pytest.raises(contact.NotConverged, match="did not settle in 1 steps"):
        contact.press(solver, corner[None], 1e3 * torch.ones(1, 48, 48), tolerance=1e-12)
    assert len(tried) == 2
    monkeypatch.setattr(contact, "_STEPS", steps)
    again = contact.press(solver, corner[None], 1e3 * torch.ones(1, 48, 48))
    assert torch.allclose(again, settled, atol=0.02 * float(settled.max()))


def test_batch_equals_single() -> None:
    grid = kernel(Gel(), 32, 0.3)
    overlap = sphere(4.0, torch.tensor([0.2, 0.9, -1.0]), 32, 0.3)
    batch = contact.press(grid, overlap, tolerance=1e-4)
    for batched, alone in zip(batch, overlap, strict=True):
        single = contact.press(grid, alone[None], tolerance=1e-4)[0]
        assert float((batched - single).abs().max()) <= 0.02 * max(float(batched.max()), 1e-9)


def test_failure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contact, "_STEPS", 2)
    grid = kernel(Gel(), 32, 0.3)
    with pytest.raises(contact.NotConverged, match=r"contact 1 of 2 did not settle in 2 steps"):
        contact.press(grid, sphere(4.0, torch.tensor([-1.0, 0.9]), 32, 0.3))
