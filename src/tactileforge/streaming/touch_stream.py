"""From frames, as they come, to contact, force, slip and vectors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame
from tactileforge.errors import ConfigError, DataError, SensorError
from tactileforge.sensors.background import Background, check_background, spread_frames
from tactileforge.sensors.health import exposure_trouble
from tactileforge.sensors.light import LightCheck
from tactileforge.sensors.swapped_colours import warn_of_swapped
from tactileforge.streaming.buffer import ClipBuffer, FrameWithClip, warn_of_slow_frames
from tactileforge.streaming.contact import (
    BackgroundChange,
    ContactDetector,
    ContactOptions,
    SlipEstimator,
    SlipOptions,
)
from tactileforge.streaming.inputs import (
    Image,
    background_options,
    checked_image,
    known_as,
    median_image,
)

if TYPE_CHECKING:
    from tactileforge.calibration.file import Calibration
    from tactileforge.hub.head_model import HeadModel

#: Frames that are looked at for a background.
_LOOKED_AT = 60


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Contact, force and slip, estimated from one frame and the clip that ends with it.

    Attributes:
        number: Of the frame, counted from 1.
        time: When it was taken, s, on the clock of whoever gave it.
        difference: From the background, grey levels.
        contact: Whether anything touches; None where the image is invalid or the light has changed.
        force: N, x, y and z, axes as in `contracts`; None where the model gives none, the image is
            invalid, the light has changed or the force is beyond the sensor's scale.
        slip: See `contact.SlipEstimator`; None without forces.
        trouble: One of `sensors.health.TROUBLES`; "" for none.
        embedding: float32 (projected,), the model's vector; None where it is not asked for.
    """

    number: int
    time: float
    difference: float
    contact: bool | None
    force: tuple[float, float, float] | None
    slip: bool | None
    trouble: str = ""
    embedding: NDArray[np.float32] | None = field(default=None, repr=False)


