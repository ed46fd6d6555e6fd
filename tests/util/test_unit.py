"""Vectors of length 1, as torch makes them."""

import torch
from torch.nn import functional as F

from tactileforge.util.unit import unit


def test_values_and_gradients_are_those_of_torch() -> None:
    torch.manual_seed(0)
    x = torch.randn(2, 3, 5, dtype=torch.float64)
    x[0, 0] = 0
    ours, theirs = (x.clone().requires_grad_() for _ in range(2))
    weight = torch.randn(2, 3, 5, dtype=torch.float64)
    torch.autograd.backward((unit(ours) * weight).sum())
    torch.autograd.backward((F.normalize(theirs, dim=-1) * weight).sum())
    torch.testing.assert_close(unit(ours), F.normalize(theirs, dim=-1))
    torch.testing.assert_close(ours.grad, theirs.grad)
    assert (unit(ours)[0, 0] == 0).all()


def test_half_precision_keeps_its_gradient() -> None:
    x = torch.randn(4, 8, dtype=torch.bfloat16, requires_grad=True)
    torch.autograd.backward(unit(x).float().sum())
    assert x.grad is not None
    assert x.grad.dtype == torch.bfloat16
