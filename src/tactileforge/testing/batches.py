"""A synthetic batch with every key of the contract."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.contracts import ACTIONS, LABELS, Batch, Column, ColumnSize
from tactileforge.data.batches.columns import declared_columns
from tactileforge.data.labels import displacement
from tactileforge.data.labels.turns import STEPS
from tactileforge.plugins import registry
from tactileforge.specs.published import spec

#: Types of sensors of the samples, in turn.
_SENSORS = ("gelsight", "digit")


def batch(size: int = 8, frames: int = 4, image: int = 32, seed: int = 0) -> Batch:
    """Draws a synthetic batch: soft dents growing under rising forces, fully labelled.

    Rows come in twos: one object and one action, touched by two sensors, in a group of their own.

    Args:
        size: Number of samples B.
        frames: Number of frames T of a clip.
        image: Height and width of frames, background and camera image, pixels.
        seed: Seed of the random generator; the same seed gives the same batch.

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
    pair = torch.arange(size) // 2  # one object by two sensors, as `match` needs it
    scale = torch.tensor([spec(name).force_scale for name in sensor])
    rise = torch.linspace(0.2, 1, frames)[:, None] * torch.rand(size, 1, 3, generator=draw)
    background = 100 + 60 * torch.rand(size, 3, 1, 1, generator=draw).expand(-1, -1, image, image)
    place = torch.rand(size, 2, 1, 1, generator=draw) * 2 - 1
    y, x = torch.meshgrid(*[torch.linspace(-1, 1, image)] * 2, indexing="ij")
    dent = torch.exp(-((y - place[:, 0]) ** 2 + (x - place[:, 1]) ** 2) / 0.2)
    colour = 80 * torch.rand(size, 1, 3, 1, 1, generator=draw)
    # pictures follow the normal force, so that a small encoder can learn from them
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
        "aspect": torch.ones(size),
        "upright": torch.zeros(size, dtype=torch.bool),
    }


def _as_read(pixels: Tensor) -> Tensor:
    """Pixels (..., 3, H, W) with channels last in memory, as data readers give them."""
    return pixels.movedim(-3, -1).contiguous().movedim(-1, -3)


#: Width of one step of an extra column that neither turns nor declares a shape.
_STEP = 2


def with_columns(made: Batch, plugins: Iterable[type[Any]]) -> Batch:
    """Adds the columns declared by heads and objectives with their default options.

    Floats are proportional to the normal force at the end of the clip; whole numbers are 0 and 1.

    Args:
        made: Batch made by `batch`.
        plugins: Classes of heads and objectives. A static method ``example(batch)`` of a class
            returns ``facts``, and the further keys provided by its data set.
    """
    size, frames = made["frames"].shape[:2]
    pressed = made["force"][:, -1, 2] / made["force_scale"][:, 2]
    found: Batch = {}
    for column in _declared(plugins):
        steps = frames if column.window is None else column.window[1] - column.window[0]
        step = _step_of(column)
        values = pressed.view(-1, *(1 for _ in range(1 + len(step))))
        values = values.expand(size, steps, *step).clone()
        is_whole = column.dtype == "int64"
        found[column.name] = (values > values.median()).long() if is_whole else values
        found[f"{column.name}_valid"] = torch.ones(size, steps, dtype=torch.bool)
    for plugin in plugins:
        found |= plugin.example(made)[1] if hasattr(plugin, "example") else {}
    return {**made, **found}


def context_of(plugins: Iterable[type[Any]]) -> dict[str, Any]:
    """Sizes of the columns and facts for a batch of `with_columns`."""
    sizes = {
        one.name: ColumnSize(
            shape=_step_of(one),
            mean=(0.5,) * math.prod(_step_of(one)),
            deviation=(0.25,) * math.prod(_step_of(one)),
        )
        for one in _declared(plugins)
    }
    made = batch(2)
    facts = [one.example(made)[0] for one in plugins if hasattr(one, "example")]
    return {"column_sizes": sizes, "facts": {k: v for known in facts for k, v in known.items()}}


def _step_of(column: Column) -> tuple[int, ...]:
    """Shape of one step of an extra column."""
    if column.shape is not None:
        return column.shape
    if column.turns == "field":
        return (4, 4, 2)
    return STEPS[column.turns][-1] if column.turns else (_STEP,)


def _declared(plugins: Iterable[type[Any]]) -> tuple[Column, ...]:
    return declared_columns((one.__name__, one, registry.parameters(one)) for one in plugins)


def _surface(dent: Tensor, rise: Tensor) -> Tensor:
    """Coded displacements of dents (B, H, W), proportional to their forces (B, T, 3)."""
    small = F.adaptive_avg_pool2d(dent[:, None], displacement.SHAPE)
    moved = 0.3 * rise[..., None, None] * small[:, None]
    coded = displacement.encode_displacement(moved.movedim(2, -1).numpy())
    return torch.from_numpy(coded).movedim(-1, 2).contiguous()


def rows_of(batch: Batch, rows: slice) -> Batch:
    """Selects samples of a batch."""
    return {key: value[rows] for key, value in batch.items()}


def half_labelled(need: str, plugins: Iterable[type[Any]] = ()) -> Batch:
    """Six samples, three labelled and three with garbage in place of a label.

    The three labelled samples leave no random choice to a loss that draws partners: two samples of
    one object and action by two sensors, and a third one, all in one group.

    Args:
        need: An entry of `contracts.Objective.needs`: one label, or several joined by ``|``; or the
            name of a column.
        plugins: Classes of heads and objectives, see `with_columns`.
    """
    made = with_columns(batch(size=6), plugins)
    labels = need.split("|")
    made["group"][:3] = 0
    made["group"][3:] = 1
    if "force" in labels:
        made["force"][3:] = 1e4  # so large that a loss shows it
        made["force_valid"][3:] = False
    if "surface" in labels:
        made["surface"][3:] = 255
    for label in {"image", "surface"} & set(labels):
        made[f"{label}_valid"][3:] = False
    if "text" in labels:
        made["text"][3:] = [""] * 3
    for label in set(labels) - set(LABELS):
        made[label][3:] = 99
        made[f"{label}_valid"][3:] = False
    for label in {"action", "object"} & set(labels):
        made[label][3:] = -1
        made["group"][3:] = -1
    return made


def without(batch: Batch, need: str) -> Batch:
    """Drops the keys of a need from a batch."""
    return {key: value for key, value in batch.items() if key not in need.split("|")}
