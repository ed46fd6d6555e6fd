"""Predicts forces and their changes."""

from __future__ import annotations

from typing import ClassVar, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import AXES, Batch, TrainingClips
from tactileforge.data.batches.force_spread import force_spread
from tactileforge.errors import ConfigError, unknown
from tactileforge.heads.force import Forces
from tactileforge.objectives.r_squared import r_squared
from tactileforge.util.distributed import masked_mean, masked_means
from tactileforge.util.means import Mean

#: Losses by name, of normalised errors; ``huber`` is linear from 1 on.
_LOSSES = {"l1": F.l1_loss, "huber": F.smooth_l1_loss, "mse": F.mse_loss}


class Force(nn.Module):
    """Errors of the force of frames 2..T and of its change from the previous frame.

    Forces are normalised by the sensor's force scale; ``scaled`` also divides the errors of each
    axis by its own standard deviation in the training data, stored in the checkpoint. An axis
    without a label in a clip is left out. Source: AnyTouch 2, section Physical-Level Dynamic
    Properties (L1, not scaled).

    Args:
        delta: Weight of the change of force.
        shear: Whether x and y are learned too, or z alone.
        loss: Loss of the errors: ``l1``, ``huber`` or ``mse``.
        scaled: Whether to divide errors by each axis's deviation, so that an axis with small forces
            has the same weight as one with large forces.

    Raises:
        ConfigError: The loss is unknown.
    """

    head: ClassVar[str] = "force"
    needs: ClassVar[frozenset[str]] = frozenset({"force"})
    deviation: Tensor

    def __init__(
        self,
        delta: float = 1.0,
        shear: bool = True,
        loss: Literal["l1", "huber", "mse"] = "l1",
        scaled: bool = False,
    ) -> None:
        super().__init__()
        if loss not in _LOSSES:
            raise ConfigError(unknown("objective.force.loss", loss, _LOSSES))
        self.delta = delta
        self.shear = shear
        self.loss = loss
        self.scaled = scaled
        #: Deviation of force and of its change along x, y and z, in units of the force scale;
        #: (2, 3).
        self.register_buffer("deviation", torch.ones(2, 3))

    def prepare(self, clips: TrainingClips) -> None:
        """Measures the deviations in one pass over the forces; see `contracts.Prepared`."""
        if self.scaled:
            self.deviation.copy_(torch.from_numpy(force_spread(clips)))
        else:  # weights of an earlier run, loaded by init=, may have set others
            self.deviation.fill_(1)

    def forward(self, prediction: Forces, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs the mean absolute error of each labelled axis, N."""
        first = 0 if self.shear else 2
        valid = batch["force_valid"][:, first:]
        scale = batch["force_scale"][:, None]
        # NaN of an axis without label would reach the gradient, although its loss is masked
        force = batch["force"].nan_to_num() / scale
        of_force = self._errors(prediction.force, force[:, 1:], self.deviation[0])
        of_delta = self._errors(prediction.delta, force.diff(dim=1), self.deviation[1])
        errors = torch.add(of_force, of_delta, alpha=self.delta).mean(1)
        loss = masked_mean(errors[:, first:], valid)
        newton = ((prediction.force.detach() - force[:, 1:]) * scale).abs().mean(1)[:, first:]
        names = [f"mae_{axis}_N" for axis in AXES[first:]]
        return loss, dict(zip(names, masked_means(newton.T, valid.T), strict=True))

    def _errors(self, predicted: Tensor, true: Tensor, deviation: Tensor) -> Tensor:
        predicted = predicted.float()
        if self.scaled:
            predicted, true = predicted / deviation, true / deviation
        return _LOSSES[self.loss](predicted, true, reduction="none")

    def sums(self, prediction: Forces, batch: Batch) -> Tensor:
        """Moments of each axis, float64 (7, 3), N; see `contracts.Scored`."""
        # sums, because R2 of a split is not the mean of R2 over its batches
        valid = batch["force_valid"][:, None].expand(prediction.force.shape)
        true = torch.where(valid, batch["force"][:, 1:], 0).double()
        scaled = prediction.force.detach() * batch["force_scale"][:, None]
        predicted = torch.where(valid, scaled, 0).double()
        error = predicted - true
        parts = (valid.double(), true, true**2, predicted, predicted**2, error**2, error.abs())
        return torch.stack([part.sum((0, 1)) for part in parts])

    def scores(self, sums: Tensor) -> dict[str, float]:
        """Mean absolute error and deviation of the predictions, N, and R2, by axis.

        An axis without labels is left out, and so is R2 of a constant force. A deviation near 0
        means that the axis has collapsed to the same prediction for every clip.
        """
        scores: dict[str, float] = {}
        for i, axis in enumerate(AXES):
            count, true, square, predicted, predicted_square, error, off = sums[:, i].tolist()
            if not count or (i < 2 and not self.shear):
                continue
            scores[f"mae_{axis}_N"] = off / count
            if (r2 := r_squared(count, true, square, error)) is not None:
                scores[f"r2_{axis}"] = r2
            spread = max(predicted_square / count - (predicted / count) ** 2, 0.0)
            scores[f"deviation_{axis}_N"] = spread**0.5
        return scores
