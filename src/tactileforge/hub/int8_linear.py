"""Linear layers with weights of eight bits, for inference on a CPU."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class Int8Linear(nn.Module):
    """A linear layer with int8 weights, one scale an output, and inputs quantised row by row.

    Weights and inputs become whole numbers from -127 to 127, their products are summed exactly, and
    the sums are scaled back. No gradient passes.

    Args:
        linear: The layer to replace.
    """

    weight: Tensor
    scale: Tensor
    bias: Tensor | None

    def __init__(self, linear: nn.Linear) -> None:
        super().__init__()
        self.in_features, self.out_features = linear.in_features, linear.out_features
        weight, scale = _whole(linear.weight.detach().float())
        self.register_buffer("weight", weight)
        self.register_buffer("scale", scale.squeeze(1))
        self.register_buffer("bias", None if linear.bias is None else linear.bias.detach().float())

    def forward(self, x: Tensor) -> Tensor:
        """Float (..., in) to float (..., out)."""
        whole, scale = _whole(x.detach().flatten(0, -2).float())
        # private: torch has no other product of int8 with exact sums; can go when it has one
        out = torch._int_mm(whole, self.weight.t()).float() * scale * self.scale
        out = out if self.bias is None else out + self.bias
        return out.view(*x.shape[:-1], self.out_features).to(x.dtype)


def _whole(x: Tensor) -> tuple[Tensor, Tensor]:
    """Rows (n, m) as int8, and the scale of each, (n, 1)."""
    # 127, not 128: the same range on both sides of 0; the least for rows of zeros
    scale = x.abs().amax(1, keepdim=True).clamp(min=1e-12) / 127
    return (x / scale).round().to(torch.int8), scale


def quantise_linears(module: nn.Module) -> None:
    """Replaces each linear layer of a module by one with int8 weights, in place."""
    for name, child in module.named_children():
        if isinstance(child, nn.Linear):
            setattr(module, name, Int8Linear(child))
        else:
            quantise_linears(child)
