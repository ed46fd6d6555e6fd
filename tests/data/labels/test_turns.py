"""Labels of turned and mirrored clips, against closed forms."""

from __future__ import annotations

import math

import pytest
import torch

from tactileforge.contracts import ACTIONS, Batch, Column
from tactileforge.data.labels import turns
from tactileforge.errors import DataError, PluginError

SLIDES = ("slide_right", "slide_down", "slide_left", "slide_up")
LEFT_RIGHT = torch.tensor([[True, False]])
UPRIGHT = torch.tensor([[False, False]])


def labelled(action: str, force: tuple[float, float, float], known: tuple[bool, ...]) -> Batch:
    return {
        "action": torch.tensor([ACTIONS.index(action)]),
        "force": torch.tensor([[force, force]]),
        "force_valid": torch.tensor([known]),
    }


@pytest.mark.parametrize("angle", [0.0, 17.0, 90.0, -135.0, 180.0])
def test_shear_turns_clockwise_and_normal_force_stays(angle: float) -> None:
    """A shear at an angle b to the x axis is at b + a after a turn by a."""
    start = 0.4
    batch = labelled("press", (3 * math.cos(start), 3 * math.sin(start), 5.0), (True,) * 3)
    turns.turn_labels(batch, torch.tensor([angle]))
    end = start + math.radians(angle)
    wanted = torch.tensor([3 * math.cos(end), 3 * math.sin(end), 5.0])
    torch.testing.assert_close(batch["force"][0, 1], wanted)


def test_a_turn_mixes_the_shears_that_are_known() -> None:
    for angle, valid in ((0.0, [True, False, True]), (30.0, [False, False, True])):
        batch = labelled("press", (1.0, 0.0, 5.0), (True, False, True))
        turns.turn_labels(batch, torch.tensor([angle]))
        assert batch["force_valid"].tolist() == [valid]


@pytest.mark.parametrize("quarters", range(-2, 3))
def test_slides_turn_by_quarters(quarters: int) -> None:
    for place, name in enumerate(SLIDES):
        for slack in (-8.0, 0.0, 8.0):  # a slide is within 36.87 degrees, and 45 is half-way
            batch = labelled(name, (0.0, 0.0, 0.0), (True,) * 3)
            turns.turn_labels(batch, torch.tensor([90.0 * quarters + slack]))
            assert ACTIONS[batch["action"]] == SLIDES[(place + quarters) % 4]


@pytest.mark.parametrize("angle", [8.2, 45.0, -60.0, 98.2, 171.8])
def test_slides_between_directions_have_no_name(angle: float) -> None:
    for name in ACTIONS:
        batch = labelled(name, (0.0, 0.0, 0.0), (True,) * 3)
        turns.turn_labels(batch, torch.tensor([angle]))
        kept = -1 if name in SLIDES else ACTIONS.index(name)
        assert batch["action"].tolist() == [kept]


def test_an_unknown_action_stays_unknown() -> None:
    batch = labelled("press", (0.0, 0.0, 0.0), (True,) * 3) | {"action": torch.tensor([-1])}
    turns.turn_labels(batch, torch.tensor([90.0]))
    assert batch["action"].tolist() == [-1]


def column_after(kind: str, value: torch.Tensor, flip: torch.Tensor, angle: float) -> torch.Tensor:
    """The one step of a column of one clip."""
    batch: Batch = {"it": value[None, None]}
    column = Column(name="it", turns=kind)  # type: ignore[arg-type]
    matrix = turns.frame_change(flip, torch.tensor([angle]))
    turns.turn_columns(batch, [column], matrix)
    out: torch.Tensor = batch["it"][0, 0]
    return out


def test_torque_about_z_is_kept_by_a_turn_and_changes_sign_in_a_mirror() -> None:
    torque = torch.tensor(0.3)
    assert column_after("torque", torque, UPRIGHT, 37.0).item() == pytest.approx(0.3)
    assert column_after("torque", torque, LEFT_RIGHT, 0.0).item() == pytest.approx(-0.3)
    assert column_after("torque", torque, ~UPRIGHT, 0.0).item() == pytest.approx(0.3), "half a turn"


