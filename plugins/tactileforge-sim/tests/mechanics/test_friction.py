import math

import pytest
import torch
from tactileforge_depth import contact
from tactileforge_depth.gel import Gel, Kernel, kernel
from tactileforge_sim.mechanics import friction
from torch import Tensor

MU, RADIUS, DEPTH = 0.8, 10.0, 0.2


@pytest.fixture(scope="module")
def hertz() -> tuple[Gel, Kernel, Tensor]:
    """A sphere on a thick gel: gel, kernel and pressure."""
    gel, n, spacing = Gel(thickness=300.0, poisson=0.4, friction=MU), 64, 6 / 64
    line = (torch.arange(n) - (n - 1) / 2) * spacing
    grid = kernel(gel, n, spacing)
    overlap = DEPTH - (line**2 + line[:, None] ** 2) / (2 * RADIUS)
    return gel, grid, contact.press(grid, overlap[None], tolerance=2e-4)


def drag(grid: Kernel, pressure: Tensor, steps: list[float]) -> list[Tensor]:
    """Shear after each step (mm) to the right."""
    out, shear = [], torch.zeros(1, 2, grid.points, grid.points)
    for step in steps:
        motion = torch.zeros_like(shear)
        motion[:, 0] = step
        shear = friction.shear(grid, MU * pressure, shear, motion, tolerance=2e-5)
        out.append(shear)
    return out


def force(grid: Kernel, shear: Tensor) -> float:
    return float(shear[:, 0].sum()) * grid.spacing**2


def test_cattaneo_and_mindlin(hertz: tuple[Gel, Kernel, Tensor]) -> None:
    gel, grid, pressure = hertz
    limit = MU * float(pressure.sum()) * grid.spacing**2
    radius = math.sqrt(RADIUS * DEPTH)
    for i, shear in enumerate(drag(grid, pressure, [0.02] * 8)):
        share = force(grid, shear) / limit
        sticking = (torch.linalg.vector_norm(shear, dim=1) < (1 - 1e-3) * MU * pressure).sum()
        core = math.sqrt(float(sticking) * grid.spacing**2 / math.pi)
        assert core == pytest.approx(radius * (1 - share) ** (1 / 3), rel=0.05)
        stiffness = 16 * gel.shear_modulus * radius / (3 * (2 - gel.poisson) * limit)
        mindlin = (1 - (1 - share) ** (2 / 3)) / stiffness
        assert mindlin == pytest.approx(0.02 * (i + 1), rel=0.05)


def test_full_slip_is_coulombs(hertz: tuple[Gel, Kernel, Tensor]) -> None:
    _, grid, pressure = hertz
    shear = drag(grid, pressure, [0.1] * 6)[-1]
    normal = float(pressure.sum()) * grid.spacing**2
    assert force(grid, shear) == pytest.approx(MU * normal, rel=1e-3)
    assert float(shear[:, 1].abs().max()) < 0.01 * float(shear.max())


def test_loading_and_reversal_enclose_work(hertz: tuple[Gel, Kernel, Tensor]) -> None:
    """Masing's rule: a reversal is the loading curve, twice as large."""
    _, grid, pressure = hertz
    there = [force(grid, s) for s in drag(grid, pressure, [0.03] * 4 + [-0.03] * 8 + [0.03] * 8)]
    for i in range(4):
        assert there[3] - there[3 + 2 * (i + 1)] == pytest.approx(2 * there[i], rel=0.02)
    assert there[11] == pytest.approx(-there[3], rel=0.02)
    assert there[19] == pytest.approx(there[3], rel=0.02)
    path = [0.03] * 8
    work = sum(step * f for step, f in zip(path, there[12:], strict=True))
    work -= sum(step * f for step, f in zip(path, there[4:12], strict=True))
    assert work > 0


