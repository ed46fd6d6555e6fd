import torch
from tactileforge_example.optimizer import orthogonal, stable_decay

from tactileforge.testing import check


def test_conformance():
    results = check("optimizer", "muon")
    assert not [result for result in results if result.status == "failed"], results


def test_singular_values_are_near_1_and_vectors_stay():
    torch.manual_seed(0)
    matrix = torch.randn(24, 16, dtype=torch.float64)
    left, _, right = torch.linalg.svd(matrix, full_matrices=False)
    made = orthogonal(matrix)
    inner = left.T @ made @ right.T
    assert torch.allclose(inner, torch.diag(inner.diagonal()), atol=1e-8)
    assert 0.5 < inner.diagonal().min() <= inner.diagonal().max() < 1.3


def test_the_rate_is_full_until_the_last_fifth():
    rates = [stable_decay(step, warm=10, total=100) for step in (0, 9, 50, 80, 90, 100)]
    assert rates == [0.1, 1.0, 1.0, 1.0, 0.5, 0.0]
