"""A loaded model: uint8 frames in, vectors out."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tactileforge.contracts import Frames
from tactileforge.data.labels.displacement import displacement_mm
from tactileforge.encoders.backbone import Backbone
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub import forces
from tactileforge.hub.cards import Card
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import Images, prepare_clips
from tactileforge.hub.packed_linear import PackedLinears
from tactileforge.hub.video import Times, cut_clips, open_video

if TYPE_CHECKING:
    from tactileforge.calibration.file import Axis, Calibration
    from tactileforge.hub.classify import Classes, ClassHead

#: What to do with a sensor that the model never saw.
Policy = Literal["error", "universal"]
Tap = Literal["projected", "cls", "tokens"]


class Model:
    """An encoder in eval mode, with its preprocessing and metadata.

    It is frozen: `encode` keeps no gradients. The encoder itself can be trained like any module,
    after ``model.encoder.requires_grad_(True)``, and `encode` goes by its weights of the moment. On
    a CPU, `encode` keeps a copy of linear weights that is faster to read, made at the first call
    and again when they change; see `PackedLinears`.

    Args:
        encoder: A touch encoder; see `contracts.Encoder`.
        header: Of its file.
        card: Of the zoo, where it has one.
        device: Where it computes.
        heads: Those of its file, by name; `force` and `readings` use ``force``, `surface` its own.

    Attributes:
        encoder: The ``torch.nn.Module``.
        header: Of its file.
        card: Of the zoo, or None.
        frames: Frames of a clip, T.
        projected: Size of a vector.
        heads: Frozen; empty where the file has none.
    """

    def __init__(
        self,
        encoder: Any,
        header: Header,
        card: Card | None = None,
        device: str | torch.device = "cpu",
        heads: Mapping[str, nn.Module] | None = None,
    ) -> None:
        self.encoder = encoder.to(device).eval()
        self.header = header
        self.card = card
        self.device = torch.device(device)
        self.heads = {name: head.to(device).eval() for name, head in (heads or {}).items()}
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        self._any_sensor = _takes_any_sensor(encoder)
        self._packed = PackedLinears()

    @property
    def sensors(self) -> list[str]:
        """Sensors that it was trained on; empty where it ignores the sensor type."""
        return [] if self._any_sensor else list(self.encoder.sensors)

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip; 0 for one frame."""
        return self.header.spacing

    @property
    def recipe(self) -> dict[str, Any]:
        """The resolved recipe that trained it; empty for imported weights."""
        return self.header.recipe

    def __repr__(self) -> str:
        size = sum(p.numel() for p in self.encoder.parameters()) / 1e6
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.projected})"
        )

    def encode(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """Encodes each clip as one vector.

        Args:
            frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or
                a batch with B in front. numpy or torch.
            background: A frame without contact of the same recording, of the frames' size: one,
                or one a clip. ``"first"`` takes the first frame of each clip, ``"none"`` subtracts
                nothing. May be left out only where the model uses none.
            sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal
                tokens. May be left out where the model knows one sensor, or none.
            unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
            batch_size: Clips that are computed at once.

        Returns:
            float32 (projected,), or (B, projected) for a batch, on the model's device.

        Raises:
            DataError: Frames or background are not what the model takes; says both.
            ConfigError: No background, or no such sensor.
        """
        return self.features(
            frames,
            background,
            sensor,
            tap="projected",
            unknown_sensor=unknown_sensor,
            batch_size=batch_size,
        )

    def features(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        tap: Tap = "tokens",
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """Features of clips at one of the encoder's taps.

        Args:
            frames: See `encode`.
            background: See `encode`.
            sensor: See `encode`.
            tap: ``tokens`` (L, width), the last hidden state: prefix tokens, then patches in order
                of slot, row, column. ``cls`` (width,), the class token among them. ``projected``
                (projected,), what `encode` gives.
            unknown_sensor: See `encode`.
            batch_size: See `encode`.

        Returns:
            float32, with B in front for a batch.

        Raises:
            DataError: See `encode`.
            ConfigError: See `encode`; or the encoder has no class token.
        """
        if tap not in ("tokens", "cls", "projected"):
            raise ConfigError(unknown("tap", tap, ("tokens", "cls", "projected")))
        if tap == "cls" and self.encoder.prefix == 0:
            raise ConfigError("the model has no class token: take tap=projected or tap=tokens")
        x, still, single = self._prepare(frames, background)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        parts = zip(*(torch.split(part, batch_size) for part in (x, still, rows)), strict=True)
        with torch.no_grad():
            out = torch.cat([self._taps(tap == "tokens", *part)[tap].float() for part in parts])
        return out[0] if single else out

    def force(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        calibration: Calibration | None = None,
    ) -> Tensor:
        """The force of the object on the gel in frames 2..T of each clip.

        Warns where no unit of the sensor was calibrated for this model: units differ in gel and
        light, and the newtons are then an estimate, no measurement.

        Args:
            frames: See `encode`.
            background: See `encode`.
            sensor: See `encode`; the universal tokens do not fit forces.
            calibration: Of this unit, fitted to what this model reads (``tactileforge calibrate
                model=...``); an axis that it leaves out stays the model's estimate.

        Returns:
            float32 (T - 1, 3), or (B, T - 1, 3) for a batch, N; axes as in `contracts`.

        Raises:
            ConfigError: The file has no force head, no scale for a sensor, or the calibration is of
                another model or sensor.
            DataError: See `encode`.
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
        names = [sensor] if isinstance(sensor, str) else list(sensor or self.encoder.sensors)
        strange = forces.uncalibrated(self.header.heads["force"], names)
        if strange and calibration is None:
            warnings.warn(
                f"force: no unit of {', '.join(strange)} was calibrated for this model; its forces "
                "are an estimate, not a measurement: compare them with a force sensor before use",
                stacklevel=2,
            )
        return force

    def surface(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
    ) -> Tensor:
        """The displacement of the gel's surface in each frame of each clip, as it is estimated.

        It was learned from simulated gels; see the card for how well real ones are read.

        Args:
            frames: See `encode`.
            background: See `encode`.
            sensor: See `encode`.
            unknown_sensor: See `encode`.

        Returns:
            float32 (T, 3, 32, 32), or (B, T, 3, 32, 32) for a batch, mm along x and y of the image
            and z into the gel; the 32 rows and columns span the frame.

        Raises:
            ConfigError: The file has no surface head; see `encode`.
            DataError: See `encode`.
        """
        if "surface" not in self.heads:
            raise ConfigError(
                f"{self!r} has no surface head: pack a run whose objectives include surface "
                "(tactileforge zoo pack RUN)"
            )
        x, still, single = self._prepare(frames, background)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        with torch.no_grad():
            out = self._taps(True, x, still, rows)
            views = forces.views_of(self.encoder, out["tokens"], out["projected"])
            surface = displacement_mm(self.heads["surface"](views, {}).float())
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
        """The classes of clips, by a linear head on what `encode` gives.

        Args:
            frames: See `encode`; or one image (H, W, 3) or (3, H, W), shown as a clip that stands
                still.
            background: See `encode`.
            sensor: See `encode`.
            head: A head that the benchmark fitted to this model, ``heads/TASK.MODEL.safetensors``;
                None takes the one of a run trained with the objective ``classify``.
            names: Objects to choose from, for the head of a run, which keeps no names.
            unknown_sensor: See `encode`.

        Raises:
            ConfigError: No head, or one of another model; see `encode`.
            DataError: The file is not a head; see `encode`.
            DataNotFoundError: There is no such file.
        """
        from tactileforge.hub.classify import classify

        return classify(self, frames, background, sensor, head, names, unknown_sensor)

    def readings(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
        calibration: Calibration | None = None,
    ) -> ModelReadings:
        """Vectors and forces of clips, from one pass of the encoder.

        Args:
            frames: See `encode`.
            background: See `encode`.
            sensor: See `encode`.
            unknown_sensor: See `encode`.
            calibration: See `force`.

        Raises:
            DataError: See `encode`.
            ConfigError: See `force`.
        """
        x, still, single = self._prepare(frames, background)
        names = self._names(sensor, len(x))
        head = self.heads.get("force")
        scale = None if head is None else forces.scales(self.header.heads["force"], names)
        with torch.no_grad():
            out = self._taps(scale is not None, x, still, self._rows(names, unknown_sensor))
            vector, force = out["projected"].float(), None
            if head is not None and scale is not None:
                axes = None if calibration is None else self.axes_of(calibration, names)
                force = forces.to_newton(self._readable(out, scale), axes)
        if single:
            return ModelReadings(vector[0], None if force is None else force[0])
        return ModelReadings(vector, force)

    def force_inputs(
        self, frames: Images, background: Images | str | None, sensor: str
    ) -> dict[str, Tensor]:
        """Inputs of a force calibration, float32 (B, T - 1); see `forces.calibration_inputs`.

        Args:
            frames: See `encode`; a batch.
            background: See `encode`.
            sensor: See `encode`.

        Raises:
            ConfigError: See `force`.
            DataError: See `encode`.
        """
        x, still, _ = self._prepare(frames, background)
        names = self._names(sensor, len(x))
        scale = forces.scales(self.header.heads.get("force", {}), names)
        if "force" not in self.heads or scale is None:
            raise ConfigError(f"{self!r} has no force head, or no scale for {sensor}")
        with torch.no_grad():
            return self._readable(self._taps(True, x, still, self._rows(names, "error")), scale)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of its weights, 16 hexadecimal digits; ties a calibration to its model."""
        return forces.fingerprint([self.encoder, *(self.heads[key] for key in sorted(self.heads))])

    def _readable(self, out: Mapping[str, Tensor], scale: Tensor) -> dict[str, Tensor]:
        head, scale = self.heads["force"], scale.to(out["tokens"].device)
        return forces.calibration_inputs(head, self.encoder, out["tokens"], out["projected"], scale)

    def axes_of(self, calibration: Calibration, names: Sequence[str]) -> Mapping[str, Axis]:
        """The fits of a calibration, if it was made for this model.

        Args:
            calibration: Of one unit.
            names: Sensors that they are for.

        Raises:
            ConfigError: They are of another model or sensor.
        """
        for name in sorted(set(names)):
            calibration.check(name)
        if calibration.force is None or calibration.force.model != self.fingerprint:
            raise ConfigError(
                f"the calibration of {calibration.sensor} {calibration.unit} was not fitted to the "
                "forces of this model: make one with tactileforge calibrate model=NAME"
            )
        return calibration.force.axes

    def cut(
        self, video: str | Path | Frames, hop: float = 0.2, times: Times | None = None
    ) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Cuts a video into clips as in training, reading one at a time.

        Args:
            video: A file, or frames.
            hop: Seconds between the ends of neighbouring clips; at least one frame.
            times: float64, seconds of each frame, increasing; a file knows its own.

        Returns:
            For each clip the time of its last frame, s, and its frames, uint8 (T, H, W, 3).

        Raises:
            ConfigError: No times for frames that know none.
            DataError: The video is too short for one clip.
        """
        return cut_clips(open_video(video), self.frames, self.spacing, hop, times)

    def encode_video(
        self,
        video: str | Path | Frames,
        background: Images | str | None = None,
        sensor: str | None = None,
        *,
        hop: float = 0.2,
        times: Times | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 16,
    ) -> tuple[Times, Tensor]:
        """Vectors along a video; only ``batch_size`` clips are in memory at once.

        Args:
            video: See `cut_clips`.
            background: See `encode`, but ``"first"`` is the first frame of the video.
            sensor: See `encode`.
            hop: See `cut_clips`.
            times: See `cut_clips`.
            unknown_sensor: See `encode`.
            batch_size: Clips that are read and computed at once.

        Returns:
            float64 (n,), the time of each clip's last frame, s, and float32 (n, projected).

        Raises:
            ConfigError: See `encode` and `cut_clips`.
            DataError: See `cut_clips`; or a frame cannot be decoded.
        """
        frames = open_video(video)
        if isinstance(background, str) and background == "first":
            background = frames.read([0])[0]
        ends: list[float] = []
        vectors: list[Tensor] = []
        clips_of = self.cut(frames, hop, times)
        while batch := list(islice(clips_of, batch_size)):
            ends += [end for end, _ in batch]
            stacked = np.stack([clip for _, clip in batch])
            vectors.append(self.encode(stacked, background, sensor, unknown_sensor=unknown_sensor))
        return np.array(ends), torch.cat(vectors)

    def _prepare(
        self, frames: Images, background: Images | str | None
    ) -> tuple[Tensor, Tensor, bool]:
        """Frames and backgrounds of a batch, uint8, and whether it was given as one clip."""
        steps = getattr(self.encoder, "pixels", None)
        needed = getattr(steps, "offset", 0) is not None
        return prepare_clips(frames, background, self.frames, needed)

    def _taps(
        self, tokens: bool, frames: Tensor, background: Tensor, rows: Tensor
    ) -> dict[str, Tensor]:
        """Encoder output at each tap; ``tokens`` only if requested."""
        inputs = [part.to(self.device) for part in (frames, background, rows)]
        # an encoder with a `forward` of its own, or one put on it, is asked by that
        is_backbone = getattr(self.encoder.forward, "__func__", None) is Backbone.forward
        out: dict[str, Tensor] = {}
        with self._packed if is_backbone else nullcontext():
            if is_backbone and not tokens:
                out["cls"], out["projected"] = self.encoder.class_tokens(*inputs)
            else:
                out["tokens"], out["projected"] = self.encoder(*inputs)
                out["cls"] = out["tokens"][:, 0]
        return out

    def _names(self, sensor: str | Sequence[str] | None, count: int) -> list[str]:
        """Sensor name of each clip; "" where none is given and none is needed."""
        known: dict[str, int] = self.encoder.sensors
        if sensor is None and self._any_sensor:
            sensor = ""
        elif sensor is None:
            if len(known) > 1:
                raise ConfigError(
                    f"no sensor is named: give sensor=..., one of: {', '.join(known)}"
                )
            sensor = next(iter(known))
        names = [sensor] * count if isinstance(sensor, str) else list(sensor)
        if len(names) != count:
            raise ConfigError(f"{len(names)} sensors for {count} clips: one name, or one a clip")
        return names

    def _rows(self, names: Sequence[str], policy: Policy) -> Tensor:
        """Rows of the sensor table, int64, one for each name."""
        if policy not in ("error", "universal"):
            raise ConfigError(f"unknown_sensor={policy!r}: give error or universal")
        if self._any_sensor:
            return torch.zeros(len(names), dtype=torch.int64)
        known: dict[str, int] = self.encoder.sensors
        universal: int | None = getattr(self.encoder, "universal", None)
        if universal is not None:
            known = {"universal": universal, **known}
        strange = sorted({name for name in names if name not in known})
        if strange and (universal is None or policy == "error"):
            fix = "unknown_sensor='universal' takes the tokens that fit no sensor in particular."
            fix = "" if universal is None else fix
            raise ConfigError(unknown("sensor of the model", strange[0], known, fix))
        if strange:
            warnings.warn(
                f"the model never saw {', '.join(strange)}: it takes the universal sensor tokens, "
                "which are not meant for predicting force",
                stacklevel=4,
            )
        return torch.tensor([known.get(name, universal) for name in names])


def _takes_any_sensor(encoder: Any) -> bool:
    """Whether it ignores the sensor type."""
    if not encoder.sensors:
        return True
    if not hasattr(encoder, "sensor_ids"):
        return False
    try:
        encoder.sensor_ids([""])
    except ConfigError:
        return False
    return True
