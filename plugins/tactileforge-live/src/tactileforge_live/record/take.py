"""One take of a recording, from its background to its shard."""

from __future__ import annotations

import math
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tactileforge_markers.find import MarkerGrid
from tactileforge_markers.tracks import marker_labels, marker_tracks

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data import ArrayFrames, Packed, describe_recording
from tactileforge.errors import DataError, SensorError, TactileForgeError
from tactileforge.sensors import check_captures, unit_of
from tactileforge_live.record.frame_queue import FrameQueue, PendingFrame
from tactileforge_live.record.raw import Raw
from tactileforge_live.record.rig import Rig, RigSensor
from tactileforge_live.record.samples import SegmentSamples, robot_tracks
from tactileforge_live.record.status import RecordStatus, RecordSummary
from tactileforge_live.record.store import TakeStore
from tactileforge_live.record.wrench import GAP, interpolate_samples, rotate_wrenches

#: Longest delay of frames, s; a segment is then written without them, and they go into the next.
_LATE = 2.0
#: Further tries of a background between two takes, until everything is lifted off.
_TRIES = 5
#: Period of the loop, s.
_TICK = 0.05
#: Frames of a recording that is described alone; its pictures are encoded already.
_NO_FRAMES = ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8))


class Take:
    """One take of a recording.

    Args:
        rig: Open sensors.
        store: Store of the segments.
        matrices: Rotations from the axes of the wrench sensor to those of each gel, by sensor.
        known: Labels of calibrations, by sensor.
        summary: Totals of the recording, updated in place.
        say: Function for messages to the user, one line each.
        status: Status line; None for none.
    """

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
        others = [device for device in (rig.force, rig.robot) if device is not None]
        self._samples = {device.name: SegmentSamples(device) for device in others}
        self.begun = datetime.now(UTC).isoformat(timespec="seconds")

    def run(self, stop: threading.Event) -> None:
        """Records the take.

        Raises:
            SensorError: A sensor is lost; earlier data is written.
            TactileForgeError: The disk has less free space than ``min_free_gb``; data is written.
            OSError: The disk is full; earlier segments are safe.
        """
        if self.options.background.seconds:
            self.say("background: nothing may touch the sensors")
        self._take_background()
        self.start = self.saved = time.monotonic()
        self.end = self.start + (self.options.seconds or math.inf)
        self.rig.start(self.start, self.end)
        self.say(f"take {self.number}: recording" + " until Ctrl-C" * (not self.options.seconds))
        try:
            self._run(stop)
            error = None
        except TactileForgeError as lost:
            error = lost
        self._finish()  # writes what came before the error
        if error is not None:
            raise error

    def _take_background(self) -> None:
        """Takes the background; after the first take, waits for the sensor to be lifted."""
        for _ in range(_TRIES if self.summary.takes else 0):
            try:
                return self.rig.take_background()
            except SensorError as error:
                self.rig.check()  # a lost sensor does not come back by waiting
                self.say(f"{error}; trying again")
        self.rig.take_background()

    def _run(self, stop: threading.Event) -> None:
        while time.monotonic() < self.end and not self.rig.is_over and not stop.wait(_TICK):
            self.rig.check()
            due = self.saved + self.options.segment
            late = time.monotonic() - due > _LATE
            if due < self.end and (late or (time.monotonic() > due and self.rig.has_passed(due))):
                self._save(due)
                free = shutil.disk_usage(self.store.out).free
                if free < self.options.min_free_gb * 1e9:
                    raise TactileForgeError(
                        f"{self.store.out}: {free / 1e9:.2f} GB are left on the disk, min_free_gb="
                        f"{self.options.min_free_gb}; the take has ended, and what was recorded is "
                        "safe"
                    )
            if self.status is not None:
                self.status.show(self.rig, self.number, time.monotonic() - self.start, self.summary)
        check_captures([device.capture for device in self.rig.all], at_end=True)

    def _finish(self) -> None:
        """Writes the remaining frames and joins the segments."""
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
            if findings := device.checks.findings():
                self.summary.findings[device.name] = findings
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
        """Writes all data before a time as one segment."""
        rig, shots = self.rig, {}
        for device in rig.devices:
            assert isinstance(device.keeps, FrameQueue)
            shots[device.name] = device.keeps.cut(until)
        begun, self.saved = self.saved, until
        if not any(shots.values()):  # all sensors are lost: forces and views wait for the next one
            return
        views = rig.camera.keeps.cut(until) if rig.camera is not None else []
        raw: dict[str, Raw] = {}
        for name, held in shots.items():
            if held and held[0].raw is not None:
                moments = np.array([shot.time - self.start for shot in held], np.float64)
                raw[name] = moments, np.array([shot.raw for shot in held], np.float32)
        known: dict[str, Raw] = {}
        for name, samples in self._samples.items():
            known[name], (times, values) = samples.cut(until)
            raw[name] = (times - self.start, values)
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

    def _packed(
        self, device: RigSensor, shots: list[PendingFrame], views: Any, known: Mapping[str, Raw]
    ) -> Packed:
        """Recording of one sensor in a segment."""
        options, codec = self.options, self.rig.codec(device)
        times = np.array([shot.time for shot in shots], np.float64)
        tracks = self._tracks(device, times, known)
        force = tracks["wrench"][:, :3] if "wrench" in tracks else None
        if depths := [shot.depth.result() for shot in shots if shot.depth is not None]:
            tracks["depth_um"] = np.stack(depths)
        grid = self._grid(device)
        if grid is not None:
            moved = [shot.markers.result() for shot in shots if shot.markers is not None]
            tracks |= marker_tracks(grid, moved)
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
        return Packed(describe_recording(about), codec, pictures, device.background, seen)

    def _tracks(
        self, device: RigSensor, times: NDArray[np.float64], known: Mapping[str, Raw]
    ) -> dict[str, NDArray[Any]]:
        """Wrenches in the axes of a gel, and the robot's state and actions, at times of frames."""
        rig = self.rig
        tracks: dict[str, NDArray[Any]] = {}
        if rig.force is not None:
            gap = max(GAP, 2 / rig.force.sensor.spec.fps)
            samples = interpolate_samples(times, *known[rig.force.name], gap)
            wrench = samples - rig.force.rest.astype(np.float32)
            tracks["wrench"] = rotate_wrenches(wrench, self.matrices[device.name])
        if rig.robot is not None:
            spec = rig.robot.sensor.spec
            tracks |= robot_tracks(times, known[rig.robot.name], spec.states, 1 / spec.fps)
        return tracks

    def _grid(self, device: RigSensor) -> MarkerGrid | None:
        """Markers of a sensor at rest; None where they are not followed."""
        tracker = device.keeps.tracker if isinstance(device.keeps, FrameQueue) else None
        return None if tracker is None else tracker.grid

    def _labels(self, device: RigSensor) -> dict[str, str | float]:
        counts, checks = device.capture.counts, device.checks
        grid = self._grid(device)
        clock = checks.found.get("clock_of_stream")
        codes = sorted({finding.code for finding in checks.findings()})
        # a take with a robot is an episode of a demonstration
        name = f"{self.store.out.resolve().name}_{self.number:05d}"
        episode = {"episode": name, "finger": device.name} if self.rig.robot is not None else {}
        return {
            **self.options.labels,
            **self.known.get(device.name, {}),
            **episode,
            **({} if grid is None else marker_labels(grid)),
            "take": self.number,
            "segment": self.segments,
            "device": device.name,
            "unit": unit_of(device.sensor),
            "begun": self.begun,
            "clock": self.start,
            "dropped": device.keeps.dropped,
            **checks.counts,
            **device.capture.drops(),
            **({} if clock is None else {"clock_trouble": clock.words}),
            **({"checks": " ".join(codes)} if codes else {}),
            "stalled": counts.stalled,
            "reopened": counts.reopened,
        }
