"""Pixels of turned, moved and relit clips, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from tactileforge.contracts import ACTIONS, Batch, Column
from tactileforge.data.labels import displacement
from tactileforge.data.labels.augment import Augment, fill_captions
from tactileforge.errors import ConfigError

SIZE = 64
REST = 90
ALL = {
    **{"rotate": 180.0, "shift": 0.1, "scale": 0.2},
    **{"blur": 1.5, "gain": 0.2, "colour": 0.1, "noise": 3.0},
}


def spot(x: float, y: float, aspect: float = 1.0, height: float = 120.0) -> torch.Tensor:
    """A round contact at shares of the sides from the centre, on resized frames."""
    rows, columns = np.mgrid[:SIZE, :SIZE]
    u, v = (columns + 0.5) / SIZE - 0.5 - x, (rows + 0.5) / SIZE - 0.5 - y
    bump = np.exp(-((aspect * u) ** 2 + v**2) / (2 * 0.06**2))
    return torch.from_numpy(np.rint(REST + height * bump).astype(np.uint8)).expand(3, -1, -1)


def touch(*spots: torch.Tensor, aspect: float = 1.0, **changes: Any) -> Batch:
    """One clip a spot, of two frames each, with forces, an action, a surface and a caption."""
    count = len(spots)
    return {
        "frames": torch.stack([torch.stack([one, one]) for one in spots]),
        "background": torch.full((count, 3, SIZE, SIZE), REST, dtype=torch.uint8),
        "sensor": ["digit"] * count,
        "force": torch.tensor([1.0, 0.0, 4.0]).repeat(count, 2, 1),
        "force_valid": torch.ones(count, 3, dtype=torch.bool),
        "action": torch.full((count,), ACTIONS.index("slide_right")),
        "text": ["{action} a ball"] * count,
        "group": torch.full((count,), -1),
        "aspect": torch.full((count,), aspect),
        "upright": torch.zeros(count, dtype=torch.bool),
        **changes,
    }


def changed(batch: Batch, *columns: Column, **options: Any) -> Batch:
    augment = Augment(**({"horizontal": 0.0, "vertical": 0.0} | options))
    return augment(augment.labels(dict(batch), columns))


def place(batch: Batch, clip: int = 0) -> tuple[float, float]:
    """Centre of mass of the contrast of a clip, in shares from the centre."""
    contrast = batch["frames"][clip, 0, 0].double() - batch["background"][clip, 0].double()
    at = (torch.arange(SIZE).double() + 0.5) / SIZE - 0.5
    mass = contrast.sum()
    return float((contrast.sum(0) * at).sum() / mass), float((contrast.sum(1) * at).sum() / mass)


@pytest.mark.parametrize("aspect", [1.0, 4 / 3, 0.75])
def test_a_turned_spot_is_where_the_turn_says_and_stays_round(aspect: float) -> None:
    """Also on pictures that were 4 to 3 and are square now: the turn is of the gel."""
    torch.manual_seed(3)
    before = touch(*[spot(0.2 / aspect, 0.05, aspect)] * 8, aspect=aspect)
    after = changed(before, rotate=180.0)
    for clip in range(8):
        force = after["force"][clip, 0]
        turn = math.atan2(force[1], force[0])  # the force pointed to the right
        assert force[:2].norm().item() == pytest.approx(1.0)
        x, y = place(after, clip)
        wanted = (
            (0.2 * math.cos(turn) - 0.05 * math.sin(turn)) / aspect,
            0.2 * math.sin(turn) + 0.05 * math.cos(turn),
        )
        assert (x, y) == pytest.approx(wanted, abs=0.2 / SIZE)
        alike = spot(*wanted, aspect=aspect).float()
        assert (after["frames"][clip, 0].float() - alike).abs().max() <= 6
    assert len({round(float(row[0, 0]), 3) for row in after["force"]}) == 8, "one draw a clip"


def test_a_shift_moves_the_centre_of_mass_and_no_label() -> None:
    torch.manual_seed(0)
    before = touch(*[spot(0.05, -0.05)] * 4)
    augment = Augment(0.0, 0.0, shift=0.2)
    drawn = augment.labels(dict(before))
    after = augment(drawn)
    for clip in range(4):
        by = drawn["warp"][clip, :, 2].tolist()
        assert max(map(abs, by)) <= 0.2
        assert place(after, clip) == pytest.approx((0.05 + by[0], by[1] - 0.05), abs=0.1 / SIZE)
    assert torch.equal(after["force"], before["force"])
    assert torch.equal(after["action"], before["action"])


def test_a_scale_magnifies_the_contact_and_leaves_newtons_alone() -> None:
    torch.manual_seed(1)
    before = touch(*[spot(0.1, 0.0)] * 4)
    augment = Augment(0.0, 0.0, scale=0.25)
    drawn = augment.labels(dict(before))
    after = augment(drawn)
    for clip in range(4):
        factor = drawn["warp"][clip, 0, 0].item()
        assert 1 / 1.25 <= factor <= 1.25
        assert place(after, clip)[0] == pytest.approx(0.1 * factor, abs=0.1 / SIZE)
        masses = [(one["frames"][clip, 0, 0].double() - REST).sum() for one in (before, after)]
        assert masses[1] / masses[0] == pytest.approx(factor**2, rel=0.03)
    assert torch.equal(after["force"], before["force"])


def test_outside_of_the_picture_is_the_gel_at_rest() -> None:
    """A contact at the border is not repeated there, and the light of the gel goes on."""
    light = (REST + torch.arange(SIZE)).to(torch.uint8).expand(3, SIZE, SIZE)
    batch = touch(spot(0.45, 0.0))
    batch["background"] = light[None]
    batch["frames"] = (light.int() + batch["frames"].int() - REST).to(torch.uint8)
    augment = Augment(0.0, 0.0, shift=0.5)
    drawn = augment.labels(batch)
    drawn["warp"] = torch.tensor([[[1.0, 0.0, -0.25], [0.0, 1.0, 0.0]]])
    after = augment(drawn)
    new = slice(SIZE * 3 // 4 + 1, None)
    assert torch.equal(after["frames"][0, 0, ..., new], after["background"][0, ..., new])
    mirrored = light[..., SIZE * 3 // 4 :].flip(-1)  # of the last columns, beyond the border
    assert torch.equal(after["background"][0, ..., SIZE * 3 // 4 :], mirrored)


def test_gain_and_colour_are_of_frames_and_background_alike() -> None:
    """The contrast of the touch is multiplied by the factor, and not by more."""
    torch.manual_seed(0)
    before = touch(*[spot(0.0, 0.0, height=60.0)] * 8)
    augment = Augment(0.0, 0.0, gain=0.3, colour=0.2)
    drawn = augment.labels(dict(before))
    after = augment(drawn)
    factor = drawn["relight"][:, :3, None, None]
    for key in ("frames", "background"):
        wide = factor if key == "background" else factor[:, None]
        wanted = (before[key].float() * wide).clamp(0, 255)
        assert (after[key].float() - wanted).abs().max() <= 0.5
    assert (factor.flatten(1).diff(dim=1).abs() > 1e-3).any(), "channels differ"
    assert ((factor > 0.7 * 0.8) & (factor < 1.3 * 1.2)).all()


def test_noise_is_of_each_frame_and_of_no_background() -> None:
    torch.manual_seed(0)
    before = touch(*[spot(0.0, 0.0, height=0.0)] * 4)
    augment = Augment(0.0, 0.0, noise=8.0)
    drawn = augment.labels(dict(before))
    drawn["relight"][:, 4] = torch.tensor([1.0, 2.0, 4.0, 8.0])
    after = augment(drawn)
    assert torch.equal(after["background"], before["background"])
    for clip in range(4):
        seen = after["frames"][clip].float() - REST
        deviation = math.hypot(drawn["relight"][clip, 4], 12**-0.5)  # and rounding
        assert seen.std().item() == pytest.approx(deviation, rel=0.05)
        assert not torch.equal(seen[0], seen[1])


def test_blur_widens_a_spot_by_its_deviation() -> None:
    """Variances of Gaussians add up."""
    torch.manual_seed(0)
    before = touch(*[spot(0.0, 0.0)] * 3)
    augment = Augment(0.0, 0.0, blur=4.0)
    drawn = augment.labels(dict(before))
    after = augment(drawn)
    at = torch.arange(SIZE).double() - (SIZE - 1) / 2
    for clip in range(3):
        profile = (after["frames"][clip, 0, 0].double() - REST).sum(0)
        variance = float((profile * at**2).sum() / profile.sum())
        wanted = (0.06 * SIZE) ** 2 + float(drawn["relight"][clip, 3]) ** 2
        assert variance == pytest.approx(wanted, rel=0.05)


def test_the_surface_turns_with_the_pixels() -> None:
    """A dent moves with its contact, and its sideways displacement turns as the force does."""
    torch.manual_seed(5)
    side = displacement.SIZE
    rows, columns = np.mgrid[:side, :side]
    u, v = (columns + 0.5) / side - 0.7, (rows + 0.5) / side - 0.5
    bump = np.exp(-(u**2 + v**2) / (2 * 0.08**2)).astype(np.float32)
    field = np.stack([0.3 * bump, 0 * bump, 1.0 * bump], -1)
    coded = torch.from_numpy(displacement.encode_displacement(field)).movedim(-1, 0)
    surface = coded.expand(2, 3, side, side)[None]
    batch = touch(spot(0.2, 0.0), surface=surface, surface_valid=torch.tensor([True]))
    after = changed(batch, rotate=180.0)
    force = after["force"][0, 0]
    image = after["surface"][0, 0].movedim(0, -1).numpy()
    mm = torch.from_numpy(displacement.decode_displacement(image))
    depth = mm[..., 2].double()
    at = (torch.arange(side).double() + 0.5) / side - 0.5
    centre = [float((depth.sum(d) * at).sum() / depth.sum()) for d in (0, 1)]
    assert centre == pytest.approx([0.2 * float(force[0]), 0.2 * float(force[1])], abs=0.02)
    top = mm.view(-1, 3)[depth.argmax()]
    assert top[:2].tolist() == pytest.approx((0.3 * force[:2]).tolist(), abs=0.03)
    assert top[2].item() == pytest.approx(1.0, abs=0.05)


def test_displacements_are_coded_alike_on_the_host_and_on_the_device() -> None:
    mm = np.random.default_rng(0).normal(0, 0.4, (2, 5, 6, 3)).astype(np.float32)
    wanted = torch.from_numpy(displacement.encode_displacement(mm)).movedim(-1, 1)
    assert torch.equal(
        displacement.displacement_images(torch.from_numpy(mm).movedim(-1, 1)), wanted
    )


def test_columns_turn_with_the_clip_and_captions_lose_the_direction() -> None:
    torch.manual_seed(0)
    wrench = torch.tensor([1.0, 0.0, 4.0, 0.1, 0.2, 0.3]).repeat(16, 1, 1)
    plain = torch.randn(16, 2, 3)
    batch = touch(*[spot(0.0, 0.0)] * 16, wrench=wrench, robot=plain)
    columns = Column(name="wrench", turns="wrench"), Column(name="robot")
    after = changed(batch, *columns, rotate=180.0, horizontal=0.5)
    torch.testing.assert_close(after["wrench"][:, 0, :3], after["force"][:, 0])
    sign = torch.where(after["flip"][:, 0], -1.0, 1.0)
    torch.testing.assert_close(after["wrench"][:, 0, 5], 0.3 * sign)
    assert torch.equal(after["robot"], plain)
    fill_captions(after)
    names = {"sliding right": 1, "sliding left": 1, "sliding up": 1, "sliding down": 1}
    for action, text in zip(after["action"].tolist(), after["text"], strict=True):
        said = text.removesuffix(" a ball")
        assert (said == "touching") == (action == -1)
        assert said in names or action == -1


def test_clips_of_a_group_are_moved_alike() -> None:
    torch.manual_seed(0)
    group = torch.tensor([0, 0, 1, 1, -1, -1])
    batch = touch(*[spot(0.1, 0.0)] * 6, group=group)
    drawn = Augment(0.5, 0.5, **ALL, chance={"rotate": 0.9}).labels(batch)
    warp, light = drawn["warp"], drawn["relight"]
    assert torch.equal(warp[0], warp[1])
    assert torch.equal(warp[2], warp[3])
    assert len({tuple(row) for row in warp.flatten(1).tolist()}) == 4
    assert len({tuple(row) for row in light.tolist()}) == 6, "cameras and lights differ"


def test_upright_clips_and_their_partners_stay_as_they_lie() -> None:
    """Letters on an object; their light may change."""
    torch.manual_seed(0)
    upright = torch.tensor([True, False, False])
    batch = touch(*[spot(0.2, 0.1)] * 3, group=torch.tensor([4, 4, -1]), upright=upright)
    geometry = {"horizontal": 1.0, "vertical": 1.0, "rotate": 90.0, "shift": 0.2, "scale": 0.2}
    after = changed(batch, **geometry)
    assert torch.equal(after["frames"][:2], batch["frames"][:2])
    assert torch.equal(after["force"][:2], batch["force"][:2])
    assert not torch.equal(after["frames"][2], batch["frames"][2])
    lit = changed(batch, gain=0.5)
    assert not torch.equal(lit["frames"][0], batch["frames"][0])


def test_arrays_of_taxels_stay_as_they_are() -> None:
    batch = touch(spot(0.2, 0.1), sensor=["serial_array"])
    after = changed(batch, horizontal=1.0, **ALL)
    for key in ("frames", "background", "force", "action"):
        assert torch.equal(after[key], batch[key])


def test_a_chance_of_none_changes_nothing() -> None:
    noise = torch.randint(0, 256, (4, 2, 3, SIZE, SIZE), dtype=torch.uint8)
    batch = touch(*[spot(0.2, 0.1)] * 4, aspect=4 / 3) | {"frames": noise}
    batch["background"] = noise[:, 0]
    after = changed(batch, **ALL, chance=dict.fromkeys(ALL, 0.0))
    for key in ("frames", "background", "force", "force_valid", "action"):
        assert torch.equal(after[key], batch[key]), key


def test_chances_and_ranges_are_kept() -> None:
    torch.manual_seed(0)
    batch = touch(*[spot(0.0, 0.0)] * 2000)
    drawn = Augment(0.0, 0.0, rotate=30.0, noise=5.0, chance={"rotate": 0.3}).labels(batch)
    turn = torch.rad2deg(torch.atan2(drawn["warp_turn"][:, 1, 0], drawn["warp_turn"][:, 0, 0]))
    assert (turn != 0).float().mean().item() == pytest.approx(0.3, abs=0.03)
    assert 29 < turn.abs().max() <= 30.001
    assert drawn["relight"][:, 4].mean().item() == pytest.approx(2.5, abs=0.1)


def test_another_change_leaves_the_flips_alone() -> None:
    """Draws for one change do not depend on the other changes."""
    flips, turns = [], []
    for options in ({}, {"rotate": 90.0}, ALL | {"rotate": 90.0}):
        torch.manual_seed(7)
        drawn = Augment(0.5, 0.5, **options).labels(touch(*[spot(0.0, 0.0)] * 16))
        flips.append(drawn["flip"])
        turns.append(drawn.get("warp_turn"))
    assert torch.equal(flips[0], flips[1])
    assert torch.equal(flips[0], flips[2])
    assert torch.equal(turns[1], turns[2])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rotate": 270.0}, r"augment.rotate=270.0: give a number from 0 to 180"),
        ({"horizontal": 1.5}, r"augment.horizontal=1.5: give a number from 0 to 1"),
        ({"noise": "much"}, r"augment.noise=much: give a number from 0 to 50"),
        ({"chance": {"rotat": 0.5}}, r"augment.chance 'rotat'.*rotate"),
        ({"chance": {"blur": -0.5}}, r"augment.chance.blur=-0.5"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Augment(**options)