class TouchStream:
    """Predictions of the newest frame of one sensor.

    `push` takes a frame and predicts. Where frames come in another thread, that thread calls `add`,
    and `predict` gives the newest: frames between are skipped, never queued.

    Args:
        model: What encodes clips; None for contact alone.
        sensor: Name of the sensor; None where the model knows one, or none.
        background: The frame without contact, uint8 (H, W, 3); ``first``, the first frame,
            unchecked; or how it is taken: None and `Background` take the median of the first
            ``seconds``, in which nothing may touch.
        contact: When something touches.
        slip: When something slips.
        embedding: Whether predictions carry the model's vector.
        unknown_sensor: What to do where the model does not know the sensor: ``error`` or
            ``universal``, see `Model.encode`.
        calibration: Of this unit, for the model's forces; see `Model.force`.
        camera: Whether frames are of a camera; pictures of taxels are never black or saturated.

    Attributes:
        background: uint8 (H, W, 3), the frame without contact; None before it is taken.
        done: Frames of which a prediction was made.
        skipped: Frames of which none was made, because a newer one had come.
        shown: The frame of the newest prediction.

    Raises:
        ConfigError: The model does not know the sensor, or the calibration is of another.
    """

    def __init__(
        self,
        model: HeadModel | None,
        sensor: str | None = None,
        *,
        background: Image | Literal["first"] | Background | None = None,
        contact: ContactOptions | None = None,
        slip: SlipOptions | None = None,
        embedding: bool = True,
        unknown_sensor: str = "error",
        calibration: Calibration | None = None,
        camera: bool = True,
    ) -> None:
        if calibration is not None and model is not None:
            model.axes_of(calibration, [calibration.sensor if sensor is None else sensor])
        self.model, self.calibration, self.embedding = model, calibration, embedding
        self.sensor = None if sensor is None else known_as(sensor, model, unknown_sensor)
        asks = model is not None and not model.any_sensor and len(model.sensors) > 1
        if sensor is None and model is not None and asks:
            raise ConfigError(f"no sensor is named: give sensor=..., one of: {model.sensors}")
        frames, spacing = (1, 0.0) if model is None else (model.frames, model.spacing)
        self.buffer = ClipBuffer(frames, spacing, self.prepare)
        self.contact = ContactDetector(contact or ContactOptions())
        self.slip = SlipEstimator(slip or SlipOptions())
        self.background: Image | None = None
        self.done = self.skipped = 0
        self.shown: Frame | None = None
        self._camera = camera
        self._last, self._time, self._size = 0, -math.inf, (0, 0)
        self._seen: list[Image] | None = None
        self._end = 0.0
        self._options = background_options(background)
        if isinstance(background, np.ndarray):
            self.take_background(image=checked_image("background", background))
            self._size = background.shape[:2]

    def push(self, frame: Image, time: float) -> Prediction | None:
        """Adds a frame and predicts.

        Args:
            frame: uint8 (H, W, 3), RGB.
            time: When it was taken, s, on any clock that goes forward.

        Returns:
            None while the background is taken, and while too few frames have come for a clip, or
            have a gap in them.

        Raises:
            DataError: No image, one of another size than before, or a time that does not go on.
            SensorError: Something touches while the background is taken, or the images are black or
                saturated.
        """
        image = checked_image("frame", frame)
        if self._size not in ((0, 0), image.shape[:2]):
            raise DataError(
                f"frame: {image.shape[:2]} pixels, and the background and frames before it have "
                f"{self._size}"
            )
        if not math.isfinite(time) or time <= self._time:
            raise DataError(
                f"time={time}: the frame before was at {self._time:g} s, and times go forward; "
                "begin a new stream where a recording begins"
            )
        if self.background is None and self._seen is None:
            self._end = time + self._options.seconds
            self.begin_background()
        self._size, self._time = image.shape[:2], float(time)
        self.add(Frame(array=image, time=float(time)))
        if self.background is None:
            if time < self._end:
                return None
            self.take_background(self._options)
        return self.predict()

    def add(self, frame: Frame) -> None:
        """Adds a frame, from any one thread; `predict` may run in another."""
        seen = self._seen
        if seen is not None and len(seen) < _LOOKED_AT:
            seen.append(frame.array)
        self.buffer.push(frame)

    def begin_background(self) -> None:
        """Begins to keep frames without contact."""
        self._seen = []

    def take_background(
        self, options: Background | None = None, image: Image | None = None, name: str = "stream"
    ) -> None:
        """Takes the background from the frames since `begin_background`, or as given.

        Args:
            options: ``seconds`` 0 takes the newest frame, unchecked.
            image: uint8 (H, W, 3), RGB; None takes the frames.
            name: Of the sensor, for errors.

        Raises:
            SensorError: Something touches, or there is no image.
        """
        seen, self._seen = self._seen or [], None
        if image is None and options is not None and options.seconds:
            seen = list(check_background(name, seen, options.threshold, self._camera))
            image = median_image(spread_frames(seen, options.frames))
        elif image is None:
            shot = self.buffer.newest()
            if shot is None:
                raise SensorError(f"{name}: no frame came for its background")
            image = shot.frame.array
        self.background = image
        self._still = self.prepare(image)
        self._difference = BackgroundChange(image, self._camera)
        self._light = LightCheck(image)

    def prepare(self, image: Image) -> Image:
        """Prepares an image as in training, once, however many clips it is part of."""
        return image if self.model is None else self.model.squash(image)

    @property
    def is_fresh(self) -> bool:
        """Whether a frame has come since the last prediction."""
        return self.buffer.count > self._last

    def predict(self) -> Prediction | None:
        """The prediction of the newest frame; None where there is no new one, or no clip yet."""
        shot = self.buffer.newest()
        if shot is None or shot.number == self._last:
            return None
        behind, self._last = shot.number - self._last - 1, shot.number
        self.shown = shot.frame
        if shot.clip is None or self.background is None:
            return None
        if not self.done and self.model is not None:
            warn_of_slow_frames(shot.period, self.model.spacing, self.model.frames, stacklevel=4)
        if not self.done and self._camera and shot.frame.array.shape == self.background.shape:
            warn_of_swapped(self.sensor or "stream", shot.frame.array, self.background, 4)
        self.skipped += behind if self.done else 0
        self.done += 1
        return self._predict(shot)

    def _predict(self, shot: FrameWithClip) -> Prediction:
        frame = shot.frame
        trouble = exposure_trouble(frame.array) if self._camera else ""
        contact: bool | None = None
        force: tuple[float, float, float] | None = None
        slip: bool | None = None
        vector: NDArray[np.float32] | None = None
        difference = self._difference(frame.array)
        if self._camera and not trouble and self._light(frame.array):
            trouble = "light"
        if trouble == "light":
            vector = self._read(shot)[1]
        elif not trouble:
            contact = self.contact.update(difference)
            force, vector = self._read(shot)
            if force is not None and not all(map(math.isfinite, force)):
                force, trouble = None, "out_of_range"
            if force is not None:
                slip = self.slip.update(frame.time, np.array(force), contact)
        return Prediction(
            number=shot.number,
            time=frame.time,
            difference=difference,
            contact=contact,
            force=force,
            slip=slip,
            trouble=trouble,
            embedding=vector,
        )

    def _read(
        self, shot: FrameWithClip
    ) -> tuple[tuple[float, float, float] | None, NDArray[np.float32] | None]:
        """Force in the newest frame, N, and the vector of the clip."""
        if self.model is None or shot.clip is None:
            return None, None
        reading = self.model.readings(
            shot.clip,
            self._still,
            self.sensor,
            calibration=self.calibration,
            check=False,  # done already, in the picture as it came
        )
        vector = reading.vector.cpu().numpy() if self.embedding else None
        if reading.force is None:
            return None, vector
        x, y, z = reading.force[-1].tolist()
        return (x, y, z), vector
