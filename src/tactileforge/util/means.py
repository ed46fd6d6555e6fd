"""A mean together with its number of labels."""

from __future__ import annotations

import builtins
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactileforge.errors import PluginError

#: Fix for code that uses a `Mean` as a tensor.
FIX = "write mean.map(FUNCTION), which keeps the count, or mean.value, which drops it"


class NotATensorError(PluginError, AttributeError):
    """A `Mean` was used as a tensor."""


@dataclass(frozen=True, eq=False)
class Mean:
    """A mean over labels, and their number: its weight among the means of other batches.

    A product with a number or tensor keeps the count; a sum of two means adds their counts.

    Attributes:
        value: Mean, a scalar connected to the graph.
        count: Number of labels over all ranks, a scalar; if it is 0, the value has no meaning.

    Example:
        >>> import torch
        >>> mean = Mean(torch.tensor(2.0), torch.tensor(3.0))
        >>> 1000 * mean
        Mean(value=tensor(2000.), count=tensor(3.))
        >>> (mean + mean.detach()).count
        tensor(6.)
    """

    value: Tensor
    count: Tensor

    def map(self, function: Callable[[Tensor], Tensor]) -> Mean:
        """Changes the value; the count stays.

        Args:
            function: Function from the value to another scalar, for example ``torch.sqrt``.
        """
        return Mean(function(self.value), self.count)

    def detach(self) -> Mean:
        """Cuts the value from the graph."""
        return self.map(lambda value: value.detach())

    def clone(self) -> Mean:
        """Copies the value."""
        return self.map(lambda value: value.clone())

    def float(self) -> Mean:
        """Casts the value to float32."""
        return self.map(lambda value: value.float())

    def item(self) -> builtins.float:
        """The value as a number; waits for the device."""
        return self.value.item()

    def backward(self) -> None:
        """Adds the gradients of the value to those of its leaves, such as parameters."""
        torch.autograd.backward(self.value)

    def __add__(self, other: Mean | Tensor | complex) -> Mean:
        if isinstance(other, Mean):
            return Mean(self.value + other.value, self.count + other.count)
        return self.map(lambda value: value + other)

    __radd__ = __add__

    def __neg__(self) -> Mean:
        return self.map(lambda value: -value)

    def __sub__(self, other: Mean | Tensor | complex) -> Mean:
        return self + (-other)

    def __rsub__(self, other: Tensor | complex) -> Mean:
        return -self + other

    def __mul__(self, other: Tensor | complex) -> Mean:
        return self.map(lambda value: value * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Tensor | complex) -> Mean:
        return self.map(lambda value: value / other)

    def __getattr__(self, name: str) -> Any:
        """Raises a `NotATensorError` for every other attribute, such as those of a tensor."""
        raise NotATensorError(f"what masked_mean returns is a Mean, which has no {name!r}: {FIX}")
