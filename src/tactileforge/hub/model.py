"""A loaded model: uint8 frames in, vectors and forces out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tactileforge.encoders.feature_groups import group_sizes
from tactileforge.errors import ConfigError
from tactileforge.hub import forces, head_reader, saving
from tactileforge.hub.cards import Card
from tactileforge.hub.clip_encoder import ClipEncoder, check_device
from tactileforge.hub.clips import Batched, GivenClips, Sensors, Still, Unknown, check_batch_size
from tactileforge.hub.forces import ModelReadings
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import Images, as_pixels, read_still, squash_images
from tactileforge.hub.packed_force import PackedForce
from tactileforge.hub.picture_checks import PictureChecks
from tactileforge.hub.sensor_rows import Policy
from tactileforge.hub.taps import Tap
from tactileforge.hub.video import Times, Video, cut_clips, open_video, stacked, still_of
from tactileforge.plugins import local
from tactileforge.sensors.background import Background
from tactileforge.sensors.streaming.contact import ContactOptions, SlipOptions
from tactileforge.sensors.streaming.inputs import ForceUnit
from tactileforge.sensors.streaming.touch_stream import TouchStream
from tactileforge.util.threads import usable_after_fork

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
        loaded: Hashes of its parts as they were loaded; see `part_hashes`.

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
        self._picture_checks = PictureChecks()
        self.header = header
        self.card = card
        self.heads = nn.ModuleDict(dict(heads or {}))
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        # encoding in workers that are forked is a usual pattern, as of a DataLoader
        usable_after_fork()
        # checked first: a move that fails would leave a part of the weights behind
        self.to(check_device(device)).eval()
        self.loaded = self.part_hashes()

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        return self.clips_reader.device

    @property
    def sensors(self) -> list[str]:
        """Sensors in its training; with ``any_sensor`` it takes others, too."""
        return list(self.encoder.sensors)

    @property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type: every sensor is encoded alike, named or not."""
        return self.clips_reader.any_sensor

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
        return self.clips_reader.squashed

    @property
    def reading(self) -> Literal["summary", "projected"]:
        """Vector of `encode` without groups: ``summary``; ``projected`` of imported weights.

        A linear probe on the summary of a model trained here reads more than on its projected class
        token (docs/reports/gate.md). Imported weights give the vector that their authors use.
        """
        return self.clips_reader.reading

    @property
    def vector_size(self) -> int:
        """Length of a vector of `encode`."""
        return self.clips_reader.vector_size

    @property
    def group_sizes(self) -> dict[str, int]:
        """Size of each group of `groups`, by name, in their order."""
        return group_sizes(self.encoder)

    @property
    def fingerprint(self) -> str:
        """Hash of its weights, 16 hexadecimal digits; ties a calibration to its model.

        Heads by classes of the user's own do not count: the file is read without them too.
        """
        if self._fingerprint:
            return self._fingerprint
        own = {key for key, one in self.header.heads.items() if local.is_local(one["node"]["name"])}
        heads = [self.heads[key] for key in sorted(self.heads) if key not in own]
        return forces.fingerprint([self.encoder, *heads])

    @property
    def encoder_hash(self) -> str:
        """The same of the encoder's weights alone; ties a head for classes to its encoder."""
        return self._encoder_hash or forces.fingerprint([self.encoder])

    @property
    def is_rounded(self) -> bool:
        """Whether its weights were rounded when it was loaded: ``dtype`` of `load`."""
        return bool(self._fingerprint)

    def part_hashes(self) -> dict[str, str]:
        """Hashes of the weights of ``encoder`` and of each ``head.NAME``."""
        parts = {"encoder": self.encoder, **{f"head.{key}": x for key, x in self.heads.items()}}
        return {key: forces.fingerprint([part]) for key, part in parts.items()}

    def add_head(self, name: str, head: str | type[nn.Module] = "", /, **options: Any) -> nn.Module:
        """Puts a new head beside the encoder, in ``heads``: `read_head` reads it, `save` keeps it.

        It can be trained, and in evaluation mode. Of a class of your own the file has the weights
        and the name, so ``load(path, classes={"my_module:Grasp": Grasp})`` has the head again;
        without the class the rest is loaded.

        Args:
            name: Name of the head.
            head: A class, made as ``head(encoder, **options)``, or the name of one: installed,
                registered, or ``my_module:Grasp``; "" for the installed one called `name`.
            **options: Arguments of its constructor: plain data, which the file keeps.

        Raises:
            ConfigError: The name is taken, or the class takes no such options.
            PluginError: There is no such class, or it is no head.

        Example:
            >>> import tactileforge
            >>> model = tactileforge.create("tactile_vit", size="tiny")
            >>> model.add_head("classify", classes=3).linear.out_features
            3
        """
        return saving.add_head(self, name, head, options)

    def save(self, path: str | Path, **options: Any) -> Path:
        """Writes the model as it is now to one file, which ``load(path)`` reads.

        Weights that were trained since they were loaded, in a loop of yours too, have their lineage
        in the header: from which weights they come, and what changed, by hashes.

        Args:
            path: The file.
            **options: ``name``; ``licence``, where the weights have none; ``dtype``, ``float32`` or
                ``float16``.

        Raises:
            ConfigError: Rounded weights, numbers that are not finite, or another licence than that
                of the weights from which these come.
        """
        return saving.save_model(self, path, **options)

    def save_pretrained(self, folder: str | Path, **options: Any) -> Path:
        """Writes the file and a card to a folder, which ``load(folder)`` reads; see `save`.

        A model without a name gets that of the folder.
        """
        return saving.save_folder(self, folder, **options)

    def push_to_hub(
        self, repo: str, *, private: bool = False, message: str = "", **options: Any
    ) -> str:
        """Puts the file and a card into ``OWNER/NAME`` of the model hub, created if need be.

        Returns the address of the commit; options and errors are those of `save`, and a
        DataNotFoundError says what to do where the hub refuses.
        """
        return saving.push(self, repo, private=private, message=message, **options)

    def __repr__(self) -> str:
        size = sum(x.numel() for x in self.encoder.state_dict().values()) / 1e6  # int8 is a buffer
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.vector_size})"
        )

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
        is_own = forces.learned_measured(self.header.recipe)
        return forces.chosen_unit(calibration is not None, is_own, unit)

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

    def cut(
        self, video: Video, hop: float = 0.2, times: Times | None = None
    ) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Cuts a video into clips as in training, one at a time; arguments as in `encode_video`.

        For each clip the time of its last frame, s, and its frames, uint8 (T, H, W, 3).
        """
        return cut_clips(open_video(video), self.frames, self.spacing, hop, times)

    def encode_video(
        self,
        video: Video,
        background: Still = None,
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
            batch_size: GivenClips that are read and computed at once.

        Returns:
            float64 (n,), the time of each clip's last frame, s, and float32
            (n, ``vector_size``), or as many numbers as the groups have.

        Raises:
            ConfigError: No times for frames without any, an invalid hop, or as in `encode`.
            DataError: The video is too short for one clip, its times do not go forward, or a frame
                cannot be decoded.
        """
        options: Batched = {"unknown_sensor": unknown_sensor, "batch_size": batch_size}
        check_batch_size(batch_size)
        opened = open_video(video)
        clips, still = self.cut(opened, hop, times), still_of(opened, background)
        ends: list[float] = []
        vectors: list[Tensor] = []
        for some, batch in stacked(clips, batch_size):
            ends += some
            vectors.append(self.encode(batch, still, sensor, groups=groups, **options))
        return np.array(ends), torch.cat(vectors)

    def force_video(
        self,
        video: Video,
        background: Still = None,
        sensor: str | None = None,
        *,
        calibration: Calibration | str | Path | None = None,
        unit: ForceUnit | None = None,
        hop: float = 0.2,
        times: Times | None = None,
        batch_size: int = 16,
    ) -> tuple[Times, Tensor]:
        """Forces along a video, each in the last frame of a clip.

        Args:
            video: A file, frames, or an array of them, as in `encode_video`.
            background: Frame without contact; ``"first"`` is that of the video, where `force` of
                one clip takes that of the clip.
            sensor: Name of the sensor, as in `force`.
            calibration: Calibration of this unit, or its file, as in `force`.
            unit: Unit of the forces, as in `force`.
            hop: Seconds between neighbouring forces; at least one frame.
            times: float64, seconds of each frame, increasing; a file knows its own.
            batch_size: GivenClips that are read and computed at once.

        Returns:
            float64 (n,), times, s, and float32 (n, 3), forces.

        Raises:
            ConfigError: What `force` or `encode_video` refuses.
            DataError: The video is one that `encode_video` cannot read.
        """
        check_batch_size(batch_size)
        opened = open_video(video)
        clips, still = self.cut(opened, hop, times), still_of(opened, background)
        ends: list[float] = []
        found: list[Tensor] = []
        for some, batch in stacked(clips, batch_size):
            ends += some
            force = self.force(batch, still, sensor, calibration=calibration, unit=unit)
            found.append(force[:, -1])
        return np.array(ends), torch.cat(found)

    def stream(
        self,
        sensor: str | None = None,
        *,
        background: Images | Literal["first"] | Background | None = None,
        contact: ContactOptions | None = None,
        slip: SlipOptions | None = None,
        embedding: bool = True,
        unknown_sensor: Policy = "error",
        calibration: Calibration | str | Path | None = None,
        force_unit: ForceUnit | None = None,
    ) -> TouchStream:
        """Predictions of frames as they come: ``stream.push(frame, time)``.

        Clips are cut by time, at any rate of the camera; ``tactileforge live`` reads the same
        stream. Warns where forces are estimated newtons, see `force`.

        Args:
            sensor: Name of the sensor; None where the model knows one, or none.
            background: The frame without contact, an image as in `encode`; ``first``, the first
                frame, unchecked; or how it is taken: None and `Background` take the median of the
                first ``seconds``, in which nothing may touch.
            contact: Thresholds of contact; see `ContactOptions`.
            slip: Thresholds of slip; see `SlipOptions`.
            embedding: Whether predictions carry the model's vector.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            calibration: Calibration of this unit, or its file, as in `force`.
            force_unit: The ``unit`` of `force`; a prediction says it.

        Raises:
            ConfigError: The model does not know the sensor, the calibration is of another, or the
                unit does not go with it.
        """
        opened = forces.opened_calibration(calibration)
        still = read_still(background)
        if still is not None and not isinstance(still, str | Background):
            still = as_pixels("background", still)
            still = np.asarray(still.cpu() if isinstance(still, Tensor) else still)
        stream = TouchStream(
            self,
            sensor,
            background=still,
            contact=contact,
            slip=slip,
            embedding=embedding,
            unknown_sensor=unknown_sensor,
            calibration=opened,
            force_unit=force_unit,
        )
        has_force = head_reader.scale_of(self, [stream.sensor or ""]) is not None
        if has_force and stream.force_unit == "uncalibrated":
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
    def clips_reader(self) -> ClipEncoder:
        """Its encoder, with the preprocessing of clips."""
        return ClipEncoder(self.encoder, trained_here=bool(self.recipe))

    @property
    def force_reader(self) -> PackedForce | None:
        """Its force head, with the encoder; None without one."""
        if "force" not in self.heads:
            return None
        return PackedForce(self.clips_reader, self.heads["force"], self.header.heads["force"])
