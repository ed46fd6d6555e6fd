"""Features of a frame for force estimation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, Recording
from tactileforge.data.frames.cut import held_clips
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import DataError, unknown
from tactileforge.sensors.borders import border_inputs
from tactileforge.sensors.taxels import REST

if TYPE_CHECKING:
    from torch import Tensor

#: Kinds of features that a model reads.
WITH_MODEL = ("head", "both")
#: Number of frames to decode at a time.
_CHUNK = 64


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
    recording: Recording, kind: str, model: ForceReader | None = None
) -> dict[str, NDArray[np.float64]]:
    """Features of every frame, float64 (T,) each.

    ``pictures`` are changes from the background, see `picture_features.picture_inputs`, and at the
    borders, see `borders.border_inputs`. ``taxels`` are the sums ``x``, ``y``, ``z`` of the taxels
    in images of an array, in units of full colour. ``head`` and ``both`` are the force inputs of a
    model, with those of its pictures, see `hub.model.Model.force_inputs`. Any other kind is a track
    (T, 3) with the columns ``x``, ``y``, ``z``, by its name.

    Args:
        recording: Recording of touch.
        kind: Kind of features: ``pictures``, ``taxels``, ``head``, ``both``, or the name of a
            track.
        model: Model for the kinds ``head`` and ``both``.

    Raises:
        DataError: The recording has no background, or no such track.
        ConfigError: The model has no force head, or does not know the sensor.
    """
    if kind in WITH_MODEL and model is not None:
        return _joined(_read_by(model, recording))
    if kind == "taxels":
        return _joined(_taxels(part) for part in frame_chunks(recording.frames))
    if kind != "pictures":
        return _track(recording, kind)
    rest = median_background(recording).round().astype(np.uint8)
    return _joined(_pictures(part, rest) for part in frame_chunks(recording.frames))


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


def frame_chunks(frames: Frames) -> Iterator[NDArray[np.uint8]]:
    """Yields frames of a recording, uint8 (n, H, W, 3), a few at a time."""
    for start in range(0, len(frames), _CHUNK):
        rows = range(start, min(start + _CHUNK, len(frames)))
        yield checked_pixels(frames.read(rows), "frames", 4)


def _joined(parts: Iterator[dict[str, NDArray[np.float64]]]) -> dict[str, NDArray[np.float64]]:
    rows = list(parts)
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def _pictures(frames: NDArray[np.uint8], rest: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    import torch

    from tactileforge.sensors.calibration.picture_features import picture_inputs

    seen, still = (torch.from_numpy(x).movedim(-1, -3) for x in (frames, rest[None]))
    columns = {name: value.numpy() for name, value in picture_inputs(seen, still).items()}
    columns |= border_inputs(frames, rest)
    return {name: value.astype(np.float64) for name, value in columns.items()}


def _read_by(model: ForceReader, recording: Recording) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Features of a model for every frame, each as the last frame of a clip."""
    rest = model.squash(median_background(recording).round().astype(np.uint8))
    ends = np.arange(len(recording.frames))
    held = held_clips(recording.times, ends, model.frames, model.spacing)
    for start in range(0, len(held), _CHUNK):
        rows = held[start : start + _CHUNK]
        # a frame is in several clips, and is decoded once
        known, places = np.unique(rows, return_inverse=True)
        pictures = model.squash(recording.frames.read(known.tolist()))
        clips = pictures[places.reshape(rows.shape)]
        # the model warns of changed light itself
        inputs = model.force_inputs(clips, rest, recording.sensor)
        yield {name: value[:, -1].cpu().double().numpy() for name, value in inputs.items()}


def _taxels(frames: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
    sums = (frames.astype(np.float64) - REST).sum((1, 2)) / (REST - 1)
    return {name: sums[:, number] for number, name in enumerate("xyz")}


def _track(recording: Recording, name: str) -> dict[str, NDArray[np.float64]]:
    if name not in recording.tracks:
        known = {"auto", "none", "pictures", "taxels", *WITH_MODEL, *recording.tracks}
        raise DataError(f"{recording.key}: {unknown('fit', name, known)}")
    values = np.asarray(recording.tracks[name], np.float64)
    if values.ndim != 2 or values.shape[1] < 3:
        raise DataError(
            f"{recording.key}: the track {name} is {values.shape}, but x, y and z are its columns"
        )
    return {axis: values[:, number] for number, axis in enumerate("xyz")}
