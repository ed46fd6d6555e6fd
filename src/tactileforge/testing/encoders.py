"""The checks of encoders: touch encoders, and the towers of text and camera images.

The attribute ``modality`` of an encoder is ``touch`` (the default), ``text`` or ``image``.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tactileforge.testing.batches import batch, rows_of
from tactileforge.testing.modules import (
    finite,
    leaves,
    reloaded,
    require_close,
    require_equal,
    require_export,
    require_row,
)
from tactileforge.testing.results import Check, CheckSubject, Skip, require
from tactileforge.testing.trained_encoders import CHECKS as OF_RUNS
from tactileforge.testing.trained_encoders import known_sensors


def _build(subject: CheckSubject, seed: int = 0) -> Any:
    torch.manual_seed(seed)
    return subject.build().eval()


def _modality(encoder: Any) -> str:
    return str(getattr(encoder, "modality", "touch"))


def _inputs(encoder: Any, size: int) -> tuple[Any, ...]:
    """Arguments of a call: ``size`` samples, with an image size different from the encoder's."""
    if _modality(encoder) == "touch":
        made = batch(size, frames=encoder.frames, image=48)
        rows = [encoder.sensors.get(name, 0) for name in known_sensors(encoder, size)]
        return made["frames"], made["background"], torch.tensor(rows)
    made = batch(size, image=48)
    return (made[_modality(encoder)],)


def _call(encoder: Any, size: int) -> list[Tensor]:
    with torch.no_grad():
        return leaves(encoder(*_inputs(encoder, size)))


def declared_sizes_are_true(subject: CheckSubject) -> None:
    """Outputs have the shapes declared by the encoder."""
    encoder = _build(subject)
    out = _call(encoder, 4)
    require(finite(out), "not every output is finite")
    want: list[tuple[int, ...]] = [(4, encoder.width)]
    if _modality(encoder) == "touch":
        slots, rows, columns = encoder.grid
        height, width = encoder.image_size
        grid = (encoder.frames // encoder.tube, height // encoder.patch, width // encoder.patch)
        require(grid == (slots, rows, columns), f"grid is {encoder.grid}, its sizes say {grid}")
        length = encoder.prefix + slots * rows * columns
        want = [(4, length, encoder.width), (4, encoder.projected)]
    got = [tuple(tensor.shape) for tensor in out]
    require(got == want, f"outputs have shapes {got}; it declares {want}")


def views_are_what_they_declare(subject: CheckSubject) -> None:
    """Full and masked views have the contract's shapes, and the full one is the forward pass."""
    encoder = _build(subject)
    if _modality(encoder) != "touch":
        raise Skip("only touch encoders have views")
    made = batch(4, frames=encoder.frames, image=48) | {"sensor": known_sensors(encoder, 4)}
    with torch.no_grad():
        views = encoder.views(made)
        full, masked = views.full, views.masked
        require(full is views.full and masked is views.masked, "a view is computed twice")
        require_close([full.tokens, full.cls], _call(encoder, 4), "views.full and the forward pass")
    slots, rows, columns = encoder.grid
    count = rows * columns
    shape: tuple[int, ...] = (4, slots, count, 3 * encoder.tube * encoder.patch**2)
    require(views.patches.shape == shape, f"patches are {tuple(views.patches.shape)}, not {shape}")
    places = torch.cat([masked.kept, masked.masked], dim=1).sort(dim=1).values
    require(
        torch.equal(places, torch.arange(count).expand(4, -1)),
        "kept and masked positions together are not every position once",
    )
    shape = (4, encoder.prefix + slots * masked.kept.shape[1], encoder.projected)
    got = tuple(masked.tokens.shape)
    require(got == shape, f"tokens of the masked view are {got}, not {shape}")


def eval_is_deterministic(subject: CheckSubject) -> None:
    """The same input gives the same output twice."""
    encoder = _build(subject)
    require_equal(_call(encoder, 4), _call(encoder, 4), "two calls in eval mode differ")


def batch_of_one_equals_a_row(subject: CheckSubject) -> None:
    """A sample does not depend on its neighbours."""
    encoder = _build(subject)
    inputs = _inputs(encoder, 4)
    # `rows_of`, as the inputs of text are lists
    first_row = tuple(rows_of({"x": value}, slice(1))["x"] for value in inputs)
    with torch.no_grad():
        require_row(leaves(encoder(*inputs)), leaves(encoder(*first_row)))


def torch_export_matches(subject: CheckSubject) -> None:
    """The exported program gives the same numbers."""
    encoder = _build(subject)
    if _modality(encoder) == "text":
        raise Skip("torch.export takes no list of strings")
    require_export(encoder, _inputs(encoder, 2))


def save_and_load_are_bit_equal(subject: CheckSubject) -> None:
    """Saved weights, loaded into a new encoder of the same options, give the same bits."""
    encoder, other = _build(subject), _build(subject, seed=1)
    reloaded(encoder, other)
    require_equal(_call(encoder, 2), _call(other, 2), "the reloaded encoder gives other numbers")


CHECKS: list[Check] = [
    declared_sizes_are_true,
    views_are_what_they_declare,
    eval_is_deterministic,
    batch_of_one_equals_a_row,
    torch_export_matches,
    save_and_load_are_bit_equal,
    *OF_RUNS,
]
