"""The live page: state and pictures of a session."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactileforge_depth.reader import depth_image
from tactileforge_markers.motion import draw_arrows

from tactileforge.pages import (
    NOT_FOUND,
    LocalPage,
    PageAnswer,
    difference_image,
    page_jpeg,
    to_json,
)
from tactileforge_live.sensor_stream import SensorStream
from tactileforge_live.session import LiveSession

#: Pictures of a sensor.
_PICTURES = ("frame", "difference", "depth", "markers")
#: Page for light and dark, and widths from 400 pixels.
_FILE = Path(__file__).with_name("page.html")


class LivePage(LocalPage):
    """Serves a `LiveSession` while it is open. Images are encoded only on request.

    Args:
        view: Open session.
        port: Port at 127.0.0.1; 0 for any free one.

    Raises:
        ConfigError: The port is taken or invalid.
    """

    def __init__(self, view: LiveSession, port: int = 0) -> None:
        super().__init__(self._get, port=port)
        self._view = view

    def _get(self, path: str, query: Mapping[str, str]) -> PageAnswer:
        what, _, name = path.partition("/")
        if path == "":
            return PageAnswer(_FILE.read_bytes(), "text/html; charset=utf-8")
        if path == "state":
            return PageAnswer(to_json(page_state(self._view, query)).encode(), "application/json")
        if what in _PICTURES and name in self._view.fingers:
            return _picture(self._view.fingers[name], what)
        return NOT_FOUND


def _picture(finger: SensorStream, what: str) -> PageAnswer:
    shown = finger.stream.shown
    if shown is None:
        return PageAnswer(b"no frame yet\n", status=404)
    array = shown.array
    last = finger.readings[-1] if finger.readings else None
    if what == "difference" and finger.stream.background is not None:
        array = difference_image(array, finger.stream.background)
    elif what == "depth":
        if last is None or last.depth is None:
            return PageAnswer(b"no depth\n", status=404)
        array = depth_image(last.depth)
    elif what == "markers":
        if last is None or last.markers is None or finger.tracker is None:
            return PageAnswer(b"no markers\n", status=404)
        array = draw_arrows(array, finger.tracker.grid.places, last.markers)
    return PageAnswer(page_jpeg(array), "image/jpeg")


def page_state(view: LiveSession, after: Mapping[str, str]) -> dict[str, Any]:
    """State of the page, as plain data.

    Args:
        view: Open session.
        after: Monotonic times, s, by sensor, as text; only later readings are included. Each sensor
            has its own time, because latencies differ.
    """
    given = {name: after.get(name, "") for name in view.fingers}
    seen = {
        name: float(text) if text.replace(".", "", 1).isdigit() else 0.0
        for name, text in given.items()
    }
    # NaN, before the first reading, is not JSON
    p50, p99 = (None if x != x else round(1000 * x, 1) for x in view.latency.percentiles())
    now = time.monotonic()
    model = view.model
    return {
        "now": now,
        "model": "" if model is None else model.header.name or model.header.encoder["name"],
        "p50": p50,
        "p99": p99,
        "sensors": {name: _of(f, seen[name], now) for name, f in view.fingers.items()},
    }


def _of(finger: SensorStream, after: float, now: float) -> dict[str, Any]:
    shown, unit = finger.stream.shown, finger.stream.force_unit
    rows = []
    for r in list(finger.readings):  # copied, as readings are added meanwhile
        if r.time > after:
            deepest = None if r.depth is None else round(float(r.depth.max()), 2)
            motion = None if r.motion is None else r.motion.message()
            change = round(r.difference, 2)
            rows.append([r.time, r.force, r.contact, r.slip, change, deepest, motion])
    return {
        "type": finger.sensor.spec.name,
        "state": finger.state,
        "fps": round(finger.capture.fps, 1),
        "skipped": finger.stream.skipped,
        "age": None if shown is None else round(now - shown.time, 3),
        "picture": 0 if shown is None else shown.time,
        "size": [finger.sensor.spec.height, finger.sensor.spec.width],
        "scale": [1.0] * 3 if unit == "relative" else list(finger.sensor.spec.force_scale),
        "unit": unit,
        "depth": finger.depth is not None,
        "markers": finger.tracker is not None,
        "contact_on": finger.stream.contact.options.begin,
        "readings": rows,
    }
