"""Ridge regression in closed form: one eigendecomposition gives every penalty and every fold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

#: Penalties that are tried, as shares of the mean eigenvalue of the Gram matrix.
PENALTIES = tuple(10.0 ** (power / 2) for power in range(-8, 9))
#: Standard deviation below which a feature stands still, as a share of the largest.
_STILL = 1e-6


@dataclass(frozen=True)
class DualRidge:
    """Ridge regression at all penalties at once, in its dual form; the intercept is not penalised.

    With the centred Gram matrix ``G = U diag(s) U'`` the fitted values are ``H y``, ``H = 1/n + U
    diag(s / (s + penalty)) U'``, and the residuals of a group that is left out are ``(I - H_gg)^-1
    r_g`` (Hastie, Tibshirani and Friedman, The Elements of Statistical Learning, 7.10, for groups).

    Attributes:
        values: float64 (n,), eigenvalues s.
        vectors: float64 (n, n), U.
        mean: float64 (k,), of the targets.
        truth: float64 (n, k), targets less their mean.
    """

    values: Tensor
    vectors: Tensor
    mean: Tensor
    truth: Tensor

    @property
    def penalties(self) -> list[float]:
        """Candidate penalties."""
        scale = float(self.values.mean().clamp(min=1e-12))
        return [share * scale for share in PENALTIES]

    def dual(self, penalty: float) -> Tensor:
        """Weights of the training samples, (n, k)."""
        return self.vectors @ ((self.vectors.T @ self.truth) / (self.values + penalty)[:, None])

    def left_out(self, penalties: Sequence[float], groups: Sequence[Tensor]) -> Tensor:
        """Leave-group-out predictions: each sample by a fit without its group, (penalties, n, k).

        Only the blocks of ``H`` on its diagonal are computed.

        Args:
            penalties: Penalties on the squared weights.
            groups: int64 places of the samples of each group; together all of them.
        """
        share = self.values / (self.values + self.values.new_tensor(penalties)[:, None])
        along = self.vectors.T @ self.truth
        residual = self.truth - self.vectors @ (share[..., None] * along)
        out = torch.empty_like(residual)
        for places in groups:
            own = self.vectors[places]
            # 1 / n is the hat matrix of the intercept: leaving a group out refits the mean as well
            hat = (own * share[:, None]) @ own.T + 1 / len(self.truth)
            rest = torch.eye(len(places), dtype=hat.dtype) - hat
            out[:, places] = torch.linalg.solve(rest, residual[:, places])
        return self.truth - out + self.mean


def standardise(known: Tensor, asked: Tensor) -> tuple[Tensor, Tensor]:
    """Features of mean 0 and deviation 1 on the training samples; constant features become 0.

    Args:
        known: float32 (n, d), training samples.
        asked: float32 (m, d).
    """
    mean, factor = feature_scale(known)
    return (known - mean) * factor, (asked - mean) * factor


def coordinates(gram: Tensor, cross: Tensor) -> tuple[Tensor, Tensor]:
    """Samples along the axes of the training samples' span, with the same products.

    Args:
        gram: float64 (n, n), products of the training samples.
        cross: float64 (m, n), products of new samples with these.

    Returns:
        Training samples (n, k) and new ones (m, k), k <= n.
    """
    values, vectors = torch.linalg.eigh(gram)
    # the rule of numpy.linalg.matrix_rank: smaller values are rounding
    spanned = values > len(gram) * torch.finfo(gram.dtype).eps * values[-1]
    length, vectors = values[spanned].sqrt(), vectors[:, spanned]
    return vectors * length, cross @ vectors / length


def feature_scale(known: Tensor) -> tuple[Tensor, Tensor]:
    """Mean of each feature, and its factor to deviation 1; 0 for constant features.

    Args:
        known: Float (n, d), training samples.
    """
    mean, spread = known.mean(0), known.std(0, correction=0)
    # scaling a constant feature to deviation 1 would amplify rounding errors
    still = spread <= _STILL * spread.max().clamp(min=1e-12)
    return mean, torch.where(still, 0.0, 1 / spread.clamp(min=1e-12))


def fit_ridge(gram: Tensor, truth: Tensor) -> DualRidge:
    """Decomposes the Gram matrix of centred features.

    Args:
        gram: (n, n).
        truth: (n, k).
    """
    values, vectors = torch.linalg.eigh(gram.double())
    mean = truth.double().mean(0)
    # rounding makes the smallest eigenvalues negative, which a penalty could cancel
    return DualRidge(values.clamp(min=0.0), vectors, mean, truth.double() - mean)