def test_shear_never_exceeds_friction(hertz: tuple[Gel, Kernel, Tensor]) -> None:
    _, grid, pressure = hertz
    random = torch.Generator().manual_seed(1)
    shear = torch.zeros(1, 2, grid.points, grid.points)
    for scale in (1.0, 0.7, 1.2, 0.1, 0.0):
        motion = 0.05 * torch.randn(1, 2, 1, 1, generator=random).expand_as(shear)
        bound = MU * scale * pressure
        shear = friction.shear(grid, bound, shear, motion)
        assert bool((torch.linalg.vector_norm(shear, dim=1) <= bound * (1 + 1e-5)).all())
    assert float(shear.abs().max()) == 0


def test_sticking_points_follow_and_slipping_points_are_dragged(
    hertz: tuple[Gel, Kernel, Tensor],
) -> None:
    _, grid, pressure = hertz
    shear = drag(grid, pressure, [0.05])[0]
    size = torch.linalg.vector_norm(shear, dim=1)
    moved = grid.drag(shear)[:, 0]
    sticks = (size < 0.99 * MU * pressure) & (pressure > 0)
    slips = (pressure > 0) & ~sticks
    assert float((moved[sticks] - 0.05).abs().max()) < 2 * 2e-5  # twice the tolerance of `drag`
    assert float(moved[slips].max()) < 0.05 + 1e-4
    assert bool((shear[:, 0][slips] > 0).all())


def test_misfit_without_a_given_tolerance_is_a_micrometre(
    hertz: tuple[Gel, Kernel, Tensor],
) -> None:
    _, grid, pressure = hertz
    motion = torch.zeros(1, 2, grid.points, grid.points)
    motion[:, 0] = 0.02
    shear = friction.shear(grid, MU * pressure, 0 * motion, motion)
    sticks = (torch.linalg.vector_norm(shear, dim=1) < 0.99 * MU * pressure) & (pressure > 0)
    misfit = float((grid.drag(shear)[:, 0][sticks] - 0.02).abs().max())
    assert misfit < 2 * 1e-3
    assert friction.TOLERANCE == 1e-3


def test_twist_has_the_sign_of_the_turn(hertz: tuple[Gel, Kernel, Tensor]) -> None:
    _, grid, pressure = hertz
    line = (torch.arange(grid.points) - (grid.points - 1) / 2) * grid.spacing
    y, x = torch.meshgrid(line, line, indexing="ij")
    for turn in (0.02, -0.02):
        motion = turn * torch.stack([-y, x])[None]
        shear = friction.shear(grid, MU * pressure, 0 * motion, motion)
        twist = float((x * shear[:, 1] - y * shear[:, 0]).sum()) * grid.spacing**2
        assert twist * turn > 0
        assert force(grid, shear) == pytest.approx(0, abs=1e-3)


def test_small_twist_of_a_sticking_disc_is_reissner_and_sagoci(
    hertz: tuple[Gel, Kernel, Tensor],
) -> None:
    gel, grid, _ = hertz
    line = (torch.arange(grid.points) - (grid.points - 1) / 2) * grid.spacing
    y, x = torch.meshgrid(line, line, indexing="ij")
    radius = 1.5
    bound = torch.where(torch.hypot(x, y) < radius, 1e3, 0.0)[None]
    motion = 0.01 * torch.stack([-y, x])[None]
    shear = friction.shear(grid, bound, 0 * motion, motion, tolerance=2e-5)
    twist = float((x * shear[:, 1] - y * shear[:, 0]).sum()) * grid.spacing**2
    assert twist == pytest.approx(16 / 3 * gel.shear_modulus * radius**3 * 0.01, rel=0.05)


def test_failure_is_said(
    hertz: tuple[Gel, Kernel, Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, grid, pressure = hertz
    monkeypatch.setattr(friction, "_STEPS", 2)
    with pytest.raises(contact.NotConverged, match=r"shear of contact 0 of 1 did not settle in 2"):
        drag(grid, pressure, [0.05])
