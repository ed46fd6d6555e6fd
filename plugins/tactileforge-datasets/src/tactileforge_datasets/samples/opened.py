"""Recordings of samples: frames stay in their tar, values are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Frames, FrameSubset, Recording
from tactileforge.data import (
    UNITS,
    Blob,
    EncodedFrames,
    check_background_size,
    check_rising,
    label_actions,
)
from tactileforge.errors import ConfigError, DataError
from tactileforge.reading import (
    check_action,
    check_sensor,
    number_or_text,
    parse_background,
    trial_of,
)
from tactileforge_datasets.samples.layout import SampleLayout, newtons
from tactileforge_datasets.samples.places import (
    VIDEOS,
    fields_of,
    kind_of,
)
from tactileforge_datasets.samples.tar_frames import ArrayRows, TarVideo
from tactileforge_datasets.samples.units import Unit, numbered_parts
from tactileforge_datasets.samples.values import UnitValues

#: First bytes of pictures: JPEG, PNG, and WebP with its size in the middle.
_STARTS = (b"\xff\xd8", b"\x89PNG", b"RIFF")


@dataclass(frozen=True)
class SampleOpener:
    """Opens recordings of a layout.

    Attributes:
        layout: The layout.
        path: Path of the tar, for messages.
        tar: Name of the tar, the start of keys.
    """

    layout: SampleLayout
    path: str
    tar: str

    def open(self, unit: Unit) -> Recording:
        """The recording of some samples.

        Raises:
            DataError: A part is missing, damaged, or of another length.
            ConfigError: An option is missing, or a name of a sensor or action is unknown.
        """
        return _Opening(self.layout, unit, f"{self.path}, {unit.name}").recording(self.tar)

    def held_out_with(self, unit: Unit) -> str:
        """Name of the unit held out together."""
        template = self.layout.unit
        if not template:
            return trial_of(unit.name)
        try:
            values = UnitValues(self.layout, unit, f"{self.path}, {unit.name}")
            return values.text(template) or unit.name
        except DataError:  # it is named when the recording is opened
            return unit.name


class _Opening(UnitValues):
    """One recording while it is opened."""

    def recording(self, tar: str) -> Recording:
        """The recording, with the name of its tar at the start of its key."""
        layout, frames = self.layout, self.frames
        times = self._times(frames)

        force = self._force(len(frames))
        sensor = self.text(layout.sensor)
        check_sensor(sensor, self.where)
        captions = [self.text(one) for one in layout.captions]
        camera = self._camera()
        return Recording(
            key=f"{tar}/{self.unit.name}",
            sensor=sensor,
            frames=self._upright(frames),
            times=times,
            no_contact=self._no_contact(frames),
            force=force,
            action=self._action(times, force),
            object=self.text(layout.object) or None,
            text=", ".join(one for one in captions if one) or None,
            image=camera,
            image_times=times if camera is not None and layout.by_frame else None,
            labels={
                name: number_or_text(said)
                for name, template in layout.labels.items()
                if (said := self.text(template))
            },
            tracks={
                name: self.rows(place, len(frames)).astype(np.float32)
                for name, place in layout.tracks.items()
            },
            source=layout.source,
            tier=layout.tier,
            licence=layout.licence,
        )

    @cached_property
    def frames(self) -> Frames:
        """Frames of the touch, as they lie in the tar."""
        layout, samples = self.layout, self.unit.samples
        if layout.numbered:
            names = numbered_parts(samples[0], layout.touch)
            if not names:
                raise self.missing(samples[0], layout.touch)
            return self._shown([samples[0].parts[name] for name in names], layout.touch)
        blobs = [self.part(sample, layout.touch) for sample in samples]
        frames = self._shown(blobs, layout.touch)
        if len(frames) != len(samples) and layout.by_frame:
            raise DataError(
                f"{self.where}: {len(frames)} pictures in {len(samples)} samples; with {{frame}} "
                "in layout.samples, a sample has one"
            )
        return frames

    def _shown(self, blobs: Sequence[Blob], part: str) -> Frames:
        return shown(f"{self.where}.{part}", blobs, part)

    def _upright(self, frames: Frames) -> Frames:
        return self.layout.upright(frames)

    def _times(self, frames: Frames) -> NDArray[np.float64]:
        layout, count = self.layout, len(frames)
        if layout.times:
            read = self.rows(layout.times.values, count)
            if read.ndim != 1 or np.isnan(read).any():
                raise DataError(f"{self.where}: times of shape {read.shape}, or empty; correct it")
            times: NDArray[np.float64] = (read - read[0]) * UNITS[layout.times.unit]
            check_rising(times, self.where, "correct it")
            return times
        if layout.by_frame and layout.fps:
            numbers = [sample.frame for sample in self.unit.samples]
            return (np.array(numbers, np.float64) - numbers[0]) / layout.fps
        if isinstance(frames, TarVideo) and layout.fps is None:
            return frames.times("give layout.fps")
        if layout.fps is None and count > 1:
            raise ConfigError(f"{self.where}: {count} frames without times; give layout.fps")
        return np.arange(count) / (layout.fps or 1.0)

    def _force(self, count: int) -> NDArray[np.float32] | None:
        keys = self.layout.force
        if keys is None:
            return None
        if isinstance(keys.values, str):
            read = self.rows(keys.values, count)
            if np.isnan(read).all() and read.ndim == 1:
                return None
            columns = [column for column in keys.columns if column is not None]
            if read.ndim != 2 or read.shape[1] <= max(columns):
                raise DataError(
                    f"{self.where}: {keys.values} has shape {read.shape}, where ({count}, "
                    f"{max(columns) + 1} or more) belongs; correct it, or layout.force.columns"
                )
            axes = [None if column is None else read[:, column] for column in keys.columns]
        else:
            axes = [None if one is None else self.rows(one, count) for one in keys.values]
            if any(axis is not None and axis.shape != (count,) for axis in axes):
                raise DataError(f"{self.where}: a force axis with more than a number a frame")
        empty = np.full(count, np.nan)
        force = np.stack([empty if axis is None else axis for axis in axes], axis=1)
        if np.isnan(force).all():
            return None
        factors = np.array(keys.sign) * newtons(keys)
        return np.asarray(force * factors, np.float32)

    def _action(
        self, times: NDArray[np.float64], force: NDArray[np.float32] | None
    ) -> NDArray[np.int64] | None:
        action = self.layout.action
        if action == "none" or (action in (None, "force") and force is None):
            return None
        if action in (None, "force"):
            assert force is not None
            return label_actions(times, force)
        assert action is not None
        rows = np.full(len(times), -1, np.int64)
        for number in self.numbers(action):
            if name := self.filled(action, number):
                check_action(name, self.where)
                rows[number if self.layout.by_frame and fields_of(action) else slice(None)] = (
                    ACTIONS.index(name)
                )
        return rows

    def _no_contact(self, frames: Frames) -> Frames | None:
        rule = parse_background(self.layout.background, "data.layout.background")
        if rule is None:
            return None
        base = frames
        if rule.file:
            base = self._shown([self.part(self.unit.samples[0], rule.file)], rule.file)
            check_background_size(base.shape, frames.shape, self.where)
        return FrameSubset(self._upright(base), rule.rows(len(base)))

    def _camera(self) -> Frames | None:
        name = self.layout.camera.removesuffix("?")
        there = [sample for sample in self.unit.samples if name.lower() in sample.parts]
        if not name or (not there and self.layout.camera.endswith("?")):
            return None
        return self._shown([self.part(sample, name) for sample in self.unit.samples], name)


def shown(where: str, blobs: Sequence[Blob], part: str) -> Frames:
    """Frames of pictures, arrays or a video.

    Args:
        where: Name of the frames, for messages.
        blobs: Their contents: a video, or pictures or arrays.
        part: Name of the part.

    Raises:
        DataError: A part holds something else, or cannot be read.
    """
    kind = kind_of(part)
    if kind in VIDEOS:
        return TarVideo(where, blobs[0])
    if kind == "npy":
        return ArrayRows(where, blobs)
    for number, blob in enumerate(blobs):
        # told here, by name: the decoder would say so in the middle of training
        start = Blob(blob.path, blob.offset, min(12, blob.size)).read()
        if not start.startswith(_STARTS):
            frame = f", frame {number}" if len(blobs) > 1 else ""
            raise DataError(
                f"{where}{frame}: no picture, it starts with {start[:4]!r}; write it again"
            )
    return EncodedFrames(where, blobs)
