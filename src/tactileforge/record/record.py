"""Records several sensors, a wrench sensor and a camera on one clock, straight to shards."""

from __future__ import annotations

import math
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.calibration import file as calibration
from tactileforge.contracts import ACTIONS, Recording, Sensor
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import shards
from tactileforge.errors import ConfigError, DataError, TactileForgeError, unknown
from tactileforge.record.frame_queue import FrameQueue, PendingFrame, WrenchBuffer
from tactileforge.record.options import RecordOptions
from tactileforge.record.raw import Raw
from tactileforge.record.rig import Rig, RigSensor
from tactileforge.record.status import RecordStatus, RecordSummary
from tactileforge.record.store import TakeStore
from tactileforge.record.wrench import axes_matrix, interpolate_wrenches, rotate_wrenches
from tactileforge.sensors.capture import check
from tactileforge.sensors.low_latency_threads import low_latency_threads

#: Seconds that frames may be late before a segment is written without them (the next has them).
_LATE = 2.0
#: Seconds between two looks at everything.
_TICK = 0.05
_NO_FRAMES = ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8))


def record(
    options: RecordOptions,
    sensors: Mapping[str, Sensor],
    force: Sensor | None = None,
    camera: Sensor | None = None,
    stop: threading.Event | None = None,
    say: Callable[[str], None] = print,
    status: RecordStatus | None = None,
) -> RecordSummary:
    """Records takes until there are enough, the sources end, or it is stopped.

    Args:
        options: What and how.
        sensors: Cameras and arrays, by the name of their recordings; not open.
        force: A wrench sensor.
        camera: A camera that looks on.
        stop: Ends it when set; everything until then is written.
        say: Is told what happens, a line at a time.
        status: Shows how it goes; None for silence.

    Raises:
        SensorError: A sensor cannot be opened, is lost, or is touched while the background is
            taken. What was recorded before is kept.
        ConfigError: The folder holds something else, or the sensors do not fit.
        TactileForgeError: The disk is full; says what is safe.
    """
    stop = stop or threading.Event()
    summary = RecordSummary(0, 0.0, dict.fromkeys(sensors, 0), {}, 0)
    matrices = {name: axes_matrix(_axes(options, name)) for name in sensors}
    try:
        with (
            low_latency_threads(),
            TakeStore(Path(options.out), options.split) as store,
            Rig(sensors, force, camera, options) as rig,
        ):
            for line in store.notes:
                say(line)
            known = _calibrations(rig)
            count = 0
            while not stop.is_set() and not rig.is_over and count != options.takes:
                if count and stop.wait(options.pause):
                    break
                _Take(rig, store, matrices, known, summary, say, status).run(stop)
                count += 1
    except OSError as error:
        raise TactileForgeError(
            f"{options.out}: cannot be written ({error.strerror or error}). {summary.seconds:.1f} "
            "s of touch are safe; make room, and record again into the same folder"
        ) from error
    return summary


def _axes(options: RecordOptions, name: str) -> Any:
    given = options.axes
    return given.get(name, ("x", "y", "z")) if isinstance(given, Mapping) else given


def _calibrations(rig: Rig) -> dict[str, dict[str, str]]:
    """Calibration labels of the sensors that have one.

    Raises:
        DataNotFoundError: There is no such file.
        ConfigError: It is wrong, or of another unit; or no sensor has that name.
    """
    given = rig.options.calibration
    devices = {device.name: device.sensor for device in rig.devices}
    if strange := sorted(set(given) - set(devices)):
        raise ConfigError(unknown("sensor of calibration", strange[0], devices))
    return {
        name: calibration.calibration_labels(path, devices[name].spec.name, _unit(devices[name]))
        for name, path in given.items()
    }


def _unit(sensor: Sensor) -> str:
    return str(getattr(sensor, "address", ""))


