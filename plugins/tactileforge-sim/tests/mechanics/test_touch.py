from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from planes import plane
from tactileforge_depth import contact
from tactileforge_depth.gel import Gel
from tactileforge_sim.mechanics.motions import MOTIONS, Path, Speeds, atomic
from tactileforge_sim.mechanics.touch import ContactState, contacts
from torch import Tensor

from tactileforge.errors import ConfigError

N, SPACING = 40, 0.3
GEL = Gel(friction=0.8)
SPEEDS = Speeds(depth=0.7, slide=3.0, turn=0.4, seconds=0.5, rest=0.1)


def wedge() -> Tensor:
    """No symmetry at all."""
    x, y = plane(N, SPACING)
    box = torch.maximum((x - 0.6).abs() - 2.2, (y + 0.3).abs() - 1.2)
    return 5 * box.clamp(min=0) + 0.04 * (x + 3).clamp(min=0) + 0.03 * (y + 2).clamp(min=0)


def ball() -> Tensor:
    x, y = plane(N, SPACING)
    return 4 - torch.sqrt((16 - x**2 - y**2).clamp(min=0))


def play(height: Tensor, gels: Sequence[Gel], *paths: Path, fps: float = 30) -> list[ContactState]:
    times = np.arange(int(paths[0].seconds * fps) + 1) / fps
    poses = torch.stack([torch.from_numpy(path.pose(times)).float() for path in paths])
    heights = height if height.ndim == 3 else height.expand(len(paths), -1, -1)
    return list(contacts(heights, SPACING, gels, poses, [fps] * len(paths)))


def forces(moments: Sequence[ContactState], row: int = 0) -> Tensor:
    return torch.stack([moment.force[row] for moment in moments])


@pytest.mark.parametrize("seed", range(3))
def test_coulomb_and_the_sum_of_pressure_hold_at_every_moment(seed: int) -> None:
    gel = replace(GEL, dome=80.0, viscosity=0.1)
    path = MOTIONS["manipulation"](
        (0.5, -0.4, 1.0, 0.01, -0.02), SPEEDS, np.random.default_rng(seed)
    )
    moments = play(wedge(), [gel], path, fps=15)
    for moment in moments:
        size = torch.linalg.vector_norm(moment.shear, dim=1)
        assert bool((size <= gel.friction * moment.pressure * (1 + 1e-4) + 1e-7).all())
        assert bool((moment.pressure >= 0).all())
        total = moment.pressure.sum() * SPACING**2
        torch.testing.assert_close(moment.force[0, 2], total)
        pull = torch.linalg.vector_norm(moment.force[:, :2])
        assert float(pull) <= gel.friction * float(total) * (1 + 1e-4) + 1e-6
    normal = forces(moments)[:, 2]
    assert float(normal.max()) > 0.5
    assert float(normal[0]) == float(normal[-1]) == 0


@pytest.mark.parametrize(
    ("action", "axis", "sign"),
    [("slide_left", 0, -1), ("slide_right", 0, 1), ("slide_up", 1, -1), ("slide_down", 1, 1)],
)
def test_a_slide_drags_the_gel_along(action: str, axis: int, sign: int) -> None:
    start = (0.2, 0.1, 0.9, 0.0, 0.0)
    path = atomic(action, start, SPEEDS)
    moments = play(ball(), [GEL], path)
    times = np.arange(len(moments)) / 30
    last = int(np.flatnonzero(path.action(times) == path.action(times).max())[-1])
    force = moments[last].force[0]
    assert float(sign * force[axis]) == pytest.approx(0.8 * float(force[2]), rel=0.01)
    assert abs(float(force[1 - axis])) < 0.02 * float(force[2])


