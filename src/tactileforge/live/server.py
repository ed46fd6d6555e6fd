"""Server of the live page: on this machine only, protected by a token."""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self
from urllib.parse import parse_qsl, unquote, urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.depth import depth_image
from tactileforge.errors import ConfigError
from tactileforge.live.page import page_html
from tactileforge.live.publish import to_json
from tactileforge.live.sensor_stream import Reading, SensorStream
from tactileforge.live.session import LiveSession, check_port
from tactileforge.markers.motion import draw_arrows

#: Largest length of the longer side of an image on the page, pixels; small images are enlarged by
#: the largest whole factor to at most half of it.
_LARGE = 480
#: Amplification of differences, for visibility.
_GAIN = 2.0
#: Pictures of a sensor.
_PICTURES = ("frame", "difference", "depth", "markers")
#: Time after which a silent connection is closed, s.
_SILENCE = 10.0
_HOST = "127.0.0.1"


class LivePage:
    """Serves a `LiveSession` while it is open.

    The address contains a random token. A request without it is refused, and so is one for a
    different host (DNS rebinding by a web site). Images are encoded only on request.

    Args:
        view: Open session.
        port: Port at 127.0.0.1; 0 for any free one.

    Attributes:
        token: Token in the address.

    Raises:
        ConfigError: The port is taken or invalid.
    """

    def __init__(self, view: LiveSession, port: int = 0) -> None:
        check_port(port)
        self.token = secrets.token_urlsafe(18)
        handler = type("Handler", (_Handler,), {"view": view, "token": self.token})
        try:
            self._server = _Server((_HOST, port), handler)
        except OSError as error:
            raise ConfigError(f"port={port}: {error.strerror}; give another, or 0") from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{_HOST}:{self._server.server_address[1]}/{self.token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(5.0)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores errors of disconnecting browsers."""


class _Handler(BaseHTTPRequestHandler):
    view: LiveSession
    token: str
    protocol_version = "HTTP/1.1"
    # head and body are two writes: with Nagle's algorithm the second would wait for an
    # acknowledgement of the first
    disable_nagle_algorithm = True
    timeout = _SILENCE

    def do_GET(self) -> None:
        """Answers a request."""
        url = urlsplit(self.path)
        token, _, rest = url.path.lstrip("/").partition("/")
        port = self.server.server_address[1]  # type: ignore[index]
        hosts = (f"{_HOST}:{port}", f"localhost:{port}")
        # compared in constant time, so that response times tell nothing about the token
        good = hmac.compare_digest(token.encode(), self.token.encode())
        if not good or self.headers.get("Host") not in hosts:
            self._answer(403, "text/plain", b"give the whole address that the command printed\n")
            return
        what, _, name = rest.partition("/")
        if rest == "":
            nonce = secrets.token_urlsafe(12)
            self._answer(200, "text/html; charset=utf-8", page_html(nonce).encode(), nonce)
        elif rest == "state":
            content = page_state(self.view, dict(parse_qsl(url.query)))
            self._answer(200, "application/json", to_json(content).encode())
        elif what in _PICTURES and unquote(name) in self.view.fingers:
            self._picture(self.view.fingers[unquote(name)], what)
        else:
            self._answer(404, "text/plain", b"no such thing\n")

    def _picture(self, finger: SensorStream, what: str) -> None:
        shown = finger.stream.shown
        if shown is None:
            self._answer(404, "text/plain", b"no frame yet\n")
            return
        array = shown.array
        if what == "difference" and finger.stream.background is not None:
            array = difference_image(array, finger.stream.background)
        elif what == "depth":
            depth = finger.readings[-1].depth if finger.readings else None
            if depth is None:
                self._answer(404, "text/plain", b"no depth\n")
                return
            array = depth_image(depth)
        elif what == "markers":
            last = finger.readings[-1] if finger.readings else None
            if last is None or last.markers is None or finger.tracker is None:
                self._answer(404, "text/plain", b"no markers\n")
                return
            array = draw_arrows(array, finger.tracker.grid.places, last.markers)
        self._answer(200, "image/jpeg", page_jpeg(array))

    def _answer(self, status: int, kind: str, body: bytes, nonce: str = "") -> None:
        self.send_response(status)
        policy = "default-src 'none'; img-src 'self' blob: data:; connect-src 'self'; "
        policy += f"style-src 'nonce-{nonce}'; script-src 'nonce-{nonce}'"
        for key, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("Content-Security-Policy", policy),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
        ):
            self.send_header(key, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Logs nothing, since the terminal shows the status line."""


def page_state(view: LiveSession, after: Mapping[str, str]) -> dict[str, Any]:
    """State of the page, as plain data.

    Args:
        view: Open session.
        after: Monotonic times, s, by sensor, as text; only later readings are included. Each sensor
            has its own time, because latencies differ.
    """
    seen = {name: _seconds(after.get(name, "")) for name in view.fingers}
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


def _seconds(text: str) -> float:
    return float(text) if text.replace(".", "", 1).isdigit() else 0.0


def _of(finger: SensorStream, after: float, now: float) -> dict[str, Any]:
    shown = finger.stream.shown
    return {
        "type": finger.sensor.spec.name,
        "state": finger.state,
        "fps": round(finger.capture.fps, 1),
        "skipped": finger.stream.skipped,
        "age": None if shown is None else round(now - shown.time, 3),
        "picture": 0 if shown is None else shown.time,
        "size": [finger.sensor.spec.height, finger.sensor.spec.width],
        "scale": list(finger.sensor.spec.force_scale),
        "depth": finger.depth is not None,
        "markers": finger.tracker is not None,
        "contact_on": finger.stream.contact.options.begin,
        "readings": [
            [r.time, r.force, r.contact, r.slip, round(r.difference, 2), _deepest(r), _motion(r)]
            for r in list(finger.readings)
            if r.time > after
        ],
    }


def _deepest(reading: Reading) -> float | None:
    return None if reading.depth is None else round(float(reading.depth.max()), 2)


def _motion(reading: Reading) -> dict[str, Any] | None:
    return None if reading.motion is None else reading.motion.message()


def difference_image(image: NDArray[np.uint8], background: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Difference of image and background, amplified twice, around mid-grey; uint8 (H, W, 3)."""
    if image.shape != background.shape:
        return image
    change = image.astype(np.float32) - background
    return np.asarray((128 + _GAIN * change).clip(0, 255), np.uint8)


def page_jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encodes an RGB image as JPEG, resized to fit the page."""
    longest = max(image.shape[:2])
    if longest > _LARGE:
        factor, how = _LARGE / longest, cv2.INTER_AREA
    else:
        factor, how = max(1, _LARGE // (2 * longest)), cv2.INTER_NEAREST
    sized = cv2.resize(image, None, fx=factor, fy=factor, interpolation=how)
    good, data = cv2.imencode(".jpg", cv2.cvtColor(sized, cv2.COLOR_RGB2BGR))
    assert good  # an image in memory can be written
    return bytes(data.tobytes())