class _Take:
    """One take, from its background to its shard."""

    def __init__(
        self,
        rig: Rig,
        store: TakeStore,
        matrices: Mapping[str, NDArray[np.float64]],
        known: Mapping[str, Mapping[str, str]],
        summary: RecordSummary,
        say: Callable[[str], None],
        status: RecordStatus | None,
    ) -> None:
        self.rig, self.store, self.matrices = rig, store, matrices
        self.known = known
        self.summary, self.say, self.status = summary, say, status
        self.options = rig.options
        self.number = store.new_take()
        self.segments = 0
        self.saved = self.start = self.end = 0.0
        #: The last sample that was written.
        self._last: Raw = (np.empty(0), np.empty((0, 6), np.float32))
        self.begun = datetime.now(UTC).isoformat(timespec="seconds")

    def run(self, stop: threading.Event) -> None:
        """Records the take.

        Raises:
            SensorError: A sensor is lost; what came before is written.
            OSError: The disk is full; segments written before are safe.
        """
        if self.options.background.seconds:
            self.say("background: nothing may touch the sensors")
        self.rig.take_background()
        self.start = self.saved = time.monotonic()
        self.end = self.start + (self.options.seconds or math.inf)
        self.rig.start(self.start, self.end)
        self.say(f"take {self.number}: recording" + " until Ctrl-C" * (not self.options.seconds))
        try:
            self._run(stop)
            error = None
        except TactileForgeError as lost:
            error = lost
        self._finish()
        if error is not None:
            raise error

    def _run(self, stop: threading.Event) -> None:
        while time.monotonic() < self.end and not self.rig.is_over and not stop.wait(_TICK):
            self.rig.check()
            due = self.saved + self.options.segment
            late = time.monotonic() - due > _LATE
            if due < self.end and (late or (time.monotonic() > due and self.rig.has_passed(due))):
                self._save(due)
                self._check_room()
            if self.status is not None:
                self.status.show(self.rig, self.number, time.monotonic() - self.start, self.summary)
        check([device.capture for device in self.rig.all], at_end=True)

    def _check_room(self) -> None:
        free = shutil.disk_usage(self.store.out).free
        if free < self.options.min_free_gb * 1e9:
            raise TactileForgeError(
                f"{self.store.out}: {free / 1e9:.2f} GB are left on the disk, min_free_gb="
                f"{self.options.min_free_gb}; the take has ended, and what was recorded is safe"
            )

    def _finish(self) -> None:
        """Writes the remaining frames, and joins the segments."""
        end = min(time.monotonic(), self.end)
        patience = time.monotonic() + _LATE
        while not self.rig.has_passed(end) and time.monotonic() < patience:
            time.sleep(_TICK)
        self.rig.stop()
        self._save(end)
        for device in self.rig.all:
            dropped = self.summary.dropped
            dropped[device.name] = dropped.get(device.name, 0) + device.keeps.dropped
            late = {"late": dropped[device.name]}
            self.summary.reasons[device.name] = late | device.capture.drops()
        if not self.segments:
            self.say(f"take {self.number}: nothing came")
            return
        self.summary.takes += 1
        if self.options.join:
            try:
                self.store.join(self.number)
            except DataError as error:
                self.say(f"take {self.number} stays in {self.segments} segments: {error}")
        self.say(f"take {self.number}: {end - self.start:.1f} s")

    def _save(self, until: float) -> None:
        """Writes everything before a time as one segment."""
        rig, shots = self.rig, {}
        for device in rig.devices:
            assert isinstance(device.keeps, FrameQueue)
            shots[device.name] = device.keeps.cut(until)
        begun, self.saved = self.saved, until
        if not any(shots.values()):  # all are lost: forces and views wait for the next segment
            return
        views = rig.camera.keeps.cut(until) if rig.camera is not None else []
        raw = {name: _raw(held, self.start) for name, held in shots.items() if _has_raw(held)}
        known = self._wrenches(until, raw)
        packed = [
            self._packed(device, shots[device.name], views, known)
            for device in rig.devices
            if shots[device.name]
        ]
        entry = self.store.write(self.number, self.segments, packed, raw)
        self.segments += 1
        self.summary.bytes += entry.bytes
        self.summary.seconds += until - begun
        for name, held in shots.items():
            self.summary.frames[name] += len(held)

    def _wrenches(self, until: float, raw: dict[str, Raw]) -> Raw | None:
        """Removes the samples of a segment and returns them with their neighbours."""
        if self.rig.force is None:
            return None
        keeps = self.rig.force.keeps
        assert isinstance(keeps, WrenchBuffer)
        later, values = keeps.all()
        times, wrenches = keeps.cut(until)
        raw[self.rig.force.name] = (times - self.start, wrenches)
        before, rest = self._last
        self._last = (times[-1:], wrenches[-1:]) if len(times) else self._last
        return np.concatenate([before, later]), np.concatenate([rest, values])

    def _packed(
        self, device: RigSensor, shots: list[PendingFrame], views: Any, known: Raw | None
    ) -> shards.Packed:
        """One sensor's part of a segment."""
        options, codec = self.options, self.rig.codec(device)
        times = np.array([shot.time for shot in shots], np.float64)
        force, tracks = None, {}
        if known is not None and self.rig.force is not None:
            wrench = interpolate_wrenches(times, *known) - self.rig.force.rest.astype(np.float32)
            tracks["wrench"] = rotate_wrenches(wrench, self.matrices[device.name])
            force = tracks["wrench"][:, :3]
        action = None
        if options.action is not None:
            action = np.full(len(shots), ACTIONS.index(options.action), np.int64)
        about = Recording(
            key=f"{self.store.out.resolve().name}/{self.number:06d}/{device.name}/{self.segments:04d}",
            sensor=device.sensor.spec.name,
            frames=_NO_FRAMES,
            times=times - self.start,
            no_contact=None,
            force=force,
            action=action,
            object=options.object,
            text=options.text,
            image_times=np.array([v.time for v in views]) - self.start if views else None,
            labels=self._labels(device),
            tracks=tracks,
            source=options.source,
            tier=options.tier or (1 if force is not None else 2 if action is None else 3),
            licence=options.licence,
        )
        pictures = [shot.encoded.result()[codec] for shot in shots]
        seen = [view.encoded.result()[codec] for view in views]
        return shards.Packed(
            shards.describe_recording(about), codec, pictures, device.background, seen
        )

    def _labels(self, device: RigSensor) -> dict[str, str | float]:
        counts = device.capture.counts
        return {
            **self.options.labels,
            **self.known.get(device.name, {}),
            "take": self.number,
            "segment": self.segments,
            "device": device.name,
            "unit": _unit(device.sensor),
            "begun": self.begun,
            "clock": self.start,
            "dropped": device.keeps.dropped,
            **device.capture.drops(),
            "stalled": counts.stalled,
            "reopened": counts.reopened,
        }


def _has_raw(shots: list[PendingFrame]) -> bool:
    return bool(shots) and shots[0].raw is not None


def _raw(shots: list[PendingFrame], start: float) -> Raw:
    times = np.array([shot.time - start for shot in shots], np.float64)
    return times, np.array([shot.raw for shot in shots], np.float32)
