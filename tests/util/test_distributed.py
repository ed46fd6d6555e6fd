"""Means over the labelled, of one table and of each of its rows."""

import pytest
import torch

from tactileforge.util.distributed import masked_mean, masked_means


def test_means_of_rows_are_those_of_each() -> None:
    losses = torch.tensor([[[1.0, 5.0], [float("nan"), 3.0]], [[2.0, float("inf")], [4.0, 6.0]]])
    valid = torch.tensor([[[True, True], [False, True]], [[True, False], [False, True]]])
    losses.requires_grad_()
    means = masked_means(losses, valid)
    assert [(mean.item(), mean.count.item()) for mean in means] == [(3.0, 3.0), (4.0, 2.0)]
    for row, mark, mean in zip(losses, valid, means, strict=True):
        assert masked_mean(row, mark).item() == mean.item()
    sum(mean.value for mean in means).backward()  # type: ignore[union-attr]
    assert losses.grad is not None
    expected = [[[1 / 3, 1 / 3], [0.0, 1 / 3]], [[0.5, 0.0], [0.0, 0.5]]]
    assert losses.grad.tolist() == [[pytest.approx(x) for x in row] for row in expected]


def test_without_a_label_a_mean_is_0_and_in_the_graph() -> None:
    losses = torch.full((2, 3), float("nan"), requires_grad=True)
    one, two = masked_means(losses, torch.zeros(2, 3, dtype=torch.bool))
    assert one.item() == two.item() == one.count.item() == 0
    (one + two).backward()
    assert losses.grad is not None
    assert (losses.grad == 0).all()
