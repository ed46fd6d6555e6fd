"""Heads beside an encoder: forces in newton, the surface of the gel in mm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tactileforge.data.labels.displacement import displacement_mm
from tactileforge.encoders.feature_groups import joint_vector
from tactileforge.encoders.summary import encode_summary
from tactileforge.encoders.views import ComputedViews
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub import forces
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.grouped_model import GroupedModel
from tactileforge.hub.inputs import Images
from tactileforge.hub.sensor_rows import Policy

if TYPE_CHECKING:
    from tactileforge.calibration.file import Axis, Calibration
    from tactileforge.hub.classify import Classes, ClassHead


class HeadModel(GroupedModel):
    """Reading of heads, as base of `hub.model.Model`; see there for arguments and attributes."""

    # set where weights are rounded, see `keep_fingerprint`; else computed when they are asked for
    _fingerprint = _encoder_hash = ""

    def force(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        calibration: Calibration | str | Path | None = None,
    ) -> Tensor:
        """The force of the object on the gel in frames 2..T of each clip.

        Warns without a calibration of the unit: units differ in gel and light, and the newtons are
        then an estimate, not a measurement. Warns, too, of frames without a force: the light has
        changed since the background was taken and nothing touches (`sensors.light`), or the force
        is beyond the scale of the sensor, which no force in training was.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: See `encode`; the universal tokens do not fit forces.
            calibration: Calibration of this unit, or its file, fitted to this model (``tactileforge
                calibrate model=...``); an axis that it leaves out stays the model's estimate.

        Returns:
            float32 (T - 1, 3), or (B, T - 1, 3) for a batch, N; axes as in `contracts`; NaN in the
            frames that get none. A published head gives the newest frame alone: (1, 3), (B, 1, 3).

        Raises:
            ConfigError: The file has no force head, no scale for a sensor, or the calibration is of
                another model or sensor.
            DataError: Frames or background are not what the model takes.
        """
        if "force" not in self.heads:
            raise ConfigError(
                f"{self!r} has no force head: pack a run whose objectives include force "
                "(tactileforge zoo pack RUN)"
            )
        force = self.readings(frames, background, sensor, calibration=calibration).force
        if force is None:
            known = self.header.heads["force"].get("scale", {})
            raise ConfigError(f"force: say which sensor it is, one of: {', '.join(known)}")
        # after the reading: if it fails, a warning about units would only be noise
        if calibration is None:
            forces.warn_of_estimates()
        why = f"{forces.LIGHT}, or {forces.BEYOND}"
        forces.warn_of_missing("force", force.isnan().any(-1), why)
        return force

    def surface(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
    ) -> Tensor:
        """The estimated displacement of the gel's surface in each frame of each clip.

        It was learned from simulated gels; see the card for how well real ones are read. Warns of
        frames that get none, because the light has changed since the background was taken.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Returns:
            float32 (T, 3, 32, 32), or (B, T, 3, 32, 32) for a batch, mm along x and y of the image
            and z into the gel; the 32 rows and columns span the frame. NaN in frames that get none.

        Raises:
            ConfigError: The file has no surface head; see `encode`.
            DataError: Frames or background are not what the model takes.
        """
        if "surface" not in self.heads:
            raise ConfigError(
                f"{self!r} has no surface head: pack a run whose objectives include surface "
                "(tactileforge zoo pack RUN)"
            )
        x, still, single = self._prepare(frames, background)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        with torch.no_grad():
            views = ComputedViews.of(self.encoder, *self._pass(x, still, rows))
            surface = displacement_mm(self.heads["surface"](views, {}).float())
        if not forces.has_no_background(self.encoder, background):
            surface = forces.without_light(surface, x, still)
            forces.warn_of_missing("surface", surface.isnan().flatten(2).any(-1), forces.LIGHT)
        return surface[0] if single else surface

    def classify(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        head: str | Path | ClassHead | None = None,
        names: Sequence[str] | None = None,
        unknown_sensor: Policy = "error",
    ) -> Classes:
        """Classifies clips by a linear head on their projected vectors.

        Args:
            frames: uint8 clips as in `encode`; or one image (H, W, 3) or (3, H, W), shown as a
                still clip.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            head: A head that the benchmark fitted to this model, ``heads/TASK.MODEL.safetensors``;
                None takes the one of a run trained with the objective ``classify``.
            names: Objects to choose from, for the head of a run, which keeps no names.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Raises:
            ConfigError: There is no head, or it belongs to another model or sensor, or was fitted
                with a background where none is given, or the other way round; see `encode`.
            DataError: The file is not a head; see `encode`.
            DataNotFoundError: There is no such file.
        """
        from tactileforge.hub.classify import classes_of, fitted_layer, packed_layer

        refuse_itself(frames, background)
        if head is None:
            layer = packed_layer(self.heads, names, repr(self))
        elif names is not None:
            raise ConfigError("names= is for the head of a run; head= knows the names of its own")
        else:
            named = {sensor} if isinstance(sensor, str) else set(sensor or ())
            word = background if isinstance(background, str) else ""
            subtracts = background is not None and word != "none"
            layer = fitted_layer(head, self.encoder_hash, repr(self), subtracts, named)
        # the layer first: a wrong head is found before the encoder has done its work
        vectors = self.features(
            frames, background, sensor, tap="projected", unknown_sensor=unknown_sensor
        )
        return classes_of(vectors, layer)

    def read_head(
        self,
        name: str,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
    ) -> Any:
        """Reads a head as it is: logits, or normalised forces; warns of changed light as `encode`.

        Args:
            name: A key of ``heads``.
            frames: See `encode`; a batch.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Raises:
            ConfigError: There is no such head; see `encode`.
            DataError: Frames or background are not what the model takes.
        """
        if name not in self.heads:
            raise ConfigError(unknown("head of the model", name, self.heads))
        if name == "align":
            raise ConfigError("the aligned head is read with words: model.match_words(clip, words)")
        x, still, _ = clips = self._prepare(frames, background)
        forces.warn_of_light(f"head {name}", clips, self.encoder, background)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        with torch.no_grad():
            return self.heads[name](ComputedViews.of(self.encoder, *self._pass(x, still, rows)), {})

    def readings(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
        calibration: Calibration | str | Path | None = None,
        check: bool = True,
    ) -> ModelReadings:
        """Vectors and forces of clips, from one pass of the encoder.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            calibration: Calibration of this unit, or its file, as in `force`.
            check: Whether light and colours are compared with the background; see `force`. A
                stream does so itself, in pictures as they came.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: No background, no such sensor, or a calibration of another model or sensor.
        """
        x, still, single = self._prepare(frames, background, check)
        names = self._names(sensor, len(x))
        scale = self._scale(names)
        rows = self._rows(names, unknown_sensor)
        calibration = forces.opened_calibration(calibration)
        with torch.no_grad():
            if scale is None:
                vector, force = self._scaled(self._read(self.reading, x, still, rows)), None
            else:
                tokens, projected, vector = self._pass_for_vector(x, still, rows)
                axes = None if calibration is None else self.axes_of(calibration, names)
                newton = self._readable(tokens, projected, scale)
                if axes and forces.reads_pictures(axes):
                    newton |= forces.picture_columns(x, still, newton["z"])
                force = forces.to_newton(newton, axes)
                # by the model's own newtons: a calibration scales a force, not the range of
                # training
                force = forces.within_scale(force, newton, scale)
                if check and not forces.has_no_background(self.encoder, background):
                    force = forces.without_light(force, x, still)
        if single:
            return ModelReadings(vector[0], None if force is None else force[0])
        return ModelReadings(vector, force)

    def force_inputs(
        self, frames: Images, background: Images | str | None, sensor: str
    ) -> dict[str, Tensor]:
        """Inputs of a force calibration, float32 (B, T - 1) each.

        What the force head tells, see `forces.calibration_inputs`, and the change of the pictures,
        see `calibration.pictures.picture_inputs`. NaN, with a warning, in frames with changed light
        and no touch.

        Args:
            frames: Clips, uint8, RGB, as in `encode`; a batch.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, as in `encode`.

        Raises:
            ConfigError: No background, no force head, or no scale for the sensor.
            DataError: Frames or background are not what the model takes.
        """
        x, still, _ = self._prepare(frames, background)
        names = self._names(sensor, len(x))
        scale = self._scale(names)
        if scale is None:
            raise ConfigError(f"{self!r} has no force head, or no scale for {sensor}")
        with torch.no_grad():
            inputs = self._readable(*self._pass(x, still, self._rows(names, "error")), scale)
            inputs |= forces.picture_columns(x, still, inputs["z"])
        if not forces.has_no_background(self.encoder, background):
            # stacked, so that the light of a frame is looked at once
            together = forces.without_light(torch.stack([*inputs.values()], -1), x, still)
            inputs = dict(zip(inputs, together.unbind(-1), strict=True))
            forces.warn_of_missing("force_inputs", together[..., 0].isnan(), forces.LIGHT)
        return inputs

    def _scale(self, names: Sequence[str]) -> Tensor | None:
        """Force scale of each clip; None without a force head, or without the scale of a sensor."""
        return forces.scales(self.header.heads["force"], names) if "force" in self.heads else None

    @property
    def fingerprint(self) -> str:
        """Hash of its weights, 16 hexadecimal digits; ties a calibration to its model."""
        if self._fingerprint:
            return self._fingerprint
        return forces.fingerprint([self.encoder, *(self.heads[key] for key in sorted(self.heads))])

    @property
    def encoder_hash(self) -> str:
        """The same of the encoder's weights alone; ties a head for classes to its encoder."""
        return self._encoder_hash or forces.fingerprint([self.encoder])

    def keep_fingerprint(self) -> None:
        """Keeps the hashes of the current weights: a fit for a model also fits its rounded copy."""
        self._fingerprint, self._encoder_hash = self.fingerprint, self.encoder_hash

    def _pass_for_vector(self, *clips: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Tokens, projected class tokens, and the vectors of `encode`, from one pass."""
        if self.reading == "projected":
            tokens, projected = self._pass(*clips)
            return tokens, projected, projected.float()
        inputs = [part.to(self.device) for part in clips]
        tokens, projected, summary = encode_summary(self.encoder, *inputs)
        return tokens, projected, self._scaled(summary)

    def _scaled(self, vector: Tensor) -> Tensor:
        """Vectors of the tap `reading` as `encode` gives them."""
        if self.reading == "projected":
            return vector.float()
        return joint_vector({"summary": vector.float()})

    def _readable(self, tokens: Tensor, projected: Tensor, scale: Tensor) -> dict[str, Tensor]:
        head, scale = self.heads["force"], scale.to(tokens.device)
        return forces.calibration_inputs(head, self.encoder, tokens, projected, scale)

    def axes_of(self, calibration: Calibration, names: Sequence[str]) -> Mapping[str, Axis]:
        """The fits of a calibration, if it was made for this model.

        Args:
            calibration: Calibration of one unit.
            names: Names of the sensors in the batch.

        Raises:
            ConfigError: The fits belong to another model or sensor.
        """
        return forces.fitted_axes(calibration, names, self.fingerprint)


def refuse_itself(frames: Images, background: Images | str | None) -> None:
    """Raises a ConfigError if one image would be its own background."""
    word = background if isinstance(background, str) else ""
    if word == "first" and getattr(frames, "ndim", 0) == 3:
        raise ConfigError("background='first' is the image itself: give one without contact")
