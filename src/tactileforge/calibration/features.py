"""Features of a frame for force estimation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, Recording
from tactileforge.data.frames.cut import held_clips
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import DataError, unknown
from tactileforge.sensors.taxels import REST

if TYPE_CHECKING:
    from torch import Tensor

#: Rows or columns of shrunk images, whichever are more; shrinking averages noise away.
_SIZE = 64
#: Number of frames to decode at a time.
_CHUNK = 64
#: Features of an image that grow with the normal force and do not depend on directions.
NORMAL = ("strength", "area", "peak", "volume")
_COLOURS = ("red", "green", "blue")
#: Change of a pixel that counts as contact if noise is not known, grey levels.
LEAST = 3.0


class ForceReader(Protocol):
    """Interface of a model for calibration, such as `hub.model.Model`."""

    @property
    def frames(self) -> int:
        """Number of frames of a clip."""

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip."""

    @property
    def fingerprint(self) -> str:
        """Identifier of the model's weights, to tie a calibration to its model."""

    def squash(self, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resizes images to the size of training."""

    def force_inputs(
        self, frames: NDArray[np.uint8], background: NDArray[np.uint8], sensor: str
    ) -> dict[str, Tensor]:
        """Readings of the force in frames 2..T, float32 (B, T - 1) each."""


def force_features(
    recording: Recording, kind: str, noise: float = LEAST, model: ForceReader | None = None
) -> dict[str, NDArray[np.float64]]:
    """Features of every frame, float64 (T,) each.

    ``pictures`` are changes from the background: the mean change (``strength``), the share of
    changed pixels (``area``), the largest change (``peak``, the 99th percentile), ``volume`` =
    peak * sqrt(area), the mean change of each colour, and the first moments of strength and colours
    along x and y, which shear shifts. ``taxels`` are the sums ``x``, ``y``, ``z`` of the taxels in
    images of an array, in units of full colour. ``head`` are the force inputs of a model, see
    `hub.forces.calibration_inputs`. Any other kind is the name of a track (T, 3) with the columns
    ``x``, ``y``, ``z``.

    Args:
        recording: Recording of touch.
        kind: Kind of features: ``pictures``, ``taxels``, ``head``, or the name of a track.
        noise: Change of a pixel that counts as contact, grey levels.
        model: Model for the kind ``head``.

    Raises:
        DataError: The recording has no background, or no such track.
        ConfigError: The model has no force head, or does not know the sensor.
    """
    if kind == "head" and model is not None:
        return _joined(_read_by(model, recording))
    if kind == "taxels":
        return _joined(_taxels(part) for part in chunks(recording.frames))
    if kind != "pictures":
        return _track(recording, kind)
    rest = median_background(recording)
    return _joined(_pictures(part, rest, noise) for part in chunks(recording.frames))


def median_background(recording: Recording) -> NDArray[np.float32]:
    """The median image without contact, float32 (H, W, 3).

    Raises:
        DataError: The recording has no frame without contact.
    """
    if recording.no_contact is None:
        raise DataError(
            f"{recording.key}: no frame without contact; record with background.seconds above 0"
        )
    count = min(len(recording.no_contact), 9)
    still: NDArray[np.float32] = np.median(recording.no_contact.read(range(count)), axis=0)
    return still.astype(np.float32)


def noise_threshold(recording: Recording) -> float:
    """Threshold of change above the noise, grey levels, for pixels at the size of features."""
    rest = recording.no_contact
    if rest is None or len(rest) < 3:
        return LEAST
    small = np.stack([_small(frame) for frame in rest.read(range(min(len(rest), 9)))])
    spread = float(np.std(small - np.median(small, axis=0)))
    return max(LEAST, round(4 * spread, 2))


def chunks(frames: Frames) -> Iterator[NDArray[np.uint8]]:
    """Yields frames of a recording, uint8 (n, H, W, 3), a few at a time."""
    for start in range(0, len(frames), _CHUNK):
        rows = range(start, min(start + _CHUNK, len(frames)))
        yield checked_pixels(frames.read(rows), "frames", 4)


def _joined(parts: Iterator[dict[str, NDArray[np.float64]]]) -> dict[str, NDArray[np.float64]]:
    rows = list(parts)
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def _small(picture: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = picture.shape[:2]
    scale = min(1.0, _SIZE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small: NDArray[np.float32] = cv2.resize(
        picture.astype(np.float32), size, interpolation=cv2.INTER_AREA
    )
    return small


def _pictures(
    frames: NDArray[np.uint8], rest: NDArray[np.float32], noise: float
) -> dict[str, NDArray[np.float64]]:
    still = _small(rest)
    change = np.stack([_small(frame) for frame in frames]).astype(np.float64) - still
    size = np.abs(change).mean(-1)
    felt = (size - noise).clip(min=0)
    area = (size > noise).mean((1, 2))
    peak = np.percentile(felt, 99, axis=(1, 2))
    rows, columns = (np.linspace(-1, 1, n) for n in size.shape[1:])
    features = {
        "strength": felt.mean((1, 2)),
        "area": area,
        "peak": peak,
        "volume": peak * np.sqrt(area),
        "strength_x": (felt * columns).mean((1, 2)),
        "strength_y": (felt * rows[:, None]).mean((1, 2)),
    }
    for number, colour in enumerate(_COLOURS):
        channel = change[..., number]
        features[colour] = channel.mean((1, 2))
        features[f"{colour}_x"] = (channel * columns).mean((1, 2))
        features[f"{colour}_y"] = (channel * rows[:, None]).mean((1, 2))
    return features


def _read_by(model: ForceReader, recording: Recording) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Features of a model for every frame, each as the last frame of a clip."""
    rest = model.squash(median_background(recording).round().astype(np.uint8))
    ends = np.arange(len(recording.frames))
    held = held_clips(recording.times, ends, model.frames, model.spacing)
    for start in range(0, len(held), _CHUNK):
        rows = held[start : start + _CHUNK]
        known, places = np.unique(rows, return_inverse=True)
        pictures = model.squash(recording.frames.read(known.tolist()))
        clips = pictures[places.reshape(rows.shape)]
        inputs = model.force_inputs(clips, rest, recording.sensor)
        yield {name: value[:, -1].cpu().double().numpy() for name, value in inputs.items()}


def _taxels(frames: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    sums = (frames.astype(np.float64) - REST).sum((1, 2)) / (REST - 1)
    return {name: sums[:, number] for number, name in enumerate("xyz")}


def _track(recording: Recording, name: str) -> dict[str, NDArray[np.float64]]:
    if name not in recording.tracks:
        known = {"pictures", "taxels", *recording.tracks}
        raise DataError(f"{recording.key}: {unknown('source of forces', name, known)}")
    values = np.asarray(recording.tracks[name], np.float64)
    if values.ndim != 2 or values.shape[1] < 3:
        raise DataError(
            f"{recording.key}: the track {name} is {values.shape}, but x, y and z are its columns"
        )
    return {axis: values[:, number] for number, axis in enumerate("xyz")}
