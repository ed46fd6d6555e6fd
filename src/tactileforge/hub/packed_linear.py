"""Faster linear layers on a CPU, for inference only."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torch.overrides import TorchFunctionMode

#: Numbers of a weight that are compared before its packed copy is used.
_PROBES = 64


class _Packed(NamedTuple):
    """A copy of a weight in oneDNN's layout, with a check of whether it is up to date."""

    source: nn.Parameter
    version: int
    address: int
    probes: Tensor
    weight: Any

    def holds(self, weight: nn.Parameter) -> bool:
        """Whether the weight still equals its copy."""
        return (
            self.source is weight
            and self.version == weight._version
            and self.address == weight.data_ptr()
            and torch.equal(self.probes, _probes(weight))
        )


class PackedLinears(TorchFunctionMode):
    """Context with oneDNN's packed layout for the weights of linear layers on the CPU.

    Torch rearranges a weight each time it is used; here it is done once, and the copy is kept for
    the next time. The numbers are the same but for rounding. Nothing about the modules changes, and
    a weight that has changed is packed again: an optimiser, ``load_state_dict`` and any other
    operation on it is noticed by its version, and what goes around that (``weight.data``) by its
    address and by some numbers spread over it.

    Only float32 parameters on the CPU, where no gradients are kept, are packed; everything else,
    and everything where this torch has no oneDNN or has it switched off
    (``torch.backends.mkldnn.enabled = False``), is computed as ever. Copies cost the memory of the
    weights once more. They are neither pickled nor copied: a copy of this object starts empty.

    Example:
        >>> layer = nn.Linear(8, 4).requires_grad_(False)
        >>> x = torch.ones(2, 8)
        >>> with torch.no_grad(), PackedLinears():
        ...     packed = layer(x)
        >>> bool(torch.allclose(packed, layer(x), atol=1e-6))
        True
    """

    def __init__(self) -> None:
        super().__init__()
        self._packed: dict[int, _Packed] = {}

    def __reduce__(self) -> tuple[type[PackedLinears], tuple[()]]:
        return PackedLinears, ()

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Intercepts torch functions; computes eligible linear layers with a packed weight."""
        if func is F.linear and not kwargs and len(args) == 3 and _suits(args[0], args[1]):
            x, weight, bias = args
            return torch.ops.mkldnn._linear_pointwise(x, self._of(weight), bias, "none", [], "")
        return func(*args, **(kwargs or {}))

    def _of(self, weight: nn.Parameter) -> Any:
        packed = self._packed.get(id(weight))
        if packed is None or not packed.holds(weight):
            packed = _Packed(
                weight,
                weight._version,
                weight.data_ptr(),
                _probes(weight).clone(),
                torch.ops.mkldnn._reorder_linear_weight(weight.detach()),
            )
            self._packed[id(weight)] = packed
        return packed.weight


def _suits(x: Any, weight: Any) -> bool:
    """Whether a linear layer can be computed with a packed weight."""
    return (
        isinstance(weight, nn.Parameter)
        and weight.ndim == 2
        and weight.is_contiguous()
        and x.dtype == weight.dtype == torch.float32
        and x.device.type == weight.device.type == "cpu"
        and 0 not in (x.numel(), weight.numel())
        and not weight.is_inference()  # has no version
        and not torch.is_grad_enabled()
        and not torch.is_autocast_enabled("cpu")
        and bool(torch.backends.mkldnn.enabled)
        and can_pack()
    )


@cache
def can_pack() -> bool:
    """Whether torch's private operators still behave as this module expects."""
    try:
        packed = torch.ops.mkldnn._reorder_linear_weight(torch.full((2, 3), 2.0))
        product: Tensor = torch.ops.mkldnn._linear_pointwise(
            torch.ones(1, 3), packed, torch.ones(2), "none", [], ""
        )
    except (AttributeError, RuntimeError, TypeError):
        return False
    return torch.equal(product, torch.full((1, 2), 7.0))


def _probes(weight: Tensor) -> Tensor:
    """Samples of a weight, from its first to its last row."""
    flat = weight.detach().view(-1)
    return flat[:: max(1, len(flat) // _PROBES - 1)]
