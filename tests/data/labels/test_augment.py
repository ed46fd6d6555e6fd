"""A mirrored touch has a mirrored force."""

import numpy as np
import pytest
import torch

from tactileforge.contracts import ACTIONS, Batch
from tactileforge.data.labels import displacement
from tactileforge.data.labels.augment import PHRASES, Augment, fill_captions
from tactileforge.data.labels.turns import flip_labels
from tactileforge.errors import ConfigError
from tactileforge.sensors.taxels import TaxelLayout

#: A clip without a partner, which may be mirrored.
ALONE = {"group": torch.tensor([-1]), "upright": torch.tensor([False])}
MIRRORED = {
    "horizontal": {
        "slide_left": "slide_right",
        "slide_right": "slide_left",
        "rotate_cw": "rotate_ccw",
        "rotate_ccw": "rotate_cw",
    },
    "vertical": {
        "slide_up": "slide_down",
        "slide_down": "slide_up",
        "rotate_cw": "rotate_ccw",
        "rotate_ccw": "rotate_cw",
    },
}


@pytest.mark.parametrize("axis", [0, 1])
def test_labels_are_mirrored(axis: int) -> None:
    force = torch.randn(9, 4, 3)
    batch: Batch = {"action": torch.tensor([*range(8), -1]), "force": force}
    flipped = torch.ones(9, dtype=torch.bool)
    flip_labels(batch, *(flipped if i == axis else ~flipped for i in range(2)))
    sign = torch.ones(3)
    sign[axis] = -1
    torch.testing.assert_close(batch["force"], force * sign)
    table = MIRRORED[("horizontal", "vertical")[axis]]
    assert batch["action"].tolist() == [
        *(ACTIONS.index(table.get(name, name)) for name in ACTIONS),
        -1,
    ]


def moving_blob(shift: tuple[float, float]) -> torch.Tensor:
    """A spot moving by ``shift`` (x, y) pixels a frame: uint8 (4, 3, 33, 33)."""
    y, x = np.mgrid[:33, :33]
    frames = [
        200 * np.exp(-((x - 16 - shift[0] * t) ** 2 + (y - 16 - shift[1] * t) ** 2) / 8)
        for t in range(-2, 2)
    ]
    return torch.from_numpy(np.stack(frames).astype(np.uint8))[:, None].expand(-1, 3, -1, -1)


@pytest.mark.parametrize(("axis", "shift"), [(0, (2.0, 0.0)), (1, (0.0, 2.0))])
def test_pixels_move_the_way_the_labels_say(axis: int, shift: tuple[float, float]) -> None:
    """A spot dragged right, flipped, is a spot dragged left, and its shear points left."""
    name = ("slide_right", "slide_down")[axis]
    force = torch.zeros(1, 4, 3)
    force[..., axis] = 1.0
    augment = Augment(horizontal=float(axis == 0), vertical=float(axis == 1))
    frames = moving_blob(shift)[None]
    labels = {"action": torch.tensor([ACTIONS.index(name)]), "force": force, "sensor": ["digit"]}
    batch = augment.labels(labels | ALONE)
    batch = augment(batch | {"frames": frames, "background": frames[:, 0]})
    away = moving_blob((-shift[0], -shift[1]))[None]
    torch.testing.assert_close(batch["frames"], away)
    assert ACTIONS[batch["action"]] == ("slide_left", "slide_up")[axis]
    assert (batch["force"][..., axis] == -1).all()


def test_flipping_twice_changes_nothing() -> None:
    augment = Augment(1.0, 1.0)
    start = {"action": torch.arange(8), "force": torch.randn(8, 4, 3), "group": torch.arange(8)}
    start |= {"sensor": ["digit"] * 8, "upright": torch.zeros(8, dtype=torch.bool)}
    frames = torch.randint(0, 256, (8, 4, 3, 16, 16), dtype=torch.uint8)
    batch = start | {"frames": frames, "background": frames[:, 0]}
    for _ in range(2):
        batch = augment(augment.labels(batch))
    for key in ("action", "force", "frames", "background"):
        torch.testing.assert_close(batch[key], (start | {"frames": frames}).get(key, frames[:, 0]))


def test_flips_come_with_the_chance_asked_for() -> None:
    alone = torch.full((4000,), -1)
    batch = {"action": alone, "force": torch.zeros(4000, 4, 3), "group": alone}
    batch |= {"sensor": ["digit"] * 4000, "upright": torch.zeros(4000, dtype=torch.bool)}
    flip = Augment(0.3, 0.0).labels(batch)["flip"]
    assert flip[:, 0].float().mean().item() == pytest.approx(0.3, abs=0.03)
    assert not flip[:, 1].any()


def test_a_group_is_flipped_alike() -> None:
    group = torch.tensor([0, 0, 1, 1] * 50) + torch.arange(50).repeat_interleave(4) * 2
    batch = {"action": torch.zeros(200, dtype=torch.long), "force": torch.zeros(200, 4, 3)}
    batch |= {"sensor": ["digit"] * 200, "upright": torch.zeros(200, dtype=torch.bool)}
    flip = Augment(0.5, 0.5).labels(batch | {"group": group})["flip"].view(100, 2, 2)
    assert torch.equal(flip[:, 0], flip[:, 1])
    assert 0.3 < flip.float().mean() < 0.7


