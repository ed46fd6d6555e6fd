"""Labels of mirrored and turned clips: forces, torques, poses, directions of actions.

A turn by an angle is clockwise in the picture (``x`` right, ``y`` down), about the axis into the
gel. A vector turns with the picture; a torque too, but keeps its sign where a mirror changes that
of a vector, and the other way round, for it is a product of two vectors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor

from tactileforge.contracts import ACTIONS, Batch, Column
from tactileforge.data.labels.actions import CLEAR
from tactileforge.data.labels.pixels import sample
from tactileforge.errors import DataError, PluginError

_SWAPS = {
    "horizontal": (("slide_left", "slide_right"), ("rotate_cw", "rotate_ccw")),
    "vertical": (("slide_up", "slide_down"), ("rotate_cw", "rotate_ccw")),
}
#: Slides in the order in which a turn by 90 degrees leads from one to the next.
_AROUND = ("slide_right", "slide_down", "slide_left", "slide_up")
#: Largest distance of an angle from a multiple of 90 degrees for a slide to have a name, degrees.
#: A slide lies within 37 degrees of the direction in its name, so it is still nearest to this.
SLIDE_SLACK = 45 - math.degrees(math.acos(CLEAR))
#: Last axes of one step of a column, by `Column.turns`.
STEPS = {
    "vector": ((2,), (3,)),
    "torque": ((), (3,)),
    "wrench": ((6,),),
    "pose": ((4, 4),),
    "field": ((2,),),
}


def flip_labels(batch: Batch, horizontal: Tensor, vertical: Tensor) -> None:
    """Flips forces and actions of flipped clips, in place.

    A horizontal flip negates the x shear and swaps left with right, a vertical one negates the y
    shear and swaps up with down; either swaps clockwise with counter-clockwise.

    Args:
        batch: On the host.
        horizontal: bool (B,), clips mirrored left to right.
        vertical: bool (B,), clips mirrored top to bottom.
    """
    for axis, (name, flipped) in enumerate((("horizontal", horizontal), ("vertical", vertical))):
        table = torch.tensor([*range(len(ACTIONS)), -1])  # the last entry keeps -1, unknown
        for one, other in _SWAPS[name]:
            i, j = ACTIONS.index(one), ACTIONS.index(other)
            table[i], table[j] = j, i
        batch["action"] = torch.where(flipped, table[batch["action"]], batch["action"])
        sign = torch.where(flipped, -1.0, 1.0)
        batch["force"] = batch["force"].clone()
        batch["force"][..., axis] *= sign[:, None]


def turn_labels(batch: Batch, angle: Tensor) -> None:
    """Turns forces and actions of turned clips, in place.

    A turn mixes the two shears: both are known afterwards only if both were. A slide has the name
    of its new direction near a multiple of 90 degrees (`SLIDE_SLACK`), and is unknown between.

    Args:
        batch: On the host.
        angle: Degrees (B,), clockwise in the picture; 0 for clips without a turn.
    """
    batch["force"] = transform(batch["force"], rotation(angle))
    shear = batch["force_valid"][:, :2]
    known = torch.where((angle == 0)[:, None], shear, shear.all(1, keepdim=True))
    batch["force_valid"] = torch.cat([known, batch["force_valid"][:, 2:]], dim=1)
    # int64 (4, actions + 1), actions after 0 to 3 quarter turns; the last column keeps -1, unknown
    table = torch.tensor([*range(len(ACTIONS)), -1]).repeat(4, 1)
    slides = torch.tensor([ACTIONS.index(name) for name in _AROUND])
    for turns in range(4):
        table[turns, slides] = slides.roll(-turns)
    quarters = (angle / 90).round()
    action = table[quarters.long() % 4, batch["action"]]
    between = (angle - 90 * quarters).abs() > SLIDE_SLACK
    batch["action"] = torch.where(between & torch.isin(action, slides), -1, action)


def rotation(angle: Tensor) -> Tensor:
    """Turns about z, clockwise in the picture: (B, 3, 3) of angles (B,) in degrees.

    Example:
        >>> right = torch.tensor([1.0, 0.0, 0.0])
        >>> (rotation(torch.tensor([90.0]))[0] @ right).int().tolist()
        [0, 1, 0]
    """
    turn = torch.deg2rad(angle)
    cos, sin, zero = turn.cos(), turn.sin(), torch.zeros_like(turn)
    rows = [cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


def frame_change(flip: Tensor, angle: Tensor) -> Tensor:
    """Matrices of a mirror followed by a turn, float32 (B, 3, 3).

    Args:
        flip: bool (B, 2), mirrored left to right, and top to bottom.
        angle: Degrees (B,), clockwise in the picture.
    """
    signs = torch.where(flip, -1.0, 1.0)
    return rotation(angle) * torch.cat([signs, torch.ones(len(flip), 1)], dim=1)[:, None]


def transform(values: Tensor, matrix: Tensor) -> Tensor:
    """Applies one matrix to all vectors of a clip.

    Args:
        values: Vectors (B, ..., 2) or (B, ..., 3).
        matrix: (B, 3, 3), which leaves x and y apart from z.
    """
    size = values.shape[-1]
    flat = values.reshape(len(values), -1, size)
    return (flat @ matrix[:, :size, :size].mT).view_as(values)


def turn_columns(
    batch: Batch,
    columns: Iterable[Column],
    matrix: Tensor,
    flip: Tensor | None = None,
    warp: Tensor | None = None,
) -> None:
    """Turn the columns with declared turns, in place.

    Args:
        batch: Batch on the host.
        columns: Columns of the batch; see `Column.turns`.
        matrix: Change of axes of each clip, (B, 3, 3), see `frame_change`.
        flip: bool (B, 2), mirrored clips, for fields; None for none.
        warp: float (B, 2, 3), see `pixels.move_clip`, for fields; None for none.
    """
    sign = torch.linalg.det(matrix).round()
    for column in columns:
        values = batch[column.name]
        if column.turns == "vector":
            batch[column.name] = transform(values, matrix)
        elif column.turns == "torque" and values.ndim == 2:  # about z alone
            batch[column.name] = values * sign[:, None]
        elif column.turns == "torque":
            batch[column.name] = transform(values, matrix * sign[:, None, None])
        elif column.turns == "wrench":
            force, torque = values.split(3, dim=-1)
            turned = transform(torque, matrix * sign[:, None, None])
            batch[column.name] = torch.cat([transform(force, matrix), turned], dim=-1)
        elif column.turns == "pose":
            whole = torch.eye(4).repeat(len(matrix), 1, 1)
            whole[:, :3, :3] = matrix
            whole = whole.view(-1, *(1 for _ in values.shape[1:-2]), 4, 4)
            # into the new axes: the change, the pose, and the change undone, whose inverse is its
            # transpose, as for each mirror and turn
            batch[column.name] = whole @ values @ whole.mT
        elif column.turns == "field":
            batch[column.name] = _move_field(transform(values, matrix), flip, warp)


def _move_field(field: Tensor, flip: Tensor | None, warp: Tensor | None) -> Tensor:
    """Move the places of turned vectors (B, T, h, w, 2); a magnified picture has longer ones."""
    if flip is not None:
        for axis in (0, 1):
            mirrored = flip[:, axis, None, None, None, None]
            field = torch.where(mirrored, field.flip(3 - axis), field)
    if warp is None:
        return field
    images = field.movedim(-1, 2)
    # areas grow by the determinant, so lengths by its root
    factor: Tensor = torch.linalg.det(warp[:, :, :2]).abs().sqrt()
    moved: Tensor = sample(images.flatten(1, 2), warp, "zeros").view_as(images).movedim(2, -1)
    return moved * factor.view(-1, 1, 1, 1, 1)


def check_turns(column: Column, shape: tuple[int, ...]) -> None:
    """Checks whether the steps of a column can turn as declared.

    Args:
        column: Declared column.
        shape: Shape of one step in the data.

    Raises:
        PluginError: `Column.turns` is unknown, or the column holds whole numbers.
        DataError: The steps have another shape.
    """
    if not column.turns:
        return
    if column.turns not in STEPS or column.dtype != "float32":
        raise PluginError(
            f"the column {column.name!r} declares turns={column.turns!r} and dtype="
            f"{column.dtype!r}: give float32 and one of {', '.join(STEPS)}, or leave turns out"
        )
    known = STEPS[column.turns]
    if column.turns == "field" and len(shape) != 3:
        raise DataError(
            f"a step of the track {column.track or column.name!r} is {shape}, and a field is "
            "(rows, columns, 2); give such a track, or leave turns out"
        )
    if not any(shape == ends or (ends and shape[-len(ends) :] == ends) for ends in known):
        raise DataError(
            f"a step of the track {column.track or column.name!r} is {shape}, and one that turns "
            f"as a {column.turns} ends in {' or '.join(map(str, known))}; give such a track, or "
            "leave turns out"
        )
