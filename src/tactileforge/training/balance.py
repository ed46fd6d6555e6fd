"""Balances objectives by their gradients on the encoder.

The curriculum sets the weight of each objective; a balance multiplies it by a factor. The state of
a balance is kept in buffers, so a resumed run continues with it, and it is equal on every rank.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError, unknown
from tactileforge.util.distributed import sum_over_ranks, world


class FixedWeights(nn.Module):
    """Keeps the weights of the curriculum unchanged; the base of all balances.

    Args:
        keys: Names of the objectives.
        every: Steps between two measurements of each objective's gradient; 0 measures none.

    Attributes:
        moves: Whether `update` changes the factors.
        keys: Names of the K objectives, in the order of ``factor`` and ``norm``.
        factor: float (K,), factor on the weight of each objective.
        norm: float (K,), norm of the gradient of each objective's unweighted loss on all parameters
            of the encoder, at its last measurement; 0 before the first.
    """

    moves: ClassVar[bool] = False
    factor: Tensor
    norm: Tensor

    def __init__(self, keys: Sequence[str], every: int = 0) -> None:
        super().__init__()
        if every < 0:
            raise ConfigError(f"balance.every={every}: give a number of steps, 0 for never")
        self.keys = list(keys)
        self.every = every
        self._step = -1
        self.register_buffer("factor", torch.ones(len(keys)))
        self.register_buffer("norm", torch.zeros(len(keys)))

    def forward(
        self, losses: Mapping[str, Tensor], weights: Mapping[str, float], step: int, shared: Any
    ) -> Tensor:
        """The weighted sum of the losses of a training step.

        Args:
            losses: Loss of each computed objective on this rank, a scalar.
            weights: Weight of each objective in the curriculum.
            step: Optimiser steps taken so far.
            shared: The touch encoder.
        """
        if step == self._step:  # gradient accumulation: the factors are fixed within a step
            return self._weighted(losses, weights)
        self._step = step
        if self.every and step % self.every == 0:
            parameters = [p for p in shared.parameters() if p.requires_grad]
            # of the joint batch; an objective without a gradient keeps its last norm
            fresh = torch.zeros_like(self.norm)
            for i, key in enumerate(self.keys):
                if parameters and key in losses and losses[key].requires_grad:
                    fresh[i] = joint_norm(losses[key], parameters)
            self.norm.copy_(torch.where(fresh > 0, self._followed(fresh), self.norm))
        if self.moves:
            awake = self._moved([key in losses for key in self.keys])
            asleep = torch.zeros_like(self.factor[0])
            joint = torch.stack([losses.get(key, asleep).detach().float() for key in self.keys])
            self.update(sum_over_ranks(joint) / world()[1], awake, weights, step)
        return self._weighted(losses, weights)

    def _weighted(self, losses: Mapping[str, Tensor], weights: Mapping[str, float]) -> Tensor:
        if self.moves:
            losses = {key: self.factor[self.keys.index(key)] * loss for key, loss in losses.items()}
        return weighted_sum(losses, weights, self.factor.device)

    def update(
        self, losses: Tensor, awake: Tensor, weights: Mapping[str, float], step: int
    ) -> None:
        """Updates the factors; here they stay 1.

        Args:
            losses: float (K,), losses of the joint batch; 0 for an objective that is not computed
                or has no label in it.
            awake: bool (K,), whether each objective is computed.
            weights: Weight of each objective in the curriculum.
            step: Optimiser steps taken so far.
        """

    def logs(self, weights: Mapping[str, float]) -> dict[str, Tensor | float]:
        """Effective weights, and measured norms of the gradients, by name for the log."""
        values: dict[str, Tensor | float] = {}
        for i, key in enumerate(self.keys):
            values[f"weight/{key}"] = weights[key] * self.factor[i]
            if self.every and weights[key]:
                values[f"gradient/{key}"] = self.norm[i]
        return values

    def _moved(self, values: Sequence[float]) -> Tensor:
        """Copies numbers from the host to the device, without waiting for it."""
        return torch.tensor(values).to(self.factor.device, non_blocking=True)

    def _followed(self, fresh: Tensor) -> Tensor:
        return fresh


class GradClip(FixedWeights):
    """Clips each objective's weighted gradient on the encoder by itself, in every step.

    Args:
        keys: Names of the objectives.
        limit: Largest norm of one objective's weighted gradient.
    """

    moves: ClassVar[bool] = True

    def __init__(self, keys: Sequence[str], limit: float = 1.0) -> None:
        super().__init__(keys, every=1)
        if not limit > 0:
            raise ConfigError(f"balance.limit={limit}: give a value above 0")
        self.limit = limit

    def update(
        self, losses: Tensor, awake: Tensor, weights: Mapping[str, float], step: int
    ) -> None:
        """Scales down weighted gradients above the limit; see `FixedWeights.update`."""
        weighted = self._moved([weights.get(key, 0.0) for key in self.keys]) * self.norm
        self.factor.copy_((self.limit / weighted.clamp(min=self.limit)).clamp(max=1))


class GradNorm(FixedWeights):
    """Equalises the norms of the objectives' gradients on the encoder.

    An objective whose loss has fallen less than the others' gets a larger factor: with loss ratio
    ``r = (L / L first) / mean(L / L first)`` the norm of ``factor * gradient`` is proportional to
    ``r ** alpha``. Source: GradNorm (Chen et al. 2018, equations 1 and 2). The paper learns its
    weights; here each factor is set directly to the target of that learning, computed from moving
    averages of norms and losses. The geometric mean of the factors is 1, and each is kept between
    ``1 / bound`` and ``bound``, so that a loss with nothing left to learn does not take over.

    Args:
        keys: Names of the objectives.
        every: Steps between two measurements; each costs one backward pass per objective.
        alpha: Strength with which training rates are equalised; 0 equalises norms alone.
        keep: Share of the old moving average kept by a measurement, 0 or more, below 1.
        bound: Largest factor; the smallest is its inverse.
    """

    moves: ClassVar[bool] = True
    first: Tensor
    loss: Tensor

    def __init__(
        self,
        keys: Sequence[str],
        every: int = 10,
        alpha: float = 0.5,
        keep: float = 0.8,
        bound: float = 8.0,
    ) -> None:
        super().__init__(keys, every)
        _check(every=every, bound=bound - 1, keep=1 - keep)
        if keep < 0:
            raise ConfigError(f"balance.keep={keep}: give 0 or more, below 1")
        self.alpha = alpha
        self.keep = keep
        self.bound = bound
        #: float (K,), first loss of each objective; 0 before it.
        self.register_buffer("first", torch.zeros(len(keys)))
        #: float (K,), moving average of each loss; 0 before the first.
        self.register_buffer("loss", torch.zeros(len(keys)))

    def _followed(self, fresh: Tensor) -> Tensor:
        return torch.where(self.norm > 0, self.keep * self.norm + (1 - self.keep) * fresh, fresh)

    def update(
        self, losses: Tensor, awake: Tensor, weights: Mapping[str, float], step: int
    ) -> None:
        """Sets the factors to their targets after a measurement; see `FixedWeights.update`."""
        if step % self.every:
            return
        labelled = losses > 0  # a loss is 0 without a label in the batch
        self.first.copy_(torch.where(labelled & (self.first == 0), losses, self.first))
        moved = torch.where(self.loss > 0, self.keep * self.loss + (1 - self.keep) * losses, losses)
        self.loss.copy_(torch.where(labelled, moved, self.loss))
        known = awake & (self.norm > 0) & (self.first > 0)
        count = known.sum().clamp(min=1)
        # Chen et al.: ratio is L~_i = L_i / L_i(0), rate r_i = L~_i / mean(L~); the target norm of
        # w_i G_i is mean(G) r_i^alpha, so log w_i = alpha log r_i - log G_i up to a constant
        ratio = torch.where(known, self.loss / self.first.clamp(min=1e-12), 0.0)
        rate = ratio / (ratio.sum() / count).clamp(min=1e-12)
        target = self.alpha * rate.clamp(min=1e-6).log() - self.norm.clamp(min=1e-12).log()
        # less their mean: the geometric mean of the factors is 1, so the learning rate keeps its
        # size
        middle = torch.where(known, target, 0.0).sum() / count
        limit = math.log(self.bound)
        self.factor.copy_(torch.where(known, (target - middle).clamp(-limit, limit).exp(), 1.0))


class Uncertainty(FixedWeights):
    """Weights each loss by a factor ``exp(-s)``, with ``s`` following the size of the loss.

    Minimises ``exp(-s) * L + s`` over ``s`` by gradient descent, beside the training of the
    network: at the minimum, factor times loss is 1 for each objective. Source: Kendall, Gal and
    Cipolla 2018, equation 10, for any positive loss.

    Args:
        keys: Names of the objectives.
        rate: Step size of the descent in ``s``.
        bound: Largest factor; the smallest is its inverse.
        every: Steps between two measurements of the gradient norms, for the log alone; 0 measures
            none.
    """

    moves: ClassVar[bool] = True

    def __init__(
        self, keys: Sequence[str], rate: float = 0.05, bound: float = 8.0, every: int = 0
    ) -> None:
        super().__init__(keys, every)
        _check(rate=rate, bound=bound - 1)
        self.rate = rate
        self.bound = bound

    def update(
        self, losses: Tensor, awake: Tensor, weights: Mapping[str, float], step: int
    ) -> None:
        """Takes one step of the descent; see `FixedWeights.update`.

        An objective without labels in the step keeps its factor.
        """
        # Kendall et al.: s = log sigma^2; d/ds (exp(-s) L + s) = 1 - exp(-s) L
        log = self.factor.log()
        moved = log + self.rate * (1 - self.factor * losses)
        limit = math.log(self.bound)
        moved = moved.clamp(-limit, limit).exp()
        self.factor.copy_(torch.where(awake & (losses > 0), moved, self.factor))


def weighted_sum(
    losses: Mapping[str, Tensor], weights: Mapping[str, float], device: torch.device
) -> Tensor:
    """Sum of scalars, each times the weight of its name; 0 of none."""
    if not losses:
        return torch.zeros((), device=device)
    values = torch.stack(list(losses.values()))
    row = torch.tensor([weights[key] for key in losses], dtype=values.dtype)
    return (values * row.to(device, non_blocking=True)).sum()


def joint_norm(loss: Tensor, parameters: Sequence[Tensor]) -> Tensor:
    """Norm of the gradient of the joint batch; the graph is kept for the step's own backward.

    Args:
        loss: Scalar of this rank; its mean over ranks is the loss of the joint batch.
        parameters: Parameters to differentiate by.
    """
    # autograd.grad, not backward(): it fills no .grad, and fires no hook of DDP, which would count
    # it as the step's own
    grads = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
    flat = torch.cat(
        [
            (torch.zeros_like(p) if g is None else g).flatten().float()
            for p, g in zip(parameters, grads, strict=True)
        ]
    )
    norm: Tensor = torch.linalg.vector_norm(sum_over_ranks(flat) / world()[1])
    return norm


#: Balances by their name in the configuration; see `build_balance`.
BALANCES: dict[str, type[FixedWeights]] = {
    "none": FixedWeights,
    "clip": GradClip,
    "gradnorm": GradNorm,
    "uncertainty": Uncertainty,
}


def build_balance(config: Mapping[str, Any] | None, keys: Sequence[str]) -> FixedWeights:
    """Builds a balance from its configuration.

    Args:
        config: ``name``, and the options of its class; None for `FixedWeights`.
        keys: Names of the objectives.

    Raises:
        ConfigError: An unknown name or option, or a value that does not fit.
    """
    options = dict(config or {"name": "none"})
    name = str(options.pop("name"))
    if name not in BALANCES:
        raise ConfigError(unknown("balance", name, BALANCES))
    try:
        return BALANCES[name](keys, **options)
    except TypeError as error:
        raise ConfigError(f"balance={name}: {error}") from error


def _check(**values: float) -> None:
    for name, value in values.items():
        if not value > 0:
            raise ConfigError(f"balance.{name}: the value given is out of range")
