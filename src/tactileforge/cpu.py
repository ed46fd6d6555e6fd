"""Encoders that are faster on a CPU, for inference only."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError

_M = TypeVar("_M", bound=nn.Module)


class PackedLinear(nn.Module):
    """A linear layer whose weight lies as oneDNN reads it, so that it is not rearranged each time.

    Args:
        linear: Float32, on the CPU. Its weight is copied.
    """

    def __init__(self, linear: nn.Linear) -> None:
        super().__init__()
        # Packed tensors can be neither saved nor copied, so it is no buffer.
        self._weight: Any = torch.ops.mkldnn._reorder_linear_weight(linear.weight.detach())
        self._bias = None if linear.bias is None else linear.bias.detach()

    def forward(self, x: Tensor) -> Tensor:
        """(..., in) to (..., out)."""
        out: Tensor = torch.ops.mkldnn._linear_pointwise(
            x, self._weight, self._bias, "none", [], ""
        )
        return out


def for_cpu(encoder: _M) -> _M:
    """A copy of an encoder with packed linear layers: the same numbers but for rounding, sooner.

    The copy is for inference: it has no gradients, and no weights to save. What is not linear is
    shared with the encoder.

    Args:
        encoder: Float32, on the CPU.

    Raises:
        ConfigError: It is elsewhere or of another type, or torch has no oneDNN here.

    Example:
        >>> encoder = nn.Sequential(nn.Linear(8, 4), nn.ReLU())
        >>> x = torch.ones(2, 8)
        >>> bool(torch.allclose(for_cpu(encoder)(x), encoder(x), atol=1e-6))
        True
    """
    if not torch.backends.mkldnn.is_available():  # type: ignore[no-untyped-call]
        raise ConfigError("this torch has no oneDNN: use the encoder as it is")
    kinds = sorted({f"{p.dtype} on {p.device}" for p in encoder.parameters()})
    if kinds != ["torch.float32 on cpu"]:
        raise ConfigError(f"the encoder is {', '.join(kinds)}: give it as encoder.float().cpu()")
    shared = {id(x): x for x in (*encoder.parameters(), *encoder.buffers())}
    found = copy.deepcopy(encoder, shared).eval()
    for module in list(found.modules()):
        for name, child in module.named_children():
            if isinstance(child, nn.Linear):
                setattr(module, name, PackedLinear(child))
    return found
