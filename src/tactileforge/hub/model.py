"""A loaded model: uint8 frames in, vectors and forces out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tactileforge.contracts import Frames
from tactileforge.data.labels.displacement import displacement_mm
from tactileforge.encoders.feature_groups import group_sizes, joint_vector
from tactileforge.encoders.views import ComputedViews
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub import forces
from tactileforge.hub.cards import Card
from tactileforge.hub.clip_encoder import ClipEncoder, check_batch_size, check_device
from tactileforge.hub.force_reader import ForceReader
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import Images, squash_images
from tactileforge.hub.sensor_rows import Policy
from tactileforge.hub.taps import Tap, check_tap
from tactileforge.hub.video import Times, cut_clips, open_video
from tactileforge.sensors.background import Background
from tactileforge.sensors.streaming.contact import ContactOptions, SlipOptions
from tactileforge.sensors.streaming.touch_stream import TouchStream

if TYPE_CHECKING:
    from tactileforge.hub.classify import Classes, ClassHead
    from tactileforge.hub.words import TextEncoder, WordMatches
    from tactileforge.sensors.calibration.file import Calibration, ForceAxis


class Model(nn.Module):
    """An encoder in eval mode, with its preprocessing, heads and metadata: a ``torch.nn.Module``.

    As `load` gives it, it is frozen. `encode` and the other methods keep no gradients; calling the
    model does, so it can be trained as part of another module, after
    ``model.requires_grad_(True)``. ``.to()``, ``.half()`` and ``.bfloat16()`` change its weights;
    frames are prepared in float32 whatever these are, and what comes out is float32.

    Args:
        encoder: A touch encoder; see `contracts.Encoder`.
        header: Header of its file.
        card: Card of the zoo; None without one.
        device: Device of the computation, e.g. ``cpu``.
        heads: Heads of its file, by name; `force` and `readings` use ``force``, `surface` its own.

    Attributes:
        encoder: The ``torch.nn.Module``.
        header: Header of its file.
        card: Card of the zoo, or None.
        frames: Frames of a clip, T.
        projected: Size of a projected token; `encode` gives vectors of ``vector_size``.
        heads: ``torch.nn.ModuleDict``; empty where the file has none.

    Raises:
        ConfigError: There is no such device.
    """

    # set where weights are rounded, see `keep_fingerprint`; else computed when they are asked for
    _fingerprint = _encoder_hash = ""

    def __init__(
        self,
        encoder: Any,
        header: Header,
        card: Card | None = None,
        device: str | torch.device = "cpu",
        heads: Mapping[str, nn.Module] | None = None,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.header = header
        self.card = card
        self.heads = nn.ModuleDict(dict(heads or {}))
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        # checked first: a move that fails would leave a part of the weights behind
        self.to(check_device(device)).eval()

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        return self._clips.device

    @property
    def sensors(self) -> list[str]:
        """Sensors in its training; with ``any_sensor`` it takes others, too."""
        return list(self.encoder.sensors)

    @property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type: every sensor is encoded alike, named or not."""
        return self._clips.any_sensor

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip; 0 for one frame."""
        return self.header.spacing

    @property
    def recipe(self) -> dict[str, Any]:
        """The resolved recipe of its training; empty for imported weights."""
        return self.header.recipe

    @property
    def squashed(self) -> tuple[int, int] | None:
        """Height and width of squashed frames in its training, before any resizing by the encoder.

        None for imported weights: their encoder was trained on frames of any size.
        """
        return self._clips.squashed

    @property
    def reading(self) -> Literal["summary", "projected"]:
        """Vector of `encode` without groups: ``summary``; ``projected`` of imported weights.

        A linear probe on the summary of a model trained here reads more than on its projected class
        token (on real touches .736 against .681, and .510 against .425 held out; see
        docs/reports/gate.md). Imported weights give the vector that their authors use.
        """
        return self._clips.reading

    @property
    def vector_size(self) -> int:
        """Length of a vector of `encode`."""
        return self._clips.vector_size

    @property
    def group_sizes(self) -> dict[str, int]:
        """Size of each group of `groups`, by name, in their order."""
        return group_sizes(self.encoder)

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

    def __repr__(self) -> str:
        size = sum(x.numel() for x in self.encoder.state_dict().values()) / 1e6  # int8 is a buffer
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.vector_size})"
        )

    def encode(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        groups: Sequence[str] | Literal["all"] | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """Encodes each clip as one vector; warns of changed light without touch.

        Args:
            frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or
                a batch with B in front. numpy or torch. One image, (H, W, 3), (3, H, W) or a batch
                with one frame a clip, is shown in all T places, as the authors do.
            background: A frame without contact of the same recording, of the frames' size: one,
                or one a clip. ``"first"`` takes the first frame of each clip, ``"none"`` subtracts
                nothing. May be left out only where the model uses none.
            sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal
                tokens. May be left out where the model knows one sensor, or none.
            groups: Names of groups, or ``all``, that are put side by side, each times a fixed
                factor with which a plain linear probe does well: see `groups` and
                `feature_groups.joint_vector`. None takes ``summary``, the best single vector for a
                linear probe; of imported weights the projected vector of their authors.
            unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
            batch_size: Clips that are computed at once.

        Returns:
            float32 (n,), or (B, n) for a batch, on the model's device: n is ``vector_size``, or
            what `group_sizes` tells for the groups together.

        Raises:
            DataError: Frames or background are not what the model takes; says both.
            ConfigError: No background, no such sensor or group, or a batch size below 1.
        """
        clips = frames, background, sensor, unknown_sensor, batch_size
        if groups is None and self.reading == "projected":
            return self._clips.tapped("projected", *clips)
        groups = ["summary"] if groups is None else groups
        return joint_vector(self._clips.grouped(None if groups == "all" else groups, *clips))

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
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            tap: ``tokens`` (L, width), as the encoder's authors use them: prefix tokens, then
                patches in order of slot, row, column. ``cls`` (width,), the class token among them.
                ``patches`` (slots, rows, columns, width), the others by their places. ``projected``
                (projected,), the vector compared with words, by heads of classes and by the
                authors' probes. ``hidden`` and ``normed`` (L, width), the last hidden state before
                and after the last norm; ``projected_tokens`` (L, projected), ``normed`` through the
                projection. ``global`` (projected,), the mean of all patches,
                projected without the norm (AnyTouch 1). ``summary`` (n,), means in the quarters of
                the image and deviations of the patches of up to four blocks; `encode` gives it,
                scaled, of a model trained here. See `encode_summary`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            batch_size: Clips that are computed at once.

        Returns:
            float32, with B in front for a batch.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: See `encode`; or the encoder has no class token, or no last norm.
        """
        return self._clips.tapped(tap, frames, background, sensor, unknown_sensor, batch_size)

    def groups(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        names: Sequence[str] | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> dict[str, Tensor]:
        """Features of clips in groups, each computed once from the uint8 frames.

        They differ in content and in size. A probe does best if it weighs the groups, as the
        probes ``ridge`` and ``logistic`` of ``tactileforge bench`` do.

        - ``summary``: of the encoder, as `features` gives it with ``tap="summary"``. No unit.
        - ``photographs``, (2360,), where the encoder has a network of photographs
          (``anytouch2.tiny-real``): the network's own maps, as means of the quarters of the image
          and deviations over it. No unit.
        - ``difference``, (384,): grey levels, un-normalised. Means over 8 x 8 cells of the last
          frame less the background, (3, 8, 8), then of the last frame less the first, (3, 8, 8).
          With ``background="none"`` the first half is the picture itself, less a grey.
        - ``statistics``, (69,): of the last frame less its background at 128 x 128: moments,
          slopes and quantiles in shares of the range of grey levels, logarithms of the power in
          rings of the spectrum, and correlations of the channels.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            names: Names of groups; None takes all. A group that is not named costs nothing: without
                ``summary`` no transformer runs, without ``photographs`` beside it no network.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            batch_size: Clips that are computed at once.

        Returns:
            By name, float32 (n,), or (B, n) for a batch, on the model's device; sizes as in
            `group_sizes`.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: See `encode`; or the model has no such group.

        Example:
            >>> import numpy as np
            >>> from tactileforge import load
            >>> rest = np.full((240, 320, 3), 110, np.uint8)
            >>> model = load("anytouch2.tiny")
            >>> groups = model.groups(np.stack([rest] * 4), rest, "digit", names=["difference"])
            >>> groups["difference"].view(2, 3, 8, 8)[0].mean((1, 2)).tolist()  # red, green, blue
            [0.0, 0.0, 0.0]
        """
        return self._clips.grouped(names, frames, background, sensor, unknown_sensor, batch_size)

    def forward(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        tap: Tap = "projected",
        unknown_sensor: Policy = "error",
    ) -> Tensor:
        """Encodes all clips at once, with gradients if they are enabled: ``model(clips, ...)``.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            tap: Name of a tap, as in `features`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Returns:
            Features of the tap, float32; shapes as in `features`.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: No background, no such sensor, or no such tap of this encoder.
        """
        check_tap(self.encoder, tap)
        reader = self._clips
        x, still, single = reader.prepare(frames, background)
        rows = reader.rows(reader.names(sensor, len(x)), unknown_sensor)
        out = reader.read(tap, x, still, rows).float()
        return out[0] if single else out

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
            sensor: Name of the sensor, as in `encode`; the universal tokens do not fit forces.
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
        reader = self._clips
        x, still, single = reader.prepare(frames, background)
        rows = reader.rows(reader.names(sensor, len(x)), unknown_sensor)
        with torch.no_grad():
            views = ComputedViews.of(self.encoder, *reader.run(x, still, rows))
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

    def match_words(
        self,
        frames: Images,
        words: Sequence[str],
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        template: str | None = None,
        temperature: float | None = None,
        text_encoder: TextEncoder | None = None,
        unknown_sensor: Policy = "error",
    ) -> WordMatches:
        """Words for clips, by cosine similarity in the space shared by touch and language.

        Runs trained with the objective ``align`` on captions, AnyTouch 1 and 2, TVL, UniTouch and
        CLIP have such a space. Source: CLIP (arXiv 2103.00020), section 3.1.2.

        Args:
            frames: uint8 clips as in `encode`; or one image (H, W, 3) or (3, H, W), shown as a
                still clip.
            words: Words or phrases to choose from, each once.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            template: Sentence of a word, with ``{}`` for the word; None takes the one on the card,
                or the word alone.
            temperature: Temperature of the softmax over the words; None takes that of training,
                or 0.07 where the file keeps none.
            text_encoder: Text tower, or the name on the model hub or the folder of the CLIP that
                has it; None takes the one in the file, or on the card.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Returns:
            Probabilities and cosines, float32 (words,), or (B, words) for a batch, and ``name``,
            the best word of each clip.

        Raises:
            ConfigError: The model is not aligned with language, or the tower does not fit it; or no
                words, or a template without ``{}``; see `encode`.
            PluginError: The text tower cannot be loaded; says what to install.
            DataError: Frames or background are not what the model takes.

        Example:
            >>> model = tactileforge.load("tvl.vitb")  # doctest: +SKIP
            >>> model.match_words(clip, ["wood", "metal"], sensor="digit").name  # doctest: +SKIP
            'wood'
        """
        from tactileforge.hub.words import language_of, match_vectors

        refuse_itself(frames, background)
        side = language_of(self.header, dict(self.heads), repr(self), self.projected)
        # the words first: a missing tower is found before the encoder has done its work
        text = side.vectors(words, template, text_encoder, self.device)
        touch = self.features(
            frames, background, sensor, tap="projected", unknown_sensor=unknown_sensor
        )
        kept = side.temperature if temperature is None else temperature
        return match_vectors(touch, text, words, kept)

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
            frames: Clips, uint8, RGB, as in `encode`; a batch.
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
        reader = self._clips
        x, still, _ = clips = reader.prepare(frames, background)
        forces.warn_of_light(f"head {name}", clips, self.encoder, background)
        rows = reader.rows(reader.names(sensor, len(x)), unknown_sensor)
        with torch.no_grad():
            return self.heads[name](ComputedViews.of(self.encoder, *reader.run(x, still, rows)), {})

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
        reader, head = self._clips, self._force
        x, still, single = clips = reader.prepare(frames, background, check)
        names = reader.names(sensor, len(x))
        scale = None if head is None else head.scale(names)
        rows = reader.rows(names, unknown_sensor)
        calibration = forces.opened_calibration(calibration)
        with torch.no_grad():
            if head is None or scale is None:
                vector, force = reader.vector(x, still, rows), None
            else:
                axes = None if calibration is None else self.axes_of(calibration, names)
                compare = check and not forces.has_no_background(self.encoder, background)
                vector, force = head.read(clips, rows, scale, axes, compare)
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
        reader, head = self._clips, self._force
        clips = reader.prepare(frames, background)
        names = reader.names(sensor, len(clips.frames))
        scale = None if head is None else head.scale(names)
        if head is None or scale is None:
            raise ConfigError(f"{self!r} has no force head, or no scale for {sensor}")
        rows = reader.rows(names, "error")
        compare = not forces.has_no_background(self.encoder, background)
        with torch.no_grad():
            inputs = head.inputs(clips, rows, scale, compare)
        if compare:
            forces.warn_of_missing("force_inputs", inputs["z"].isnan(), forces.LIGHT)
        return inputs

    def axes_of(self, calibration: Calibration, names: Sequence[str]) -> Mapping[str, ForceAxis]:
        """The fits of a calibration, if it was made for this model.

        Args:
            calibration: Calibration of one unit.
            names: Names of the sensors in the batch.

        Raises:
            ConfigError: The fits belong to another model or sensor.
        """
        return forces.fitted_axes(calibration, names, self.fingerprint)

    def cut(
        self,
        video: str | Path | Frames | NDArray[np.uint8],
        hop: float = 0.2,
        times: Times | None = None,
    ) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Cuts a video into clips as in training, reading one at a time.

        Args:
            video: A file, frames, or an array of them, uint8 (T, H, W, 3), RGB.
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
        video: str | Path | Frames | NDArray[np.uint8],
        background: Images | str | None = None,
        sensor: str | None = None,
        *,
        hop: float = 0.2,
        times: Times | None = None,
        groups: Sequence[str] | Literal["all"] | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 16,
    ) -> tuple[Times, Tensor]:
        """Vectors along a video; only ``batch_size`` clips are in memory at once.

        Args:
            video: A file, frames, or an array of them, uint8 (T, H, W, 3), RGB.
            background: Frame without contact, as in `encode`; ``"first"`` is that of the video.
            sensor: Name of the sensor, as in `encode`.
            hop: Seconds between the ends of neighbouring clips; at least one frame.
            times: float64, seconds of each frame, increasing; a file knows its own.
            groups: Names of groups, ``all``, or None for the usual vector, as in `encode`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            batch_size: Clips that are read and computed at once.

        Returns:
            float64 (n,), the time of each clip's last frame, s, and float32
            (n, ``vector_size``), or as many numbers as the groups have.

        Raises:
            ConfigError: No times for frames without any, an invalid hop, or as in `encode`.
            DataError: The video is too short for one clip, its times do not go forward, or a frame
                cannot be decoded.
        """
        check_batch_size(batch_size)
        frames = open_video(video)
        # once, of the video: in encode(), "first" would be the first frame of each clip
        if isinstance(background, str) and background == "first":
            background = frames.read([0])[0]
        ends: list[float] = []
        vectors: list[Tensor] = []
        clips_of = self.cut(frames, hop, times)
        while batch := list(islice(clips_of, batch_size)):
            ends += [end for end, _ in batch]
            stacked = np.stack([clip for _, clip in batch])
            vectors.append(
                self.encode(
                    stacked,
                    background,
                    sensor,
                    groups=groups,
                    unknown_sensor=unknown_sensor,
                    batch_size=batch_size,
                )
            )
        return np.array(ends), torch.cat(vectors)

    def stream(
        self,
        sensor: str | None = None,
        *,
        background: NDArray[np.uint8] | Literal["first"] | Background | None = None,
        contact: ContactOptions | None = None,
        slip: SlipOptions | None = None,
        embedding: bool = True,
        unknown_sensor: Policy = "error",
        calibration: Calibration | str | Path | None = None,
    ) -> TouchStream:
        """Predictions of frames as they come: ``stream.push(frame, time)``.

        Clips are cut by time, at any rate of the camera; ``tactileforge live`` reads the same
        stream. Warns where forces are an estimate, see `force`.

        Args:
            sensor: Name of the sensor; None where the model knows one, or none.
            background: The frame without contact, uint8 (H, W, 3); ``first``, the first frame,
                unchecked; or how it is taken: None and `Background` take the median of the first
                ``seconds``, in which nothing may touch.
            contact: Thresholds of contact; see `ContactOptions`.
            slip: Thresholds of slip; see `SlipOptions`.
            embedding: Whether predictions carry the model's vector.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            calibration: Calibration of this unit, or its file, as in `force`.

        Raises:
            ConfigError: The model does not know the sensor, or the calibration is of another.

        Example:
            >>> stream = model.stream("digit")  # doctest: +SKIP
            >>> while (now := stream.push(camera.read(), time.monotonic())) is None:
            ...     pass  # doctest: +SKIP
            >>> now.contact, now.force  # doctest: +SKIP
            (True, (0.02, -0.31, 1.24))
        """
        calibration = forces.opened_calibration(calibration)
        stream = TouchStream(
            self,
            sensor,
            background=background,
            contact=contact,
            slip=slip,
            embedding=embedding,
            unknown_sensor=unknown_sensor,
            calibration=calibration,
        )
        if calibration is None and self._scale([stream.sensor or ""]) is not None:
            forces.warn_of_estimates()
        return stream

    def squash(self, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Images as training showed them to the encoder; `encode` and the others do it themselves.

        Args:
            images: uint8 (..., H, W, 3).
        """
        return squash_images(images, self.squashed)

    def compile(self, *args: Any, **kwargs: Any) -> None:
        """Compiles the preprocessing and the blocks used by `encode`, `force` and all methods.

        The first call after it, and the first call with each other batch size, takes a minute.

        Args:
            *args: No positional arguments; options have names.
            **kwargs: Options of `torch.compile`.

        Raises:
            ConfigError: The encoder has no blocks to compile: it is not one of ours.
        """
        from tactileforge.encoders.compiled import compile_blocks

        if not compile_blocks(self, *args, **kwargs):
            raise ConfigError(
                f"the encoder {self.header.encoder.get('name')} has no blocks to be compiled; "
                "leave compile() out, or compile parts of model.encoder by torch.compile"
            )

    def keep_fingerprint(self) -> None:
        """Keeps the hashes of the current weights: a fit for a model also fits its rounded copy."""
        self._fingerprint, self._encoder_hash = self.fingerprint, self.encoder_hash

    # made anew at each use: an encoder or head may be put in another's place
    @property
    def _clips(self) -> ClipEncoder:
        return ClipEncoder(self.encoder, trained_here=bool(self.recipe))

    @property
    def _force(self) -> ForceReader | None:
        if "force" not in self.heads:
            return None
        return ForceReader(self._clips, self.heads["force"], self.header.heads["force"])

    def _scale(self, names: Sequence[str]) -> Tensor | None:
        """Force scale of each clip; None without a force head, or without the scale of a sensor."""
        return None if self._force is None else self._force.scale(names)


def refuse_itself(frames: Images, background: Images | str | None) -> None:
    """Raises a ConfigError if one image would be its own background."""
    word = background if isinstance(background, str) else ""
    if word == "first" and getattr(frames, "ndim", 0) == 3:
        raise ConfigError("background='first' is the image itself: give one without contact")