@pytest.mark.parametrize("flip", [UPRIGHT, LEFT_RIGHT, LEFT_RIGHT.flip(1), ~UPRIGHT])
@pytest.mark.parametrize("angle", [0.0, 33.0, -120.0])
def test_a_torque_is_the_product_of_arm_and_force_after_every_change(
    flip: torch.Tensor, angle: float
) -> None:
    """The cross product of changed vectors is the changed cross product."""
    arm, force = torch.tensor([1.0, -2.0, 0.5]), torch.tensor([0.3, 0.7, 4.0])
    wrench = torch.cat([force, torch.linalg.cross(arm, force)])
    turned = column_after("wrench", wrench, flip, angle)
    moved_arm = column_after("vector", arm, flip, angle)
    torch.testing.assert_close(turned[:3], column_after("vector", force, flip, angle))
    torch.testing.assert_close(turned[3:], torch.linalg.cross(moved_arm, turned[:3]))
    torque = column_after("torque", wrench[3:], flip, angle)
    torch.testing.assert_close(torque, turned[3:])


@pytest.mark.parametrize("flip", [UPRIGHT, LEFT_RIGHT, ~UPRIGHT])
def test_a_pose_moves_points_to_where_they_are_seen(flip: torch.Tensor) -> None:
    """The changed pose moves the changed point to where the moved point is after the change."""
    turn = turns.rotation(torch.tensor([25.0]))[0]
    pose = torch.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, torch.tensor([1.0, 2.0, 3.0])
    point = torch.tensor([0.2, -0.4, 0.9])
    after = column_after("pose", pose, flip, 70.0)
    seen = column_after("vector", point, flip, 70.0)
    moved = column_after("vector", turn @ point + pose[:3, 3], flip, 70.0)
    torch.testing.assert_close(after[:3, :3] @ seen + after[:3, 3], moved)
    assert torch.linalg.det(after[:3, :3]).item() == pytest.approx(1), "still a motion"


def test_a_field_of_vectors_and_plain_columns() -> None:
    field = torch.randn(4, 5, 2)
    turned = column_after("vector", field, UPRIGHT, 90.0)
    torch.testing.assert_close(turned, torch.stack([-field[..., 1], field[..., 0]], -1))
    assert torch.equal(column_after("", field, ~UPRIGHT, 30.0), field)


def moved_field(field: torch.Tensor, flip: torch.Tensor, angle: float, scale: float = 1.0):
    turn = turns.rotation(torch.tensor([angle]))
    warp = torch.cat([scale * turn[:, :2, :2], torch.zeros(1, 2, 1)], dim=2)
    batch = {"it": field[None]}
    matrix = turns.frame_change(flip, torch.tensor([angle]))
    turns.turn_columns(batch, [Column(name="it", turns="field")], matrix, flip, warp)
    return batch["it"][0]


def test_a_field_moves_with_the_picture() -> None:
    field = torch.randn(3, 8, 8, 2)
    across = moved_field(field, LEFT_RIGHT, 0.0)
    torch.testing.assert_close(across, field.flip(2) * torch.tensor([-1.0, 1.0]))
    down = moved_field(field, torch.tensor([[False, True]]), 0.0)
    torch.testing.assert_close(down, field.flip(1) * torch.tensor([1.0, -1.0]))
    clockwise = moved_field(field, UPRIGHT, 90.0)  # places and vectors: x to y, y to -x
    around = field.rot90(-1, (1, 2))
    wanted = torch.stack([-around[..., 1], around[..., 0]], -1)
    torch.testing.assert_close(clockwise, wanted, atol=1e-5, rtol=0)


def test_a_magnified_field_has_longer_vectors() -> None:
    """A stretch of the gel, (x, y) = .1 place, is the same field in a picture of another scale."""
    places = torch.linspace(-1, 1, 17)
    y, x = torch.meshgrid(places, places, indexing="ij")
    field = 0.1 * torch.stack([x, y], -1)[None]
    near = moved_field(field, UPRIGHT, 0.0, 1.25)
    torch.testing.assert_close(near, field, atol=1e-5, rtol=0)


def test_a_column_that_cannot_turn_is_named() -> None:
    with pytest.raises(DataError, match=r"a field is \(rows, columns, 2\)"):
        turns.check_turns(Column(name="it", turns="field"), (12, 2))
    for kind, good, bad in (
        ("vector", (7, 3), (7, 4)),
        ("torque", (), (2,)),
        ("wrench", (6,), (3,)),
        ("pose", (4, 4), (4,)),
    ):
        column = Column(name="it", track="grip", turns=kind)  # type: ignore[arg-type]
        turns.check_turns(column, good)
        with pytest.raises(DataError, match=f"'grip' is .* turns as a {kind} ends in"):
            turns.check_turns(column, bad)
    turns.check_turns(Column(name="it"), (5,))
    with pytest.raises(PluginError, match="give float32 and one of vector"):
        turns.check_turns(Column(name="it", turns="vector", dtype="int64"), (3,))
    with pytest.raises(PluginError, match="turns='spin'"):
        turns.check_turns(Column(name="it", turns="spin"), (3,))  # type: ignore[arg-type]
