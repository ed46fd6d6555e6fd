"""The checks of objectives, each fed by its head on a small encoder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import LABELS, Batch, Views
from tactileforge.data.batches.columns import own_columns
from tactileforge.errors import PluginError
from tactileforge.plugins import class_contracts, local, registry
from tactileforge.testing.batches import (
    batch,
    context_of,
    half_labelled,
    rows_of,
    with_columns,
    without,
)
from tactileforge.testing.modules import SMALL_HEADS, finite, small_context, views_of
from tactileforge.testing.nan_causes import cause_of_nan
from tactileforge.testing.results import Check, CheckSubject, Skip, Violation, construct, require
from tactileforge.training.parts import Term, check_scalars, term_of


@dataclass(frozen=True)
class _Parts:
    encoder: Any
    head: Any
    objective: Any

    @property
    def modules(self) -> nn.ModuleList:
        return nn.ModuleList([self.encoder, self.head, self.objective])

    def __call__(self, made: Batch) -> Tensor:
        """The loss."""
        return self.term(made).loss.value

    def term(self, made: Batch) -> Term:
        torch.manual_seed(0)  # masks are drawn: two calls of one batch are to hide the same tubes
        return self.of_views(self.encoder.views(made), made)

    def of_views(self, views: Views, made: Batch) -> Term:
        with _of_head(type(self.head).__name__):
            prediction = self.head(views, made)
        name = type(self.objective).__name__
        term = term_of(name, self.objective, prediction, made)
        check_scalars(name, term)
        return term


@contextmanager
def _of_head(name: str) -> Iterator[None]:
    """Names the head in its errors, in place of the objective.

    Raises:
        Violation: The head raised.
    """
    try:
        yield
    except PluginError as error:
        raise Violation(f"its head {name} is at fault: {error}") from error
    except Exception as error:  # it raises what it likes
        raise Violation(f"its head {name} is at fault: {local.place_of(error)}") from error


def _parts(subject: CheckSubject) -> _Parts:
    plugins = _plugins(subject)
    context = small_context() | context_of(plugins)
    named = subject.head or subject.plugin.head
    made = _plugins(subject)[0]
    with _of_head(made.__name__):
        class_contracts.check_contract("heads", made, "it")
        head = construct(made, SMALL_HEADS.get(named, {}), context)
    return _Parts(context["encoder"], head, subject.build(**context))


def _plugins(subject: CheckSubject) -> list[type[Any]]:
    """Classes of the head and of the objective."""
    head = subject.head or subject.plugin.head
    return [registry.get("heads", head) if isinstance(head, str) else head, subject.plugin]


def _batch(subject: CheckSubject) -> Batch:
    return with_columns(batch(), _plugins(subject))


def _needs(subject: CheckSubject) -> list[str]:
    """Labels and columns of the objective.

    Raises:
        Skip: The objective needs no labels.
    """
    columns = own_columns(subject.plugin, registry.parameters(subject.plugin))
    needs = sorted({*subject.plugin.needs, *(column.name for column in columns)})
    if not needs:
        raise Skip("it needs no labels")
    return needs


def head_and_needs_are_declared(subject: CheckSubject) -> None:
    """``head`` names an installed head, or is one; ``needs`` lists labels."""
    head = getattr(subject.plugin, "head", None)
    require(isinstance(head, str | type), "the class attribute 'head' does not name a head")
    if subject.head is None and isinstance(head, str):
        registry.get("heads", head)
    needs = getattr(subject.plugin, "needs", None)
    require(isinstance(needs, frozenset), "the class attribute 'needs' is not a frozenset")
    for need in needs or ():
        odd = set(need.split("|")) - set(LABELS)
        odd = set() if hasattr(_plugins(subject)[0], "example") else odd  # a data set of its own
        require(not odd, f"needs lists {sorted(odd)}; labels are {sorted(LABELS)}")


def loss_is_a_finite_scalar(subject: CheckSubject) -> None:
    """Loss and logged values are finite scalars."""
    term = _parts(subject).term(_batch(subject))
    means = {"loss": term.loss, **term.extra}
    for name, value in {name: mean.value for name, mean in means.items()}.items():
        require(value.ndim == 0, f"{name} has shape {tuple(value.shape)}: it must be a scalar")
        if not bool(torch.isfinite(value)):
            cause = cause_of_nan(partial(_parts(subject), _batch(subject)))
            raise Violation(f"{name} is {value.item()}{cause}")


def every_own_parameter_gets_gradient(subject: CheckSubject) -> None:
    """Every parameter of head and objective gets a gradient within three steps.

    A layer initialised with zeros hides the layers before it in the first step.
    """
    parts = _parts(subject)
    # a head may hold the encoder's own parameters, which are the encoder's to check
    shared = {id(parameter) for parameter in parts.encoder.parameters()}
    parameters = {
        name: parameter
        for part in (parts.head, parts.objective)
        for name, parameter in part.named_parameters(type(part).__name__)
        if parameter.requires_grad and id(parameter) not in shared
    }
    reached = set()
    optimizer = torch.optim.SGD(parts.modules.parameters(), lr=1e-2)
    for _ in range(3):
        optimizer.zero_grad()
        torch.autograd.backward(parts(_batch(subject)))
        reached |= {n for n, p in parameters.items() if p.grad is not None and bool(p.grad.any())}
        optimizer.step()
    idle = sorted(set(parameters) - reached)
    require(not idle, f"no gradient reaches {', '.join(idle)}")


def twenty_steps_lower_the_loss(subject: CheckSubject) -> None:
    """Training on one batch lowers the loss at one of three learning rates."""
    ends = []
    for rate in (1e-4, 1e-5, 1e-6):
        parts = _parts(subject)
        optimizer = torch.optim.AdamW(parts.modules.parameters(), lr=rate)
        losses = []
        cause = ""
        for step in range(21):  # the last loss is the one after 20 steps
            optimizer.zero_grad()
            made = _batch(subject)
            loss = parts(made)
            losses.append(float(loss.detach()))
            torch.autograd.backward(loss)
            if any(map(math.isnan, [losses[-1], *map(_sum, _gradients(parts))])):
                cause = f" in step {step}{cause_of_nan(partial(parts, made))}"
                losses[-1] = math.nan
                break
            optimizer.step()
        if losses[-1] < losses[0]:
            return
        ends.append(f"{losses[-1]:.4g} at a learning rate of {rate:g}{cause}")
    require(False, f"it was {losses[0]:.4g} and after 20 steps is {', '.join(ends)}")


def _gradients(parts: _Parts) -> list[Tensor]:
    return [p.grad for p in parts.modules.parameters() if p.grad is not None]


def _sum(tensor: Tensor) -> float:
    return float(tensor.sum())


def same_seed_same_loss(subject: CheckSubject) -> None:
    """Two builds with the same seed give the same loss."""
    first, second = (float(_parts(subject)(_batch(subject)).detach()) for _ in range(2))
    require(first == second, f"{first!r}, then {second!r}")


def bf16_autocast_works(subject: CheckSubject) -> None:
    """The loss is within 10 % of the loss in fp32, and gradients are finite."""
    parts = _parts(subject)
    full = float(parts(_batch(subject)).detach())
    with torch.autocast("cpu", torch.bfloat16):
        loss = parts(_batch(subject))
    torch.autograd.backward(loss)
    gap = abs(float(loss.detach()) - full)
    # + 0.02 for losses near 0, of which bfloat16's two to three digits are a large share
    require(gap <= 0.1 * abs(full) + 0.02, f"the loss is {loss.item():.4g}, in fp32 {full:.4g}")
    require(finite(_gradients(parts)), "a gradient is not finite")


def unlabelled_samples_change_nothing(subject: CheckSubject) -> None:
    """A half labelled batch has the loss of its labelled half. Without labels it is finite."""
    needs = _needs(subject)
    parts = _parts(subject)
    for need in needs:
        made = half_labelled(need, _plugins(subject))
        views = views_of(parts.encoder, made)
        losses = []
        for rows in (slice(3), slice(6), slice(3, 6)):
            torch.manual_seed(0)  # a loss may draw partners
            with torch.no_grad():
                term = parts.of_views(views.rows(rows), rows_of(made, rows))
            losses.append(float(term.loss.value))
        labelled, half, none = losses
        require(
            abs(labelled - half) <= 1e-5 * max(1.0, abs(labelled)),
            f"with 3 samples that have {need!r} it is {labelled:.6g}, with 3 more that lack it "
            f"{half:.6g}",
        )
        # a mean over no sample is NaN, and NaN in one step ends a training
        if not math.isfinite(none):
            few = partial(parts.of_views, views.rows(slice(3, 6)), rows_of(made, slice(3, 6)))
            cause = cause_of_nan(lambda: few().loss.value)  # noqa: B023 - called at once
            raise Violation(f"with no {need!r} at all it is {none}{cause}")


def labels_are_counted(subject: CheckSubject) -> None:
    """A loss over labels is a `means.Mean` with a count of 0 for a batch without labels."""
    needs = _needs(subject)
    parts = _parts(subject)
    for need in needs:
        made = half_labelled(need, _plugins(subject))
        views = views_of(parts.encoder, made).rows(slice(3, 6))
        with torch.no_grad():
            count = parts.of_views(views, rows_of(made, slice(3, 6))).loss.count.item()
        require(
            count == 0,
            f"3 samples without {need!r} count as {count:g} in the validation loss: return what "
            "masked_mean returns, or a means.Mean",
        )


def missing_key_is_named(subject: CheckSubject) -> None:
    """A batch without a needed key raises an error with the name of the key."""
    needs = _needs(subject)
    parts = _parts(subject)
    for need in needs:
        try:
            parts(without(_batch(subject), need))
        except Exception as error:  # a KeyError does, which names the key
            named = any(key in str(error) for key in need.split("|"))
            require(named, f"without {need!r} it raises {type(error).__name__}: {error}")
        else:
            raise Violation(f"it needs {need!r}, and gives a loss without")


CHECKS: list[Check] = [
    head_and_needs_are_declared,
    loss_is_a_finite_scalar,
    every_own_parameter_gets_gradient,
    twenty_steps_lower_the_loss,
    same_seed_same_loss,
    bf16_autocast_works,
    unlabelled_samples_change_nothing,
    labels_are_counted,
    missing_key_is_named,
]