def test_jitter_treats_frames_and_background_alike() -> None:
    frames = torch.randint(40, 200, (2, 1, 3, 16, 16), dtype=torch.uint8).expand(-1, 4, -1, -1, -1)
    batch = {
        "frames": frames,
        "background": frames[:, 0],
        "flip": torch.zeros(2, 2, dtype=torch.bool),
        "coded": torch.zeros(2, dtype=torch.bool),
    }
    moved = Augment(0, 0, jitter=0.4)(batch)
    assert moved["frames"].dtype == torch.uint8
    assert not torch.equal(moved["frames"], frames)
    for frame in moved["frames"].unbind(1):
        assert torch.equal(frame, moved["background"])


def test_a_picture_of_taxels_stays_as_it_is() -> None:
    """Its colours are forces: mirrored, they would be those of another touch."""
    layout = TaxelLayout((16, 16), span=0.5)
    force = np.zeros((256, 3))
    force[100:103] = [0.3, -0.1, 0.4]
    drawn = torch.from_numpy(layout.draw(force, np.zeros((256, 3)))).permute(2, 0, 1)
    labels = {
        "action": torch.full((3,), ACTIONS.index("slide_right")),
        "force": torch.ones(3, 4, 3),
        "group": torch.tensor([5, 5, -1]),
        "sensor": ["serial_array", "digit", "digit"],
        "upright": torch.zeros(3, dtype=torch.bool),
    }
    augment = Augment(1.0, 1.0, jitter=0.4)
    frames = drawn.expand(3, 4, -1, -1, -1)
    batch = augment(augment.labels(labels) | {"frames": frames, "background": frames[:, 0]})
    assert torch.equal(batch["frames"][0], frames[0])
    # The second touch is matched with the first: neither is mirrored.
    assert batch["flip"].tolist() == [[False] * 2, [False] * 2, [True] * 2]
    assert batch["force"][:, 0, 0].tolist() == [1, 1, -1]
    for _ in range(9):  # of five other clips, four have other colours
        batch = augment(batch)
    assert torch.equal(batch["frames"][0], frames[0])
    assert not torch.equal(batch["frames"][1], frames[1])


def test_captions_follow_the_action() -> None:
    batch = {"action": torch.tensor([2, -1, 0]), "text": ["{action} a ball", "{action}", "plain"]}
    fill_captions(batch)
    assert batch["text"] == ["sliding left a ball", "touching", "plain"]
    assert set(PHRASES) == {*ACTIONS, ""}


@pytest.mark.parametrize("axis", [0, 1])
def test_the_surface_is_mirrored_with_the_pixels(axis: int) -> None:
    moved = np.random.default_rng(0).normal(0, 0.1, (1, 4, 8, 8, 3)).astype(np.float32)
    mirrored = np.flip(moved, 3 - axis).copy()
    mirrored[..., axis] *= -1
    given, want = (
        torch.from_numpy(displacement.encode_displacement(field)).movedim(-1, 2)
        for field in (moved, mirrored)
    )
    frames = torch.zeros(1, 4, 3, 8, 8, dtype=torch.uint8)
    chances = [0.0, 0.0]
    chances[axis] = 1.0
    augment = Augment(*chances)
    labels = {"action": torch.tensor([0]), "force": torch.zeros(1, 4, 3), "sensor": ["digit"]}
    batch = augment.labels(labels | ALONE)
    result = augment(batch | {"frames": frames, "background": frames[:, 0], "surface": given})
    assert torch.equal(result["surface"], want)


def test_changes_of_others_come_last_and_keep_shape_and_type() -> None:
    class Brighter(torch.nn.Module):
        def forward(self, batch: Batch) -> Batch:
            return {"frames": batch["frames"] + 1, "force": batch["force"] * 2}

    frames = torch.zeros(2, 4, 3, 8, 8, dtype=torch.uint8)
    frames[..., 0] = 9
    start = {"sensor": ["digit"] * 2, "force": torch.ones(2, 4, 3), "group": torch.arange(2)}
    start |= {"frames": frames, "background": frames[:, 0], "action": torch.zeros(2).long()}
    start |= {"upright": torch.zeros(2, dtype=torch.bool)}
    augment = Augment(1.0, 0.0, also={"brighter": Brighter()})
    assert augment.changes
    found = augment(augment.labels(start))
    assert found["frames"][0, 0, 0, 0].tolist() == [1] * 7 + [10], "mirrored, and then brighter"
    assert found["force"].abs().unique().tolist() == [2.0]
    assert found["background"].max() == 9
    (moved,) = augment.of_others
    assert moved is augment.also["brighter"], "moved to the device with it"
    for wrong, said in (
        (lambda batch: {"frames": batch["frames"].float()}, r"torch\.float32 \(2, 4, 3, 8, 8\)"),
        (lambda batch: {"background": batch["background"][:, :, :4]}, r"background torch\.uint8"),
        (lambda batch: batch["frames"], "returned Tensor"),
    ):
        augment = Augment(0.0, 0.0, also={"mine": wrong})
        with pytest.raises(ConfigError, match=rf"augment\.also\.mine .*{said}"):
            augment(augment.labels(start))
