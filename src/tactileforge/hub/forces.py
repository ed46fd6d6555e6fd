"""Forces in newton, from the force head packed with a model."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import torch
from torch import Tensor, nn

from tactileforge.contracts import AXES
from tactileforge.encoders.views import ComputedViews
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub.inputs import ClipInputs, uses_background
from tactileforge.sensors.borders import BORDER_FEATURES, border_inputs, has_other_light
from tactileforge.sensors.light import changed_light
from tactileforge.sensors.streaming.inputs import ForceUnit

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.file import Calibration, ForceAxis

#: Why a frame gets no estimate, and what helps.
LIGHT = "the light has changed since the background was taken"
BEYOND = "the force is beyond the scale of the sensor"
_KEEP_LIGHT = "Keep other light away, fix the exposure, and take the background again"


@dataclass(frozen=True)
class ModelReadings:
    """Vectors and forces of clips, from one pass of the encoder.

    Attributes:
        vector: float32 (n,), or (B, n) for a batch; what `Model.encode` gives.
        force: float32 (T - 1, 3), or (B, T - 1, 3): in frames 2..T, see `contracts`, in
            ``force_unit``. None where the model has no force head, or does not know the scale of a
            sensor.
        force_unit: What the numbers of the force are, see `Model.force`.
        newton: The force in N, for ratios of its axes; an estimate unless ``force_unit`` is ``N``.
    """

    vector: Tensor
    force: Tensor | None
    force_unit: ForceUnit
    newton: Tensor | None


def opened_calibration(given: Calibration | str | Path | None) -> Calibration | None:
    """A calibration, read from its file if given as one; see `load_calibration` for errors."""
    if isinstance(given, str | Path):
        # here: most models are used without one
        from tactileforge.sensors.calibration.file import load_calibration

        return load_calibration(given)
    return given


def fitted_axes(
    calibration: Calibration, names: Sequence[str], model: str
) -> Mapping[str, ForceAxis]:
    """The fits of a calibration, if it was made for a model; see `Model.axes_of`.

    Args:
        calibration: Calibration of one unit.
        names: Names of the sensors in the batch.
        model: Fingerprint of the model.

    Raises:
        ConfigError: The fits belong to another model or sensor.
    """
    for name in sorted(set(names)):
        calibration.check(name)
    if calibration.force is None or calibration.force.model != model:
        raise ConfigError(
            f"the calibration of {calibration.title} was not fitted to the forces of "
            "this model: make one with tactileforge calibrate model=NAME"
        )
    return calibration.force.axes


def scales(entry: Mapping[str, Any], sensors: Sequence[str]) -> Tensor | None:
    """Force scale, the newtons per unit of output, float32 (B, 1, 3); None without one.

    Args:
        entry: Header entry of a head; see `Header.heads`.
        sensors: Names of the sensors, B of them.
    """
    known = entry.get("scale", {})
    if not all(name in known for name in sensors):
        return None
    return torch.tensor([known[name] for name in sensors])[:, None]


def learned_measured(recipe: Mapping[str, Any]) -> bool:
    """Whether a model has learned the forces that were measured on a user's own recordings.

    Args:
        recipe: Configuration of its training; see `Header.recipe`.
    """
    return (recipe.get("data") or {}).get("name") == "recordings"


def chosen_unit(is_calibrated: bool, is_own: bool, asked: str | None) -> ForceUnit:
    """Unit of the forces of a model.

    Args:
        is_calibrated: Whether a calibration of the unit is given.
        is_own: Whether the model learned measured forces of it, see `learned_measured`.
        asked: Unit that the caller asked for; None for newtons where they are known, else shares.

    Raises:
        ConfigError: There is no such unit, or it does not go with what is given.
    """
    if asked is not None and asked not in get_args(ForceUnit):
        raise ConfigError(unknown("unit of force", asked, get_args(ForceUnit)))
    if is_calibrated and asked not in (None, "N"):
        raise ConfigError(
            f"force: unit={asked!r} is what the model says by itself: leave the calibration out, "
            "or the unit"
        )
    if asked == "N" and not (is_calibrated or is_own):
        raise ConfigError(
            "force: unit='N' needs the calibration= of this unit (tactileforge calibrate "
            "model=...); unit='uncalibrated' gives an estimate, and no unit shares of the scale"
        )
    if asked == "relative":
        return "relative"
    return "N" if is_calibrated or is_own else "uncalibrated" if asked else "relative"


def warn_of_estimates(stacklevel: int = 3) -> None:
    """Warns of newtons without a calibration of the unit.

    Args:
        stacklevel: See `warnings.warn`.
    """
    warnings.warn(
        "force: an estimate, not a measurement, since no calibration= of this unit was given and "
        "units differ in gel and light: fit one (tactileforge calibrate model=...), or compare "
        "with a force sensor before use",
        stacklevel=stacklevel,
    )


def warn_of_surfaces(stacklevel: int = 3) -> None:
    """Warns of estimated surfaces, learned from simulated gels; see `warnings.warn`."""
    warnings.warn(
        "surface: an estimate, not a measurement: it is learned from simulated gels, and units "
        "differ in gel and light, so depth on yours may be far off: compare with presses of known "
        "depth, or read depth by a calibration of this unit (tactileforge calibrate depth)",
        stacklevel=stacklevel,
    )


def warn_of_missing(what: str, missing: Tensor, why: str, stacklevel: int = 3) -> None:
    """Warns of frames without an estimate.

    Args:
        what: Name of the estimate.
        missing: bool (...), one per frame.
        why: Reasons why they have none.
        stacklevel: Level of the caller, as in `warnings.warn`.
    """
    if count := int(missing.sum()):
        warnings.warn(
            f"{what}: {count} of {missing.numel()} frames have none (NaN): {why}. {_KEEP_LIGHT}",
            stacklevel=stacklevel,
        )


def has_no_background(encoder: Any, background: Any) -> bool:
    """Whether frames are encoded as they are: no picture at rest to compare their light with."""
    is_none = background is None or (isinstance(background, str) and background == "none")
    return is_none or not uses_background(encoder)


def warn_of_light(
    what: str, clips: ClipInputs, encoder: Any, background: Any, stacklevel: int = 3
) -> None:
    """Warns of frames with changed light and no touch, if the encoder subtracts a background.

    Args:
        what: Name of what is read of the frames.
        clips: A batch.
        encoder: The touch encoder.
        background: Background as the caller gave it: images, a word, or None.
        stacklevel: Level of the caller, as in `warnings.warn`.
    """
    # a look at pixels on the host would break the compiled graph
    if torch.compiler.is_compiling() or has_no_background(encoder, background):
        return
    changed = changed_light(clips.frames, clips.background)
    if count := int(changed.sum()):
        warnings.warn(
            f"{what}: in {count} of {changed.size} frames {LIGHT} and nothing touches, which the "
            f"encoder may take for touch. {_KEEP_LIGHT}",
            stacklevel=stacklevel,
        )


def without_light(estimate: Tensor, clips: Tensor, backgrounds: Tensor) -> Tensor:
    """Estimates, with NaN in frames with changed light and no touch.

    Args:
        estimate: float32 (B, n, ...), of the last n frames of each clip.
        clips: uint8 (B, T, 3, H, W).
        backgrounds: uint8 (B, 3, H, W).
    """
    count = estimate.shape[1]
    changed = torch.from_numpy(changed_light(clips[:, -count:], backgrounds)).to(estimate.device)
    return estimate.masked_fill(changed.reshape(-1, count, *[1] * (estimate.ndim - 2)), math.nan)


def without_other_light(
    force: Tensor, clips: Tensor, backgrounds: Tensor, known: Sequence[Sequence[float]]
) -> Tensor:
    """Forces, with NaN in frames with another light than in the presses of a calibration.

    Args:
        force: float32 (B, n, 3), of the last n frames of each clip.
        clips: uint8 (B, T, 3, H, W).
        backgrounds: uint8 (B, 3, H, W).
        known: Range of the presses, see `borders.border_range`; empty for none.
    """
    if not known:
        return force
    columns = border_columns(clips, backgrounds, force[..., 0])
    lit = has_other_light({name: column.cpu().numpy() for name, column in columns.items()}, known)
    return force.masked_fill(torch.from_numpy(lit).to(force.device)[..., None], math.nan)


def within_scale(force: Tensor, read: Mapping[str, Tensor], scale: Tensor) -> Tensor:
    """Forces, with NaN in frames with a prediction beyond the sensor's scale along any axis.

    Args:
        force: float32 (B, n, 3), N.
        read: Outputs of the head before any calibration, see `calibration_inputs`.
        scale: Force scale, N, float32 (B, 1, 3); see `scales`.
    """
    said = torch.stack([read[name] for name in AXES], -1)
    # the head has seen no larger force in training
    beyond = (said.abs() > scale.to(said.device)).any(-1, keepdim=True)
    return force.masked_fill(beyond, math.nan)


def calibration_inputs(
    head: Any, encoder: Any, tokens: Tensor, projected: Tensor, scale: Tensor
) -> dict[str, Tensor]:
    """Inputs for fitting a calibration, float32 (B, T - 1) each.

    The forces ``x``, ``y``, ``z`` in newton, and what the last layer of the head reads
    (``hidden0``, ...) where the head tells.

    Args:
        head: The force head.
        encoder: The touch encoder.
        tokens: Float (B, L, width).
        projected: Float (B, projected).
        scale: Force scale, N, float32 (B, 1, 3); see `scales`.
    """
    views = ComputedViews.of(encoder, tokens, projected)
    newton = head(views, {}).force.float() * scale
    columns = dict(zip(AXES, newton.unbind(-1), strict=True))
    if hasattr(head, "hidden"):
        hidden = head.hidden(views).float().unbind(-1)
        columns |= {f"hidden{i}": column for i, column in enumerate(hidden)}
    return columns


def picture_columns(clips: Tensor, backgrounds: Tensor, like: Tensor) -> dict[str, Tensor]:
    """Inputs for fitting a calibration from the pictures alone, float32 (B, n) each.

    Args:
        clips: uint8 (B, T, 3, H, W).
        backgrounds: uint8 (B, 3, H, W).
        like: Force along one axis in the last n frames of each clip, (B, n), for shape and device.
    """
    from tactileforge.sensors.calibration.picture_features import picture_inputs

    count = like.shape[1]
    frames = clips[:, -count:].flatten(0, 1)
    columns = picture_inputs(frames, backgrounds.repeat_interleave(count, 0))
    return {name: column.view(-1, count).to(like.device) for name, column in columns.items()}


def border_columns(clips: Tensor, backgrounds: Tensor, like: Tensor) -> dict[str, Tensor]:
    """Changes at the borders, float32 (B, n) each; arguments as of `picture_columns`."""
    frames = clips[:, -like.shape[1] :].movedim(-3, -1).cpu().numpy()
    stills = backgrounds.movedim(-3, -1).cpu().numpy()
    rows = [border_inputs(*both) for both in zip(frames, stills, strict=True)]
    return {
        name: torch.from_numpy(np.stack([row[name] for row in rows])).to(like.device)
        for name in BORDER_FEATURES
    }


def reads_pictures(axes: Mapping[str, ForceAxis]) -> bool:
    """Whether some axis is fitted to inputs from pictures, see `picture_columns`."""
    from tactileforge.sensors.calibration.picture_features import PICTURE_FEATURES

    return any(name in PICTURE_FEATURES for axis in axes.values() for name in axis.weights)


def fingerprint(parts: Iterable[nn.Module]) -> str:
    """Hash of the weights of some modules, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        for key, value in part.state_dict().items():
            digest.update(key.encode())
            digest.update(value.detach().float().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def to_newton(
    readings: Mapping[str, Tensor], axes: Mapping[str, ForceAxis] | None = None
) -> Tensor:
    """Forces (B, T - 1, 3), N; an axis without a calibration keeps the head's output.

    Args:
        readings: Inputs of a calibration, by name, float32 (B, T - 1); see `calibration_inputs`.
        axes: Fits of a unit, by axis.
    """
    columns = []
    for name in AXES:
        column = readings[name]
        if axes and name in axes:
            terms = (weight * readings[source] for source, weight in axes[name].weights.items())
            column = sum(terms, torch.full_like(column, axes[name].offset))
        columns.append(column)
    return torch.stack(columns, -1)
