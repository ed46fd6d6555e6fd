import math

import pytest
import torch
from torch import Tensor

from tactileforge.sim.gel import Gel
from tactileforge.sim.surface import DETAIL, Surface
from tactileforge.sim.touch import Contact, contacts

N, SPACING, GEL = 64, 0.22, Gel(friction=0.8)


def plane(points: int, spacing: float) -> tuple[Tensor, Tensor]:
    line = (torch.arange(points) - (points - 1) / 2) * spacing
    y, x = torch.meshgrid(line, line, indexing="ij")
    return x, y


def tip(x: Tensor, y: Tensor) -> Tensor:
    """An oblique ellipsoid."""
    return (x + 0.4 * y) ** 2 / 9 + (y - 0.3 * x) ** 2 / 5


def scene(poses: Tensor, mirrored: bool = False) -> tuple[Surface, list[Contact]]:
    flip = -1 if mirrored else 1
    coarse, fine = (
        tip(flip * x, y)[None] for x, y in (plane(N, SPACING), plane(N * DETAIL, SPACING / DETAIL))
    )
    moments = list(contacts(coarse, SPACING, [GEL], poses[None], [30.0]))
    return Surface(coarse, fine, SPACING, GEL), moments


def places(height: int = 120, width: int = 160, spacing: float = 0.12) -> Tensor:
    x = (torch.arange(width) - (width - 1) / 2) * spacing
    y = (torch.arange(height) - (height - 1) / 2) * spacing
    return torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)


def pose(x: float, y: float, angle: float, depth: float) -> Tensor:
    return torch.tensor([x, y, angle, depth, 0.0, 0.0])


CLEAR = pose(0, 0, 0, -0.1)


def test_the_surface_touches_the_object_where_it_presses_and_nowhere_enters_it() -> None:
    where = pose(1.3, -0.7, 0.6, 0.8)
    surface, (_, moment) = scene(
        torch.stack([CLEAR + where * torch.tensor([1, 1, 1, 0, 0, 0]), where])
    )
    dent = surface.picture(surface.fields(moment), moment.pose, places())[0]
    x, y = places().unbind(-1)
    cos, sin = math.cos(0.6), math.sin(0.6)
    right, down = cos * (x - 1.3) + sin * (y + 0.7), cos * (y + 0.7) - sin * (x - 1.3)
    overlap = 0.8 - tip(right, down)
    assert float((dent - overlap)[overlap > 0.4].abs().max()) < 0.01
    assert float((dent - overlap).min()) > -0.01
    edges = torch.cat([dent[0], dent[-1], dent[:, 0], dent[:, -1]])
    assert float(edges.abs().max()) < 0.05


def test_detail_finer_than_the_solver_shows_in_the_contact() -> None:
    x, y = plane(N * DETAIL, SPACING / DETAIL)
    ridges = 0.03 * torch.cos(2 * math.pi * x / 0.5)
    flat = 6 * (torch.hypot(*plane(N, SPACING)) - 3).clamp(min=0)
    fine = 6 * (torch.hypot(x, y) - 3).clamp(min=0) + ridges
    poses = torch.stack([CLEAR, pose(0, 0, 0, 0.5)])
    _, moment = contacts(flat[None], SPACING, [GEL], poses[None], [30.0])
    surface = Surface(flat[None], fine[None], SPACING, GEL)
    row = surface.picture(surface.fields(moment), moment.pose, places(1, 100, 0.04))[0, 0]
    wanted = 0.5 - 0.03 * torch.cos(2 * math.pi * places(1, 100, 0.04)[0, :, 0] / 0.5)
    torch.testing.assert_close(row, wanted, rtol=0, atol=0.015)


def test_no_contact_is_flat() -> None:
    surface, (moment,) = scene(CLEAR[None])
    dent = surface.picture(surface.fields(moment), moment.pose, places())
    assert float(dent.abs().max()) == 0
    assert float(surface.lateral(moment, places()[None, 0]).abs().max()) == 0


def test_a_mirrored_scene_has_the_mirrored_surface() -> None:
    swap = torch.tensor([-1.0, 1, -1, 1, -1, 1])
    poses = torch.stack([CLEAR, pose(0, 0, 0, 0.7), pose(0.5, 0.2, 0.3, 0.7)])
    there, moments = scene(poses)
    here, mirrored = scene(poses * swap, mirrored=True)
    dents = [
        s.picture(s.fields(m[-1]), m[-1].pose, places())[0]
        for s, m in ((there, moments), (here, mirrored))
    ]
    torch.testing.assert_close(dents[1], dents[0].flip(1), rtol=0, atol=0.01)
    spots = places(7, 9, 2.0).reshape(1, -1, 2)
    moved = there.lateral(moments[-1], spots)
    mirror = here.lateral(mirrored[-1], spots * torch.tensor([-1.0, 1]))
    torch.testing.assert_close(mirror, moved * torch.tensor([-1.0, 1]), rtol=0, atol=0.01)


@pytest.mark.parametrize("angle", [0.0, 2.0])
def test_markers_spread_under_a_press_and_follow_a_slide(angle: float) -> None:
    poses = torch.stack([CLEAR, pose(0, 0, angle, 0.8), pose(0, 0.6, angle, 0.8)])
    poses[0, 2] = angle
    surface, (_, pressed, slid) = scene(poses)
    ring = 4 * torch.tensor([[1.0, 0], [0, 1], [-1, 0], [0, -1]])[None]
    outwards = (surface.lateral(pressed, ring) * ring).sum(-1)
    assert bool((outwards > 0).all())
    middle = torch.zeros(1, 1, 2)
    moved = surface.lateral(slid, middle) - surface.lateral(pressed, middle)
    assert float(moved[0, 0, 1]) == pytest.approx(0.6, abs=0.1)
    assert abs(float(moved[0, 0, 0])) < 0.05


def test_contacts_stick_to_the_object() -> None:
    """A small slide moves the gel under the object exactly as far."""
    poses = torch.stack([CLEAR, pose(0, 0, 0, 0.8), pose(0.05, 0, 0, 0.8)])
    surface, (_, pressed, slid) = scene(poses)
    middle = torch.tensor([[[0.0, 0], [0.3, 0.2], [-0.3, 0.1]]])
    there, here = surface.lateral(pressed, middle), surface.lateral(slid, middle)
    torch.testing.assert_close((here - there)[..., 0], torch.full((1, 3), 0.05), rtol=0, atol=0.005)
