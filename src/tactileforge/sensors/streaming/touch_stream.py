"""Online estimates from frames: contact, force, slip and vectors."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame
from tactileforge.errors import ConfigError, DataError, SensorError
from tactileforge.sensors.background import Background, check_background, spread_frames
from tactileforge.sensors.borders import amid_other_light, border_inputs, has_other_light
from tactileforge.sensors.health import exposure_trouble
from tactileforge.sensors.light import LightCheck
from tactileforge.sensors.streaming.buffer import ClipBuffer, FrameWithClip, warn_of_slow_frames
from tactileforge.sensors.streaming.contact import (
    BackgroundChange,
    ContactDetector,
    ContactOptions,
    SlipEstimator,
    SlipOptions,
)
from tactileforge.sensors.streaming.inputs import (
    ForceUnit,
    Image,
    background_options,
    checked_image,
    known_as,
    median_image,
)
from tactileforge.sensors.swapped_colours import warn_of_swapped

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.file import Calibration
    from tactileforge.sensors.streaming.inputs import ClipModel

#: Largest number of frames for a background.
_LOOKED_AT = 60


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Contact, force and slip, estimated from one frame and the clip ending with it.

    Attributes:
        number: Number of the frame, counted from 1.
        time: Time of the frame, s, on the clock of its source.
        difference: Difference to the background, grey levels.
        contact: Whether there is contact; None if the image is invalid or the light has changed.
        force: Force along x, y and z, in ``force_unit``, axes as in `contracts`; None if the model
            gives none, the image is invalid, the light has changed or is none of the calibration's
            presses, or the force is beyond the sensor's scale.
        slip: Whether it slips, see `contact.SlipEstimator`; None without forces.
        force_unit: What the numbers of the force are, see `Model.force`: ``N``, ``relative`` or
            ``uncalibrated``; None without a force.
        trouble: One of `sensors.health.TROUBLES`; "" for none.
        embedding: Vector of the model, as of `encode`, float32 (n,); None if it is not requested.
    """

    number: int
    time: float
    difference: float
    contact: bool | None
    force: tuple[float, float, float] | None
    slip: bool | None
    force_unit: ForceUnit | None = None
    trouble: str = ""
    embedding: NDArray[np.float32] | None = field(default=None, repr=False)


