"""Status line with the readings of the sensors."""

from __future__ import annotations

import math
import time

from tactileforge.sensors import Status, of_drops
from tactileforge_live.sensor_stream import SensorStream
from tactileforge_live.session import LiveSession

#: What stands behind the numbers of a force, by its unit.
UNITS = {"N": "N", "relative": "of its scale", "uncalibrated": "N (uncalibrated)"}
#: Time between two lines, s: on a terminal, overwriting the previous line, and elsewhere.
_TERMINAL, _ELSEWHERE = 0.1, 5.0


class LiveStatus(Status):
    """Status line on standard error."""

    def tell(self, view: LiveSession) -> None:
        """Writes the line if it is due."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (_TERMINAL if self._is_terminal else _ELSEWHERE)
        p50, p99 = view.latency.percentiles()
        parts = [f"p50 {1000 * p50:.1f} p99 {1000 * p99:.1f} ms"]
        self._write(" | ".join([*map(stream_status, view.fingers.values()), *parts]))

    def summary(self, view: LiveSession) -> str:
        """Summary for the end of a session."""
        fingers = view.fingers.values()
        streams = [(f.name, f.stream) for f in fingers]
        counts = ", ".join(f"{name} {s.done} (skipped {s.skipped})" for name, s in streams)
        lost = ", ".join(f"{f.name} {n}" for f in fingers if (n := f.capture.counts.reopened))
        dropped = of_drops({f.name: f.capture.drops() for f in fingers})
        p50, p99 = view.latency.percentiles(recent=False)
        waited = "" if math.isnan(p50) else f"; latency p50 {1e3 * p50:.1f} p99 {1e3 * p99:.1f} ms"
        back = f"; came back: {lost}" if lost else ""
        noticed = "".join(f"; noticed: {one}" for f in fingers for one in f.checks.findings())
        return f"readings: {counts}{waited}{back}; dropped: {dropped}{noticed}"


def stream_status(finger: SensorStream) -> str:
    """Status of one sensor: rate, force, contact, slip, and number of skipped frames."""
    state = finger.state
    words = [finger.name]
    if state in ("lost", "frozen") or not finger.readings:
        return f"{finger.name} {state.upper() or 'waits'}"
    reading = finger.readings[-1]
    words.append(f"{finger.capture.fps:.1f} fps")
    if reading.force is not None:
        numbers = " ".join(f"{axis:+.2f}" for axis in reading.force)
        words.append(f"force {numbers} {UNITS[reading.force_unit or 'N']}")
    if reading.trouble:
        words.append(reading.trouble.upper())
    else:
        words.append("contact" if reading.contact else "free   ")
    if reading.slip is not None:
        words.append("SLIP" if reading.slip else "holds")
    words.append(f"skipped {finger.stream.skipped}")
    return " ".join(words)
