"""Readings of clips by a model: vectors, features, forces, surfaces, classes and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge.hub import forces, head_reader
from tactileforge.hub.clips import Batched, GivenClips, Sensors, Still, Unknown
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.inputs import Images
from tactileforge.hub.parts import Parts
from tactileforge.hub.taps import Tap
from tactileforge.sensors.streaming.inputs import ForceUnit

if TYPE_CHECKING:
    from tactileforge.hub.classify import Classes, ClassHead
    from tactileforge.hub.words import TextEncoder, WordMatches
    from tactileforge.sensors.calibration.file import Calibration, ForceAxis


class ClipReadings(Parts):
    """Parts of a model with all their readings of clips; arguments and attributes as of `Model`."""

    def encode(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        groups: Sequence[str] | Literal["all"] | None = None,
        checks: bool = True,
        **options: Unpack[Batched],
    ) -> Tensor:
        """Encodes each clip as one vector; warns of changed light without touch.

        Args:
            frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or
                a batch with B in front. numpy or torch; floats from 0 to 1, PIL images and paths of
                images are taken too, and lists of these stacked. One image, (H, W, 3), (3, H, W) or
                a batch with one frame a clip, is shown in all T places, as the authors do.
            background: A frame without contact of the same recording, of the frames' size: one,
                or one per clip, in any of these forms. ``"first"`` takes the first frame of each
                clip, ``"none"`` subtracts nothing. May be left out only where the model uses none.
            sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal
                tokens. May be left out where the model knows one sensor, or none.
            groups: Names of groups, or ``all``, that are put side by side, each times a fixed
                factor with which a plain linear probe does well: see `groups` and
                `feature_groups.joint_vector`. None takes ``summary``, the best single vector for a
                linear probe; of imported weights the projected vector of their authors.
            checks: Whether to warn: once a background, of one that is mirrored, on its side or of
                other colours for its sensor; and of changed light.
            **options: ``unknown_sensor``: ``error``, or ``universal`` to take the universal tokens,
                and warn. ``batch_size``: clips that are computed at once, 32.

        Returns:
            float32 (n,), or (B, n) for a batch, on the model's device: n is ``vector_size``, or
            what `group_sizes` tells for the groups together.

        Raises:
            DataError: Frames or background are not what the model takes; says both.
            ConfigError: No background, no such sensor or group, or a batch size below 1.
        """
        if asked := [key for key in ("tap", "layers") if key in options]:
            raise ConfigError(
                f"encode gives one vector and takes no {asked[0]}=: model.features(frames, "
                f"background, sensor, {asked[0]}=...)"
            )
        clips = GivenClips(frames, background, sensor, checks=checks, **options)
        if checks:
            self._picture_checks(clips.background, sensor)
        return self.clips_reader.encoded(groups, clips)

    def features(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        tap: Tap | None = None,
        layers: int | Sequence[int] | None = None,
        **options: Unpack[Batched],
    ) -> Any:
        """Features of clips at one of the encoder's taps, float32, with B in front for a batch.

        Arguments and errors are those of `encode`; ``tap`` is one of `taps.Tap`, ``tokens`` without
        one. With ``layers`` in its place, a list of the outputs of these blocks, (L, width), or
        (C, H, W) of a convolutional network; -1 is the last.

        Raises:
            ConfigError: Both ``tap`` and ``layers`` are given.
        """
        if tap is not None and layers is not None:
            raise ConfigError(
                f"tap={tap!r} and layers={layers!r}: layers= gives the outputs of blocks as they "
                "are, tap= what the encoder makes of the last; give one of the two"
            )
        clips = GivenClips(frames, background, sensor, **options)
        if layers is not None:
            several = [layers] if isinstance(layers, int) else layers
            return self.clips_reader.layered(several, clips)
        return self.clips_reader.tapped(tap or "tokens", clips)

    def groups(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        names: Sequence[str] | None = None,
        **options: Unpack[Batched],
    ) -> dict[str, Tensor]:
        """Features of clips in groups, by name, float32 (n,), or (B, n); sizes as in `group_sizes`.

        Arguments and errors are those of `encode`. None takes all groups, see
        `feature_groups.GROUPS`; a group that is not named costs nothing: without ``summary`` no
        transformer runs, without ``photographs`` beside it no network.
        """
        return self.clips_reader.grouped(names, GivenClips(frames, background, sensor, **options))

    def forward(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        tap: Tap = "projected",
        **options: Unpack[Unknown],
    ) -> Tensor:
        """Encodes all clips at once, with gradients if they are enabled: ``model(clips, ...)``.

        Arguments, shapes and errors are those of `features`.
        """
        return self.clips_reader.with_gradients(
            tap, GivenClips(frames, background, sensor, **options)
        )

    def force(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        calibration: Calibration | str | Path | None = None,
        unit: ForceUnit | None = None,
        checks: bool = True,
    ) -> Tensor:
        """The force of the object on the gel in frames 2..T: (T - 1, 3), or (B, T - 1, 3).

        The frames of a clip are ``spacing`` seconds apart, as in training; `force_video` takes them
        so from a film.

        Args:
            frames: Clips as in `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip; one whose force scale the model knows.
            calibration: Calibration of this unit, or its file (``tactileforge calibrate
                model=...``): the force is in newtons. An axis that it leaves out is an estimate.
            unit: ``N``, newtons, with a calibration, or of a model that learned forces measured on
                your own recordings (``data=recordings``): None takes them there. ``relative``,
                shares of the sensor's force scale in training: shear from -1 to 1 and normal force
                from 0 to 1, give or take noise around 0; None takes them elsewhere.
                ``uncalibrated``, newtons by that scale: an estimate, and warns.
            checks: Whether to check the background, as in `encode`.

        Returns:
            float32; of a published head in the newest frame alone, (1, 3). NaN, with a warning, in
            frames with changed light and no touch, with another light than in the presses of the
            calibration, or beyond the scale of the sensor.

        Raises:
            ConfigError: There is no force head, or no scale of the sensor; or the unit does not go
                with what is given, or the calibration is of another model; see `encode`.
            DataError: Frames or background are not what the model takes.
        """
        clips = GivenClips(frames, background, sensor)
        if checks:
            self._picture_checks(clips.background, sensor)
        return head_reader.force_of(self, clips, calibration, unit)

    def force_unit(
        self, calibration: Calibration | str | Path | None = None, unit: str | None = None
    ) -> ForceUnit:
        """What the numbers of `force` are with these arguments; errors for its ``unit`` too."""
        return head_reader.unit_of(self, calibration, unit)

    def surface(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        **options: Unpack[Unknown],
    ) -> Tensor:
        """The estimated displacement of the gel's surface, mm: (T, 3, 32, 32), or with B in front.

        Along x and y of the image and z into the gel, in 32 rows and columns that span the frame;
        learned from simulated gels, see the card: an estimate, and warns. NaN, with a warning, in
        frames with changed light. Errors are those of `encode`, and a ConfigError without a surface
        head.
        """
        return head_reader.surface_of(self, GivenClips(frames, background, sensor, **options))

    def classify(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        head: str | Path | ClassHead | None = None,
        names: Sequence[str] | None = None,
        **options: Unpack[Unknown],
    ) -> Classes:
        """Classifies clips, or still images, by a linear head on their projected vectors.

        Args:
            frames: Clips as in `encode`. A list is a batch: of images (paths, PIL, arrays), also of
                different sizes, or of clips. An array X of single images, (B, H, W, 3), is
                ``X[:, None]``: one frame a clip.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            head: A head that the benchmark fitted to this model, ``heads/TASK.MODEL.safetensors``;
                None takes the one of a run trained with the objective ``classify``.
            names: Objects to choose from, for the head of a run; None takes all that it was trained
                on.
            **options: ``unknown_sensor``, as in `encode`.

        Raises:
            ConfigError: There is no head, or it belongs to another model or sensor, or was fitted
                with a background where none is given, or the other way round; see `encode`.
            DataError: The file is not a head; see `encode`.
            DataNotFoundError: There is no such file.
        """
        from tactileforge.hub.classify import layer_of, read_classes

        clips = GivenClips(frames, background, sensor, **options)
        # the layer first: a wrong head is found before the encoder has done its work
        layer = layer_of(head, names, clips, self)
        return read_classes(self, clips, layer)

    def match_words(
        self,
        frames: Images,
        words: Sequence[str],
        background: Still = None,
        sensor: Sensors = None,
        *,
        template: str | None = None,
        temperature: float | None = None,
        text_encoder: TextEncoder | None = None,
        **options: Unpack[Unknown],
    ) -> WordMatches:
        """Words for clips, by cosine similarity in the space shared by touch and language.

        Source: CLIP (arXiv 2103.00020), section 3.1.2.

        Args:
            frames: Clips, or still images, as in `encode`.
            words: Words or phrases to choose from, each once.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            template: Sentence of a word, with ``{}`` for it; None takes the one on the card, or
                the word alone.
            temperature: Temperature of the softmax over words; None takes that of training, or
                0.07 where the file keeps none.
            text_encoder: Text tower, or the name on the model hub or the folder of the CLIP that
                has it; None takes the one in the file, or on the card.
            **options: ``unknown_sensor``, as in `encode`.

        Raises:
            ConfigError: The model is not aligned with language, or the tower does not fit it; or no
                words, or a template without ``{}``; see `encode`.
            PluginError: The text tower cannot be loaded; says what to install.
            DataError: Frames or background are not what the model takes.
        """
        from tactileforge.hub.words import language_of, match_vectors

        clips = GivenClips(frames, background, sensor, **options)
        clips.refuse_itself()
        side = language_of(self.header, dict(self.heads), repr(self), self.projected)
        # the words first: a missing tower is found before the encoder has done its work
        text = side.vectors(words, template, text_encoder, self.device)
        touch = self.clips_reader.tapped("projected", clips)
        kept = side.temperature if temperature is None else temperature
        return match_vectors(touch, text, words, kept)

    def read_head(
        self,
        name: str,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        **options: Unpack[Unknown],
    ) -> Any:
        """Reads the head called ``name`` as it is: logits, or normalised forces, of a batch.

        Arguments, warnings and errors are those of `encode`.
        """
        return head_reader.read_head(self, name, GivenClips(frames, background, sensor, **options))

    def readings(
        self,
        frames: Images,
        background: Still = None,
        sensor: Sensors = None,
        *,
        calibration: Calibration | str | Path | None = None,
        force_unit: str | None = None,
        check: bool = True,
        **options: Unpack[Unknown],
    ) -> ModelReadings:
        """Vectors and forces of clips, from one pass of the encoder; see `encode` and `force`.

        ``force_unit`` is the ``unit`` of `force`. Without ``check``, light and colours are not
        compared with the background: a stream does so itself, in pictures as they came.
        """
        clips = GivenClips(frames, background, sensor, **options)
        return head_reader.readings_of(self, clips, calibration, force_unit, check)

    def force_inputs(self, frames: Images, background: Still, sensor: str) -> dict[str, Tensor]:
        """Inputs of a force calibration, float32 (B, T - 1) each, of a batch; see `force`.

        What the force head tells, see `forces.calibration_inputs`, and the change of the pictures,
        see `picture_features.picture_inputs`. NaN, with a warning, in frames with changed light
        and no touch.
        """
        return head_reader.force_inputs_of(self, GivenClips(frames, background, sensor))

    def axes_of(self, calibration: Calibration, names: Sequence[str]) -> Mapping[str, ForceAxis]:
        """The fits of a calibration; a ConfigError if it is of another model or sensor."""
        return forces.fitted_axes(calibration, names, self.fingerprint)
