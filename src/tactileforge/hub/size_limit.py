"""Bound on the numbers that a model may make while it is built from a file's header."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor
from torch.overrides import TorchFunctionMode

from tactileforge.errors import DataError

#: Functions whose result has the size that is given to them.
_SIZED = frozenset({"empty", "zeros", "ones", "full", "rand", "randn", "randint", "eye"})
_SIZED |= {f"new_{name}" for name in ("empty", "zeros", "ones", "full")}
#: Functions whose result may be as large as the product of their inputs.
_PRODUCTS = frozenset({"outer", "ger", "einsum", "kron", "meshgrid", "cartesian_prod", "repeat"})
#: Numbers beside those of the file: positions and the like, which are computed.
_COMPUTED = 1 << 24


class Allowance(TorchFunctionMode):
    """Raises a DataError before more numbers are made than the file of a model can hold.

    A model on the meta device would tell its size as well, but torch finds shapes there by its
    Python decompositions, whose import (dynamo, sympy) takes five seconds.

    Args:
        path: The file.

    Attributes:
        made: Numbers of all tensors that were asked for by their sizes.
        refused: Numbers of the last of them, if it was refused.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path, self.bytes = path, path.stat().st_size
        self.made = self.refused = 0

    def __torch_function__(
        self,
        func: Any,
        types: Any,
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Calls a function of torch, unless its result would be too large."""
        options = dict(kwargs or {})
        name = getattr(func, "__name__", "")
        if name in _SIZED:
            count = _product([*args, *options.get("size", ())])
            self.made, self.refused = self.made + count, count
            # a byte a number, at least
            self._check(self.made, self.bytes)
            self.refused = 0
        elif name == "arange":
            self._check(max((int(abs(x)) for x in _numbers(args)), default=0), _COMPUTED)
        else:
            self._check(_result(name, args), self.bytes)
        return func(*args, **options)

    def _check(self, count: int, most: int) -> None:
        if count > most + _COMPUTED:
            raise DataError(
                f"{self.path}: the model it describes has {count:,} numbers, and the file "
                f"{self.bytes:,} bytes; fetch it again"
            )


def _result(name: str, args: Sequence[Any]) -> int:
    """Most numbers that a function may make of its inputs."""
    given = list(_tensors(args))
    if name in _PRODUCTS:
        whole = [int(x) for x in _numbers(args)] if name == "repeat" else []
        return math.prod(x.numel() for x in given) * math.prod(whole)
    try:
        return math.prod(np.broadcast_shapes(*(tuple(x.shape) for x in given)))
    except ValueError:  # not an elementwise function
        return max((x.numel() for x in given), default=0)


def _product(sizes: Sequence[Any]) -> int:
    return math.prod(int(x) for x in _numbers(sizes))


def _numbers(values: Any) -> Iterator[float]:
    for value in values:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield value
        elif isinstance(value, list | tuple):
            yield from _numbers(value)


def _tensors(values: Any) -> Iterator[Tensor]:
    for value in values:
        if isinstance(value, Tensor):
            yield value
        elif isinstance(value, list | tuple):
            yield from _tensors(value)
