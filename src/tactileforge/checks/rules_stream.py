"""Checks of running sensors: TF601 to TF699."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.check import Check, Examples, Watch
from tactileforge.checks.codes import CODES
from tactileforge.checks.made import COUNT, FPS, made_touch, press, resting
from tactileforge.contracts import Frame, SensorSpec
from tactileforge.sensors.clock_lag import ClockLag
from tactileforge.sensors.health import FROZEN_AFTER, TROUBLES, FrozenPictures, exposure_trouble
from tactileforge.sensors.picture_changes import CHANGES, PictureChanges
from tactileforge.sensors.stuck_values import StuckValues
from tactileforge.specs.published import spec

_STREAM = frozenset({"stream"})
#: Trouble of a frame that is dropped: it is the one before again.
FROZEN = "frozen"
_EXPOSURES = ("black", "saturated")


def _film(edit: Callable[[NDArray[np.uint8]], object] | None = None) -> list[Frame]:
    frames = made_touch(edit=edit).frames.read(range(COUNT))
    return [Frame(array=frame, time=i / FPS) for i, frame in enumerate(frames)]


def _of_camera(spec: SensorSpec, watch: Watch) -> Watch | None:
    return watch if spec.kind == "image" else None


def _examples(edit: Callable[[NDArray[np.uint8]], object]) -> Examples:
    return Examples(_film(), _film(edit), spec("digit"))


class FrozenStream(Check):
    """The same picture for a second."""

    code, level, needs = CODES["frozen_stream"], "error", _STREAM
    title = "The sensor has frozen"
    why = (
        f"The same picture comes for {FROZEN_AFTER:g} s; the noise of a live sensor makes any two "
        "frames differ."
    )
    fix = TROUBLES["frozen"]
    troubles: ClassVar[Mapping[str, str]] = {FROZEN: TROUBLES["frozen"]}

    def watch(self, spec: SensorSpec) -> Watch | None:
        """See `Check.watch`; arrays may repeat themselves at rest."""
        pictures = FrozenPictures()
        return _of_camera(spec, lambda frame, _: FROZEN if pictures.look(frame) else "")

    @staticmethod
    def examples() -> Examples:
        """The camera stops in the middle."""
        return _examples(lambda frames: frames.__setitem__(slice(31, 75), frames[30]))


class ExposureOfStream(Check):
    """Black or saturated pictures."""

    code, level, needs = CODES["exposure_of_stream"], "error", _STREAM
    title = "Pictures are black or saturated"
    why = "Where a picture is black or white, touch leaves no trace."
    fix = f"{TROUBLES['black']}; {TROUBLES['saturated']}"
    troubles: ClassVar[Mapping[str, str]] = {name: TROUBLES[name] for name in _EXPOSURES}

    def watch(self, spec: SensorSpec) -> Watch | None:
        """See `Check.watch`."""
        return _of_camera(spec, lambda frame, _: exposure_trouble(frame.array))

    @staticmethod
    def examples() -> Examples:
        """The light goes out."""
        return _examples(lambda frames: frames[60:].fill(2))


class ChangedPictures(Check):
    """Pictures that roll, turn, or change their colours."""

    code, level, needs = CODES["changed_pictures"], "error", _STREAM
    title = "Pictures have rolled, turned or changed their colours"
    why = (
        "Undoing the change gives the first picture again: rows begin elsewhere, the picture is "
        "turned or mirrored, or channels are exchanged or dead."
    )
    fix = "; ".join(CHANGES.values())
    troubles = CHANGES

    def watch(self, spec: SensorSpec) -> Watch | None:
        """See `Check.watch`."""
        changes = PictureChanges()
        return _of_camera(spec, lambda frame, _: changes.look(frame))

    @staticmethod
    def examples() -> Examples:
        """The picture is mirrored from the middle on."""

        def mirrored(frames: NDArray[np.uint8]) -> None:
            frames[45:] = frames[45:, :, ::-1].copy()

        return _examples(mirrored)


class ClockOfStream(Check):
    """Late or early times, and slow or fast clocks."""

    code, level, needs = CODES["clock_of_stream"], "error", _STREAM
    title = "The clock of the sensor is off"
    why = "Its times are a second late, ahead of the clock, or grow slower or faster than seconds."
    fix = "give the sensor the clock of this machine, or leave its own times out"

    def watch(self, spec: SensorSpec) -> Watch | None:
        """See `Check.watch`."""
        lag, words = ClockLag(), ""

        def say(frame: Frame, arrived: float) -> str:
            nonlocal words
            if lag.add(frame.time, arrived):
                words = lag.trouble()
            return words

        return say

    @staticmethod
    def examples() -> Examples:
        """A clock of 24 seconds in 30."""
        sensor = spec("digit")
        still = np.asarray(resting(), np.uint8)
        times = np.arange(300) / sensor.fps
        good = [Frame(array=still, time=float(time)) for time in times]
        bad = [Frame(array=still, time=0.8 * float(time)) for time in times]
        return Examples(good, bad, sensor)


class StuckForces(Check):
    """A sensor of force with one and the same value."""

    code, level, needs = CODES["stuck_values"], "error", _STREAM
    title = "The sensor of force is stuck"
    why = "Strain gauges have noise: samples that are equal on six axes were not measured."
    fix = "is it still measuring? plug it out and in"

    def watch(self, spec: SensorSpec) -> Watch | None:
        """See `Check.watch`."""
        stuck = StuckValues(spec)

        def say(frame: Frame, _: float) -> str:
            stuck.look(frame)
            return stuck.trouble()

        return say if spec.kind == "wrench" else None

    @staticmethod
    def examples() -> Examples:
        """It stops after a second."""
        sensor = SensorSpec(
            name="wrench",
            height=0,
            width=0,
            fps=100,
            area_mm=None,
            force_scale=(1.0, 1.0, 1.0),
            kind="wrench",
        )
        noise = np.random.default_rng(0).normal(0, 0.01, (600, 6)).astype(np.float32)
        noise[:, 2] += np.float32(4) * press(600).astype(np.float32)
        film = np.zeros((0, 0, 3), np.uint8)
        rows = np.arange(600)
        good = [Frame(array=film, time=i / 100, raw=noise[i]) for i in rows]
        bad = [Frame(array=film, time=i / 100, raw=noise[min(int(i), 100)]) for i in rows]
        return Examples(good, bad, sensor)
