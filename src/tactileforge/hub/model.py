"""A loaded model: uint8 frames in, vectors and forces out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from tactileforge.errors import ConfigError
from tactileforge.hub import forces, head_reader, saving
from tactileforge.hub.clip_readings import ClipReadings
from tactileforge.hub.clips import Batched, Still, check_batch_size
from tactileforge.hub.inputs import Images, as_pixels, read_still
from tactileforge.hub.sensor_rows import Policy
from tactileforge.hub.video import Times, Video, along_video, cut_clips, open_video
from tactileforge.sensors.background import Background
from tactileforge.sensors.streaming.contact import ContactOptions, SlipOptions
from tactileforge.sensors.streaming.inputs import ForceUnit
from tactileforge.sensors.streaming.touch_stream import TouchStream

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.file import Calibration


class Model(ClipReadings):
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

        def read(clips: NDArray[np.uint8], still: Still) -> Tensor:
            return self.encode(clips, still, sensor, groups=groups, **options)

        opened = open_video(video)
        return along_video(opened, self.cut(opened, hop, times), background, batch_size, read)

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

        def read(clips: NDArray[np.uint8], still: Still) -> Tensor:
            return self.force(clips, still, sensor, calibration=calibration, unit=unit)[:, -1]

        opened = open_video(video)
        return along_video(opened, self.cut(opened, hop, times), background, batch_size, read)

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
