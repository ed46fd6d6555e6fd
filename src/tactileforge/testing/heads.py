"""The checks of heads."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.testing.batches import batch, context_of, rows_of, with_columns
from tactileforge.testing.modules import (
    FrozenViews,
    finite,
    leaves,
    reloaded,
    require_equal,
    require_export,
    require_row,
    small_context,
    views_of,
)
from tactileforge.testing.results import Check, CheckSubject, require


def _predict(head: Any, views: FrozenViews, made: Batch) -> list[Tensor]:
    torch.manual_seed(0)
    with torch.no_grad():
        return leaves(head(views, made))


def _parts(subject: CheckSubject, seed: int = 0) -> tuple[Any, FrozenViews, Batch]:
    """A head in eval mode, and views and batch of four samples for it."""
    context = small_context()
    made = with_columns(batch(4), [subject.plugin])
    views = views_of(context["encoder"], made)
    given = small_context(seed) | context_of([subject.plugin])
    return subject.build(**given).eval(), views, made


def sizes_follow_the_encoder(subject: CheckSubject) -> None:
    """A head takes its sizes from the encoder: it works with more frames and a finer grid."""
    for frames, image in ((4, 32), (6, 48)):
        context = small_context(frames=frames, image=image) | context_of([subject.plugin])
        made = with_columns(batch(4, frames, image), [subject.plugin])
        out = _predict(subject.build(**context).eval(), views_of(context["encoder"], made), made)
        require(bool(out), "the prediction has no tensor")
        require(finite(out), f"the prediction of {frames} frames of {image} pixels is not finite")


def eval_is_deterministic(subject: CheckSubject) -> None:
    """The same input gives the same prediction twice."""
    head, views, made = _parts(subject)
    first = _predict(head, views, made)
    with torch.no_grad():  # in another state of the random generator
        require_equal(first, leaves(head(views, made)), "two calls in eval mode differ")


def batch_of_one_equals_a_row(subject: CheckSubject) -> None:
    """A sample's prediction does not depend on its neighbours."""
    head, views, made = _parts(subject)
    first_row = _predict(head, views.rows(slice(1)), rows_of(made, slice(1)))
    require_row(_predict(head, views, made), first_row)


class _OfTensors(nn.Module):
    """A head as a function of tensors, since ``torch.export`` takes no dataclasses or strings."""

    def __init__(self, head: nn.Module, views: FrozenViews, made: Batch) -> None:
        super().__init__()
        self.head = head
        self.views = views
        self.encoder = getattr(views.source, "encoder", None)  # of `Views.other`
        self.words = {key: value for key, value in made.items() if isinstance(value, list)}

    def forward(self, views: dict[str, Tensor], made: dict[str, Tensor]) -> list[Tensor]:
        return leaves(self.head(self.views.with_tensors(views), {**made, **self.words}))


def torch_export_matches(subject: CheckSubject) -> None:
    """The exported program gives the same numbers."""
    head, views, made = _parts(subject)
    tensors = {key: value for key, value in made.items() if isinstance(value, Tensor)}
    require_export(_OfTensors(head, views, made), (views.tensors(), tensors))


def save_and_load_are_bit_equal(subject: CheckSubject) -> None:
    """Saved weights, loaded into a new head of the same options, give the same bits."""
    head, views, made = _parts(subject)
    other = _parts(subject, seed=1)[0]
    reloaded(head, other)
    message = "the reloaded head gives other numbers"
    require_equal(_predict(head, views, made), _predict(other, views, made), message)


CHECKS: list[Check] = [
    sizes_follow_the_encoder,
    eval_is_deterministic,
    batch_of_one_equals_a_row,
    torch_export_matches,
    save_and_load_are_bit_equal,
]
