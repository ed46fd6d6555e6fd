"""A synthetic batch with every key of the contract."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.contracts import ACTIONS, Batch, Robot
from tactileforge.data.labels import displacement
from tactileforge.sensors.specs import spec

_SENSORS = ("gelsight", "digit")


def batch(size: int = 8, frames: int = 4, image: int = 32, seed: int = 0) -> Batch:
    """A synthetic batch: soft dents that grow under rising forces, fully labelled.

    Rows come in twos: one object and one action, touched by two sensors, in a group of their own.

    Args:
        size: Samples (B).
        frames: Frames of a clip (T).
        image: Height and width of frames, background and camera image.
        seed: The same seed gives the same batch.

    Returns:
        Every key of the table in `tactileforge.contracts`.

    Example:
        >>> len(batch(size=2)["sensor"])
        2
        >>> batch(size=2)["frames"].shape
        torch.Size([2, 4, 3, 32, 32])
    """
    draw = torch.Generator().manual_seed(seed)
    sensor = [_SENSORS[i % 2] for i in range(size)]
    pair = torch.arange(size) // 2
    scale = torch.tensor([spec(name).force_scale for name in sensor])
    rise = torch.linspace(0.2, 1, frames)[:, None] * torch.rand(size, 1, 3, generator=draw)
    background = 100 + 60 * torch.rand(size, 3, 1, 1, generator=draw).expand(-1, -1, image, image)
    place = torch.rand(size, 2, 1, 1, generator=draw) * 2 - 1
    y, x = torch.meshgrid(*[torch.linspace(-1, 1, image)] * 2, indexing="ij")
    dent = torch.exp(-((y - place[:, 0]) ** 2 + (x - place[:, 1]) ** 2) / 0.2)
    colour = 80 * torch.rand(size, 1, 3, 1, 1, generator=draw)
    pressed = background[:, None] + colour * rise[:, :, 2, None, None, None] * dent[:, None, None]
    return {
        "frames": _as_read(pressed.to(torch.uint8)),
        "background": _as_read(background.to(torch.uint8)),
        "sensor": sensor,
        "force": rise * scale[:, None],
        "force_valid": torch.ones(size, 3, dtype=torch.bool),
        "force_scale": scale,
        "action": pair % len(ACTIONS),
        "object": pair,
        "text": [f"a press on object {i}" for i in pair.tolist()],
        "image": _as_read(
            torch.randint(256, (size, 3, image, image), generator=draw).to(torch.uint8)
        ),
        "image_valid": torch.ones(size, dtype=torch.bool),
        "surface": _as_read(_surface(dent, rise)),
        "surface_valid": torch.ones(size, dtype=torch.bool),
        "group": pair.clone(),
        **_demonstrated(rise, image, draw),
    }


def _as_read(pixels: Tensor) -> Tensor:
    """Pixels (..., 3, H, W) as readers lay them out in memory: colours beside each other."""
    return pixels.movedim(-3, -1).contiguous().movedim(-1, -3)


def robot(image: int = 32) -> Robot:
    """Sizes of the demonstrations that `batch` holds: one finger, chunks of four commands."""
    return Robot(
        fingers=("left",),
        sensors=("digit",),
        state_size=3,
        action_size=2,
        rate=6.0,
        horizon=4,
        image_size=image,
    )


def _demonstrated(rise: Tensor, image: int, draw: torch.Generator) -> dict[str, Tensor]:
    """State, commands and camera images: the gripper opens as the force (B, T, 3) was high."""
    made, size = robot(image), len(rise)
    change = torch.stack([-rise[:, -1, 2], rise[:, -1, 0]], dim=-1)
    steps = (made.observations, 3, image, image)
    return {
        "state": torch.rand(size, made.observations, made.state_size, generator=draw) * 2 - 1,
        "action_chunk": change[:, None] * torch.linspace(1, 0.4, made.horizon)[:, None],
        "action_chunk_valid": torch.ones(size, made.horizon, dtype=torch.bool),
        "images": torch.randint(256, (size, *steps), generator=draw).to(torch.uint8),
    }


def _surface(dent: Tensor, rise: Tensor) -> Tensor:
    """Coded displacements of dents (B, H, W) that go along with their forces (B, T, 3)."""
    small = F.adaptive_avg_pool2d(dent[:, None], displacement.SHAPE)
    moved = 0.3 * rise[..., None, None] * small[:, None]
    coded = displacement.encode_displacement(moved.movedim(2, -1).numpy())
    return torch.from_numpy(coded).movedim(-1, 2).contiguous()


def rows_of(batch: Batch, rows: slice) -> Batch:
    """Some samples of a batch."""
    return {key: value[rows] for key, value in batch.items()}


def half_labelled(need: str) -> Batch:
    """Six samples of which the last three lack a label; garbage stands where it would be.

    The labelled three leave nothing to chance for a loss that draws partners: two samples of one
    object and action by two sensors, and one other, all in one group.

    Args:
        need: An entry of `contracts.Objective.needs`: one label, or several joined by ``|``.
    """
    made = batch(size=6)
    labels = need.split("|")
    made["group"][:3] = 0
    made["group"][3:] = 1
    if "force" in labels:
        made["force"][3:] = 1e4
        made["force_valid"][3:] = False
    if "image" in labels:
        made["image_valid"][3:] = False
    if "text" in labels:
        made["text"][3:] = [""] * 3
    if "action_chunk" in labels:
        made["action_chunk"][3:] = 1e4
        made["action_chunk_valid"][3:] = False
    for label in {"action", "object"} & set(labels):
        made[label][3:] = -1
        made["group"][3:] = -1
    return made


def without(batch: Batch, need: str) -> Batch:
    """A batch that does not have the keys of a need."""
    return {key: value for key, value in batch.items() if key not in need.split("|")}
