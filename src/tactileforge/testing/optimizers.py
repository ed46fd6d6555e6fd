"""Checks of optimisers."""

from __future__ import annotations

import io
from copy import deepcopy

import torch
from torch import Tensor, nn

from tactileforge.testing.results import Check, CheckSubject, require


def _network() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(8, 16), nn.LayerNorm(16), nn.GELU(), nn.Linear(16, 4))


def _built(subject: CheckSubject, network: nn.Module) -> torch.optim.Optimizer:
    built: torch.optim.Optimizer = subject.build().build(list(network.named_parameters()), False)
    return built


def _step(network: nn.Module, optimizer: torch.optim.Optimizer, number: int) -> Tensor:
    rng = torch.Generator().manual_seed(number % 4)  # four batches, so that losses compare
    x = torch.randn(32, 8, generator=rng)
    loss: Tensor = (network(x) - x[:, :4].cumsum(1)).pow(2).mean()
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    return loss.detach()


def _different(network: nn.Module, other: nn.Module) -> list[str]:
    """Names of the parameters with different bits in two networks."""
    pairs = zip(network.named_parameters(), other.parameters(), strict=True)
    return [name for (name, p), q in pairs if not torch.equal(p, q)]


def each_parameter_is_in_one_group(subject: CheckSubject) -> None:
    """`build` returns a ``torch.optim.Optimizer`` with each parameter once."""
    network = _network()
    optimizer = _built(subject, network)
    kind = type(optimizer).__name__
    require(isinstance(optimizer, torch.optim.Optimizer), f"build gives a {kind}")
    held = [id(p) for group in optimizer.param_groups for p in group["params"]]
    names = {id(p): name for name, p in network.named_parameters()}
    missing = sorted(name for key, name in names.items() if held.count(key) != 1)
    require(not missing, f"{missing} are in no group, or in several")
    lacking = [i for i, group in enumerate(optimizer.param_groups) if "lr" not in group]
    require(not lacking, f"groups {lacking} have no 'lr', which the schedule scales")


def fifty_steps_lower_the_loss(subject: CheckSubject) -> None:
    """It trains a small network."""
    network = _network()
    optimizer = _built(subject, network)
    for group in optimizer.param_groups:
        # rates for large models are too small to be seen in 50 steps of a small one
        group["lr"] = max(group["lr"], 1e-2)
    losses = [float(_step(network, optimizer, number)) for number in range(50)]
    first, last = sum(losses[:4]) / 4, sum(losses[-4:]) / 4
    require(last < 0.9 * first, f"it was {first:.3g} and is {last:.3g}")


def learning_rate_0_changes_nothing(subject: CheckSubject) -> None:
    """Every change of a weight scales with ``lr`` of its group, as set by the schedule."""
    network = _network()
    optimizer = _built(subject, network)
    for group in optimizer.param_groups:
        group["lr"] = 0.0
    before = deepcopy(network)
    _step(network, optimizer, 0)
    moved = _different(network, before)
    require(not moved, f"{moved} changed")


def goes_on_bit_identically(subject: CheckSubject) -> None:
    """Its state is tensors and plain data, and training resumes from a checkpoint bit by bit."""
    network = _network()
    optimizer = _built(subject, network)
    for number in range(3):
        _step(network, optimizer, number)
    file = io.BytesIO()
    torch.save([network.state_dict(), optimizer.state_dict()], file)
    file.seek(0)
    weights, state = torch.load(file, weights_only=True)  # as checkpoints are read: no code runs
    again = _network()
    again.load_state_dict(weights)
    resumed = _built(subject, again)
    resumed.load_state_dict(state)
    for number in range(3, 6):
        _step(network, optimizer, number)
        _step(again, resumed, number)
    other = _different(network, again)
    require(not other, f"{other} differ three steps after a checkpoint was loaded")


def parameters_without_gradient_stay(subject: CheckSubject) -> None:
    """Parameters without gradient do not change, such as a head before its objective begins."""
    network = _network()
    optimizer = _built(subject, network)
    before = deepcopy(network)
    network[0](torch.ones(2, 8)).sum().backward()  # no gradient reaches the layers after it
    idle = {name for name, p in network.named_parameters() if p.grad is None}
    optimizer.step()
    moved = sorted(idle.intersection(_different(network, before)))
    require(not moved, f"{moved} changed")


CHECKS: list[Check] = [
    each_parameter_is_in_one_group,
    fifty_steps_lower_the_loss,
    learning_rate_0_changes_nothing,
    goes_on_bit_identically,
    parameters_without_gradient_stay,
]
