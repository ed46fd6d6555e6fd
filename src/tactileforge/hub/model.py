"""A loaded model: uint8 frames in, vectors and forces out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Frames
from tactileforge.hub import forces
from tactileforge.hub.feature_model import check_batch_size
from tactileforge.hub.head_model import HeadModel, refuse_itself
from tactileforge.hub.inputs import Images
from tactileforge.hub.sensor_rows import Policy
from tactileforge.hub.video import Times, cut_clips, open_video
from tactileforge.sensors.background import Background
from tactileforge.streaming.contact import ContactOptions, SlipOptions
from tactileforge.streaming.touch_stream import TouchStream

if TYPE_CHECKING:
    from tactileforge.calibration.file import Calibration
    from tactileforge.hub.words import TextEncoder, WordMatches


class Model(HeadModel):
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
            background: See `encode`, but ``"first"`` is the first frame of the video.
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
