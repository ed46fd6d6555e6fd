"""Reading of a packed force head: newtons of clips, and the inputs of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tactileforge.hub import forces
from tactileforge.hub.clip_encoder import ClipEncoder
from tactileforge.hub.inputs import ClipInputs

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.file import ForceModel


class PackedForce:
    """Forces of clips by a force head beside an encoder.

    Args:
        clips: The encoder with its preprocessing.
        head: The force head.
        entry: Header entry of the head; see `Header.heads`.
    """

    def __init__(self, clips: ClipEncoder, head: Any, entry: Mapping[str, Any]) -> None:
        self.clips, self.head, self.entry = clips, head, entry

    def scale(self, names: Sequence[str]) -> Tensor | None:
        """Newtons per unit of output, float32 (B, 1, 3); None without the scale of a sensor."""
        return forces.scales(self.entry, names)

    def read(
        self,
        clips: ClipInputs,
        rows: Tensor,
        scale: Tensor,
        fitted: ForceModel | None,
        compare_light: bool,
    ) -> tuple[Tensor, Tensor]:
        """Vectors and forces of clips, from one pass of the encoder.

        Args:
            clips: A batch.
            rows: Rows of the sensor table, int64 (B,).
            scale: Newtons per unit of output, float32 (B, 1, 3).
            fitted: The force of a calibration; None without one.
            compare_light: Whether frames with changed light and no touch, or with another light
                than in the presses of the calibration, get no force.

        Returns:
            float32 (B, n), as of `Model.encode`, and float32 (B, T - 1, 3), N.
        """
        x, still, _ = clips
        tokens, projected, vector = self.clips.run_for_vector(x, still, rows)
        columns = self._columns(tokens, projected, scale)
        axes = None if fitted is None else fitted.axes
        if axes and forces.reads_pictures(axes):
            columns |= forces.picture_columns(x, still, columns["z"])
        force = forces.to_newton(columns, axes)
        # by the model's own newtons: a calibration scales a force, not the range of training
        force = forces.within_scale(force, columns, scale)
        if compare_light:
            force = forces.without_light(force, x, still)
            if fitted is not None:
                force = forces.without_other_light(force, x, still, fitted.borders)
        return vector, force

    def inputs(
        self, clips: ClipInputs, rows: Tensor, scale: Tensor, compare_light: bool
    ) -> dict[str, Tensor]:
        """Inputs of a calibration, float32 (B, T - 1) each; arguments as in `read`."""
        x, still, _ = clips
        columns = self._columns(*self.clips.run(x, still, rows), scale)
        columns |= forces.picture_columns(x, still, columns["z"])
        columns |= forces.border_columns(x, still, columns["z"])
        if compare_light:
            # stacked, so that the light of a frame is looked at once
            together = forces.without_light(torch.stack([*columns.values()], -1), x, still)
            columns = dict(zip(columns, together.unbind(-1), strict=True))
        return columns

    def _columns(self, tokens: Tensor, projected: Tensor, scale: Tensor) -> dict[str, Tensor]:
        scale = scale.to(tokens.device)
        return forces.calibration_inputs(self.head, self.clips.encoder, tokens, projected, scale)