class TouchStream:
    """Predictions of the newest frame of one sensor.

    `push` adds a frame and predicts. If frames arrive in a different thread, that thread calls
    `add`, and `predict` uses the newest frame: frames in between are skipped, never queued.

    Args:
        model: Model for vectors and forces; None for contact alone.
        sensor: Name of the sensor; None if the model knows only one, or any.
        background: Frame without contact, uint8 (H, W, 3); or ``first``, the first frame,
            unchecked; or options for taking it: None and `Background` take the median of the first
            ``seconds``, without contact meanwhile.
        contact: Thresholds of contact; None for the defaults.
        slip: Thresholds of slip; None for the defaults.
        embedding: Whether predictions include the model's vector.
        unknown_sensor: Treatment of a sensor unknown to the model: ``error`` or ``universal``, see
            `Model.encode`.
        calibration: Calibration of this unit, for the model's forces; see `Model.force`. None for
            none.
        force_unit: Unit of the forces, see `Model.force`; None for newtons with a calibration, else
            relative ones.
        camera: Whether frames are of a camera; images of taxels are not checked for exposure and
            light.

    Attributes:
        background: Frame without contact, uint8 (H, W, 3); None before it is taken.
        force_unit: Unit of the forces; None without a model.
        done: Number of frames with a prediction.
        skipped: Number of frames without a prediction because a newer one had arrived.
        shown: Frame of the newest prediction.

    Raises:
        ConfigError: The model does not know the sensor, the calibration is of a different one, or
            the model does not give forces in this unit.
    """

    def __init__(
        self,
        model: ClipModel | None,
        sensor: str | None = None,
        *,
        background: Image | Literal["first"] | Background | None = None,
        contact: ContactOptions | None = None,
        slip: SlipOptions | None = None,
        embedding: bool = True,
        unknown_sensor: str = "error",
        calibration: Calibration | None = None,
        force_unit: str | None = None,
        camera: bool = True,
    ) -> None:
        if calibration is not None and model is not None:
            model.axes_of(calibration, [calibration.sensor if sensor is None else sensor])
        self.model, self.calibration, self.embedding = model, calibration, embedding
        self.force_unit = None if model is None else model.force_unit(calibration, force_unit)
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
        self._lit: deque[tuple[float, bool]] = deque(maxlen=64)  # the latest frames
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
            time: Time of the frame, s, on any increasing clock.

        Returns:
            The prediction; None while the background is taken, before enough frames have arrived
            for a clip, and with a gap in them.

        Raises:
            DataError: The frame is not an image, its size has changed, or its time does not
                increase.
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
        """Adds a frame, from one thread; `predict` may run in a different one."""
        seen = self._seen
        if seen is not None and len(seen) < _LOOKED_AT:
            # as it came: it is checked for contact at its full size
            seen.append(frame.array)
        self.buffer.push(frame)

    def begin_background(self) -> None:
        """Starts collecting frames for the background."""
        self._seen = []

    def take_background(
        self, options: Background | None = None, image: Image | None = None, name: str = "stream"
    ) -> None:
        """Takes the background from an image, or from the frames since `begin_background`.

        Args:
            options: Options for taking it; None or ``seconds`` 0 take the newest frame, unchecked.
            image: uint8 (H, W, 3), RGB; None takes the frames.
            name: Name of the sensor, for errors.

        Raises:
            SensorError: Something touches, or there is no image.
        """
        # taken away first: the thread of the sensor goes on adding frames
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
        """Resizes an image as in training, once for all clips with it."""
        return image if self.model is None else self.model.squash(image)

    @property
    def is_fresh(self) -> bool:
        """Whether a frame has arrived since the last prediction."""
        return self.buffer.count > self._last

    def predict(self) -> Prediction | None:
        """Predicts for the newest frame; None without a new frame or a full clip."""
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
        # not those before the first prediction, which went into the background and the first clip
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
        # under another light the vector is still that of the picture, but contact and force compare
        # with a background that no longer holds
        if trouble == "light":
            self._is_amid_light(frame.time, True)
            vector = self._read(shot)[-1]
        elif not trouble:
            contact = self.contact.update(difference)
            force, newton, vector = self._read(shot)
            if force is not None and self._is_amid_light(frame.time, self._is_other_light(shot)):
                force, trouble = None, "other_light"
            elif force is not None and not all(map(math.isfinite, force)):
                force, trouble = None, "out_of_range"
            if force is not None:
                # the friction cone wants shear and normal in one unit, which shares are not
                slip = self.slip.update(frame.time, newton, contact)
        return Prediction(
            number=shot.number,
            time=frame.time,
            difference=difference,
            contact=contact,
            force=force,
            slip=slip,
            force_unit=None if force is None else self.force_unit,
            trouble=trouble,
            embedding=vector,
        )

    def _is_amid_light(self, time: float, is_lit: bool) -> bool:
        """Whether a frame is in another light, or among many such frames; see `borders`."""
        if self.calibration is None:
            return is_lit
        self._lit.append((time, is_lit))
        times, lit = zip(*self._lit, strict=True)
        return bool(amid_other_light(np.array(lit), np.array(times), ahead=False)[-1])

    def _is_other_light(self, shot: FrameWithClip) -> bool:
        """Whether the light is another one than in the presses of the calibration."""
        force = None if self.calibration is None else self.calibration.force
        if force is None or not force.borders or shot.clip is None or not self._camera:
            return False
        return bool(has_other_light(border_inputs(shot.clip[-1:], self._still), force.borders)[0])

    def _read(
        self, shot: FrameWithClip
    ) -> tuple[tuple[float, float, float] | None, NDArray[np.float32], NDArray[np.float32] | None]:
        """Force in the newest frame, the same in newtons, and the vector of the clip."""
        none = np.full(3, np.nan, np.float32)
        if self.model is None or shot.clip is None:
            return None, none, None
        reading = self.model.readings(
            shot.clip,
            self._still,
            self.sensor,
            calibration=self.calibration,
            force_unit=self.force_unit,
            check=False,  # already checked on the frame before resizing
        )
        vector = reading.vector.cpu().numpy() if self.embedding else None
        if reading.force is None or reading.newton is None:
            return None, none, vector
        x, y, z = reading.force[-1].tolist()
        return (x, y, z), reading.newton[-1].cpu().numpy(), vector