def test_twist_follows_the_turn() -> None:
    for action, sign in (("rotate_cw", 1), ("rotate_ccw", -1)):
        moments = play(wedge(), [GEL], atomic(action, (0, 0, 0, 0, 0), SPEEDS))
        middle = torch.stack([moment.torque[0] for moment in moments])[len(moments) // 2]
        assert float(sign * middle) > 0.1


def test_a_mirrored_scene_has_the_mirrored_force() -> None:
    path = MOTIONS["manipulation"]((0.5, -0.4, 0.7, 0.02, 0.01), SPEEDS, np.random.default_rng(5))
    there = play(wedge(), [GEL], path, fps=15)
    mirror = play(wedge().flip(1), [GEL], path.mirrored(), fps=15)
    torch.testing.assert_close(
        forces(mirror), forces(there) * torch.tensor([-1.0, 1, 1]), rtol=0.01, atol=0.02
    )
    twist, twisted = (torch.stack([m.torque[0] for m in moments]) for moments in (there, mirror))
    torch.testing.assert_close(twisted, -twist, rtol=0.02, atol=0.03)


def test_a_turned_scene_has_the_turned_force() -> None:
    path = atomic("slide_right", (0, 0, 0.4, 0.0, 0.0), SPEEDS)
    turned = atomic("slide_down", (0, 0, 0.4 + np.pi / 2, 0.0, 0.0), SPEEDS)
    there, here = (forces(play(wedge(), [GEL], p)) for p in (path, turned))
    wanted = torch.stack([-there[:, 1], there[:, 0], there[:, 2]], 1)
    torch.testing.assert_close(here, wanted, rtol=0.01, atol=0.02)


def test_the_path_matters() -> None:
    """After a slide there and back, shear is left over until the object lets go."""
    times = np.array([0.0, 0.3, 0.6, 0.9, 1.2])
    poses = np.zeros((5, 6))
    poses[:, 3] = [-0.05, 0.7, 0.7, 0.7, -0.05]
    poses[2, 0] = 1.2
    force = forces(play(ball(), [GEL], Path(times, poses, ("press", "stay", "stay", "leave"))))
    before, back = force[9], force[27]
    torch.testing.assert_close(back[2], before[2], rtol=0.01, atol=0)
    assert float(back[0]) < -0.05 * float(back[2])
    assert force[-1].tolist() == [0, 0, 0]


def test_a_dome_yields_more_than_a_flat_gel() -> None:
    """A wide flat object touches the top of a dome first."""
    x, y = plane(N, SPACING)
    height = 5 * (torch.hypot(x, y) - 4).clamp(min=0)
    path = atomic("press", (0, 0, 0, 0, 0), replace(SPEEDS, depth=0.3))
    moments = play(height, [GEL, replace(GEL, dome=60.0)], path, path)
    flat, dome = (forces(moments, row)[:, 2].max() for row in (0, 1))
    assert 0.3 * float(flat) < float(dome) < 0.8 * float(flat)


def test_stiffness_scales_force_and_nothing_else() -> None:
    path = atomic("slide_right", (0, 0, 0, 0, 0), SPEEDS)
    stiff = replace(GEL, modulus=3 * GEL.modulus)
    moments = play(ball(), [GEL, stiff], path, path)
    torch.testing.assert_close(forces(moments, 1), 3 * forces(moments, 0), rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(moments[20].strain[1], moments[20].strain[0], rtol=1e-3, atol=1e-5)


def test_viscous_force_leads_the_depth() -> None:
    path = atomic("press", (0, 0, 0, 0, 0), SPEEDS)
    slow = replace(GEL, viscosity=0.1)
    moments = play(ball(), [GEL, slow], path, path)
    elastic, viscous = forces(moments, 0)[:, 2], forces(moments, 1)[:, 2]
    rate = torch.diff(elastic, prepend=elastic[:1]) * 30
    torch.testing.assert_close(viscous, (elastic + 0.1 * rate).clamp(min=0), rtol=0.01, atol=0.02)
    assert int(viscous.argmax()) < int(elastic.argmax())


def test_batch_equals_single() -> None:
    paths = [atomic(a, (0.3, 0, 0.2, 0, 0), SPEEDS) for a in ("slide_left", "rotate_cw")]
    both = play(wedge(), [GEL, GEL], *paths)
    for row, path in enumerate(paths):
        alone = play(wedge(), [GEL], path)
        torch.testing.assert_close(forces(both, row), forces(alone), rtol=0.01, atol=0.02)


def test_touches_are_made_one_by_one() -> None:
    endless = torch.zeros(1, 1_000_000, 6)
    endless[..., 3] = -1
    moments = contacts(ball()[None], SPACING, [GEL], endless[:, :1000], [30.0])
    assert next(moments).force.tolist() == [[0, 0, 0]]


def test_impossible_touches_are_named() -> None:
    deep = torch.zeros(1, 2, 6)
    deep[0, 1, 3] = 4.5
    said = r"press: the object goes 4\.5 mm deep, but the gel is 4 mm thick"
    with pytest.raises(ConfigError, match=said):
        next(contacts(ball()[None], SPACING, [GEL], deep, [30.0], "press"))
    deep[0, 1, 3] = float("nan")
    with pytest.raises(ConfigError, match="press: a pose is not a finite number"):
        next(contacts(ball()[None], SPACING, [GEL], deep, [30.0], "press"))
    thin = replace(GEL, thickness=2.0)
    with pytest.raises(ConfigError, match="one thickness"):
        next(contacts(ball().expand(2, -1, -1), SPACING, [GEL, thin], deep.expand(2, -1, -1), [1]))


def test_failure_names_the_touch_and_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contact, "_STEPS", 1)
    poses = torch.tensor([[[0, 0, 0, -0.1, 0, 0], [0, 0, 0, 0.5, 0, 0]]])
    with pytest.raises(contact.NotConverged, match="touch of seed 7, frame 1: contact 0 of 1"):
        list(contacts(ball()[None], SPACING, [GEL], poses, [30.0], "touch of seed 7"))
