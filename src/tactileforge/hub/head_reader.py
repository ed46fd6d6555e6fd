"""What `Model` reads by its heads: forces, surfaces, and the outputs of a head as they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from tactileforge.data.labels.displacement import displacement_mm
from tactileforge.encoders.views import ComputedViews
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub import forces
from tactileforge.hub.clips import GivenClips
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.parts import Parts
from tactileforge.sensors.borders import OTHER_LIGHT
from tactileforge.sensors.streaming.inputs import ForceUnit

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.file import Calibration


def scale_of(model: Parts, names: Sequence[str]) -> Tensor | None:
    """Force scale of each clip; None without a force head, or without the scale of a sensor."""
    head = model.force_reader
    return None if head is None else head.scale(names)


def unit_of(
    model: Parts, calibration: Calibration | str | Path | None, unit: str | None
) -> ForceUnit:
    """Unit of the forces of a model; see `Model.force_unit`."""
    is_own = forces.learned_measured(model.header.recipe)
    return forces.chosen_unit(calibration is not None, is_own, unit)


def force_of(
    model: Parts, clips: GivenClips, calibration: Calibration | str | Path | None, unit: str | None
) -> Tensor:
    """Forces of clips; see `Model.force`."""
    _need(model, "force")
    fitted = forces.opened_calibration(calibration)
    reading = readings_of(model, clips, fitted, unit, check=True)
    force = reading.force
    if force is None:
        known = model.header.heads["force"].get("scale", {})
        raise ConfigError(f"force: say which sensor it is, one of: {', '.join(known)}")
    # after the reading: if it fails, a warning about units would only be noise
    if reading.force_unit == "uncalibrated":
        forces.warn_of_estimates(stacklevel=4)
    why = f"{forces.LIGHT}, or {forces.BEYOND}"
    if fitted is not None and fitted.force is not None and fitted.force.borders:
        why += f", or {OTHER_LIGHT}"
    forces.warn_of_missing("force", force.isnan().any(-1), why, stacklevel=4)
    return force


def readings_of(
    model: Parts,
    clips: GivenClips,
    calibration: Calibration | str | Path | None,
    unit: str | None,
    check: bool,
) -> ModelReadings:
    """Vectors and forces of clips, from one pass of the encoder; see `Model.readings`."""
    known = unit_of(model, calibration, unit)
    reader, head = model.clips_reader, model.force_reader
    x, still, single = inputs = reader.prepare(clips, check)
    names = reader.names(clips, len(x))
    scale = None if head is None else head.scale(names)
    rows = reader.rows(clips, len(x))
    fitted = forces.opened_calibration(calibration)
    with reader.computing(len(x)):
        if head is None or scale is None:
            vector, force, newton = reader.vector(x, still, rows), None, None
        else:
            if fitted is not None:
                # refuses the fits of another model or sensor
                forces.fitted_axes(fitted, names, model.fingerprint)
            given = None if fitted is None else fitted.force
            compare = check and not forces.has_no_background(model.encoder, clips.background)
            vector, newton = head.read(inputs, rows, scale, given, compare)
            force = newton / scale.to(newton.device) if known == "relative" else newton
    if single:
        vector = vector[0]
        force, newton = (None if x is None else x[0] for x in (force, newton))
    return ModelReadings(vector, force, known, newton)


def force_inputs_of(model: Parts, clips: GivenClips) -> dict[str, Tensor]:
    """Inputs of a calibration; see `Model.force_inputs`."""
    reader, head = model.clips_reader, model.force_reader
    inputs = reader.prepare(clips)
    count = len(inputs.frames)
    scale = None if head is None else head.scale(reader.names(clips, count))
    if head is None or scale is None:
        raise ConfigError(f"{model!r} has no force head, or no scale for {clips.sensor}")
    compare = not forces.has_no_background(model.encoder, clips.background)
    with reader.computing(count):
        columns = head.inputs(inputs, reader.rows(clips, count), scale, compare)
    if compare:
        missing = columns["z"].isnan()
        forces.warn_of_missing("force_inputs", missing, forces.LIGHT, stacklevel=4)
    return columns


def surface_of(model: Parts, clips: GivenClips) -> Tensor:
    """Displacement of the gel's surface; see `Model.surface`."""
    _need(model, "surface")
    reader = model.clips_reader
    x, still, single = reader.prepare(clips)
    rows = reader.rows(clips, len(x))
    with reader.computing(len(x)):
        views = ComputedViews.of(model.encoder, *reader.run(x, still, rows))
        surface = displacement_mm(model.heads["surface"](views, {}).float())
    if not forces.learned_measured(model.header.recipe):
        forces.warn_of_surfaces(stacklevel=4)
    if not forces.has_no_background(model.encoder, clips.background):
        surface = forces.without_light(surface, x, still)
        missing = surface.isnan().flatten(2).any(-1)
        forces.warn_of_missing("surface", missing, forces.LIGHT, stacklevel=4)
    return surface[0] if single else surface


def read_head(model: Parts, name: str, clips: GivenClips) -> Any:
    """Output of a head as it is; see `Model.read_head`."""
    if name not in model.heads:
        raise ConfigError(unknown("head of the model", name, model.heads))
    if name == "align":
        raise ConfigError("the aligned head is read with words: model.match_words(clip, words)")
    reader = model.clips_reader
    x, still, _ = inputs = reader.prepare(clips)
    forces.warn_of_light(f"head {name}", inputs, model.encoder, clips.background, stacklevel=4)
    rows = reader.rows(clips, len(x))
    with reader.computing(len(x)):
        return model.heads[name](ComputedViews.of(model.encoder, *reader.run(x, still, rows)), {})


def _need(model: Parts, head: str) -> None:
    if head not in model.heads:
        raise ConfigError(
            f"{model!r} has no {head} head: pack a run whose objectives include {head} "
            "(tactileforge zoo pack RUN)"
        )
