import threading
import time
from collections import deque

import numpy as np
import pytest

from tactileforge.contracts import Frame, SensorSpec
from tactileforge.errors import TactileForgeError
from tactileforge.live.options import Background, Options


class Scripted:
    """A sensor in real time that does what a test wants; its picture says which frame it is.

    Args:
        fps: Frames a second.
        limit: Frames until its source is over.
        events: What happens instead of a frame, by its number: an exception, or a function that
            changes the frame.
        type: Name of its spec.
        address: Which device it is.
        moves: Whether its picture changes much from frame to frame.
    """

    shape = (24, 32)

    def __init__(
        self, fps=50.0, limit=None, events=None, type="digit", address="", moves=False, kind="image"
    ):
        height, width = (0, 0) if kind == "wrench" else self.shape
        self.spec = SensorSpec(
            name=type,
            height=height,
            width=width,
            fps=fps,
            area_mm=None,
            force_scale=(1.0, 1.0, 1.0),
            kind=kind,
        )
        self.limit, self.events, self.address = limit, dict(events or {}), address
        self.moves = moves
        self.count, self.opened = 0, 0
        self.times = []
        self.is_open = False
        self.refuse = deque()

    def discover(self):
        return []

    def open(self):
        if self.refuse:
            raise self.refuse.popleft()
        self.is_open = True
        self.opened += 1
        self.start, self.first = time.monotonic(), self.count

    def read(self, timeout=1.0):
        if not self.is_open:
            raise TactileForgeError("not open")
        number, self.count = self.count, self.count + 1
        if self.limit is not None and number >= self.limit:
            raise EOFError
        due = self.start + (number - self.first) / self.spec.fps
        time.sleep(max(0.0, due - time.monotonic()))
        frame = Frame(array=self.picture(number), time=due, raw=self.raw(number, due))
        event = self.events.pop(number, None)
        if isinstance(event, Exception):
            raise event
        frame = event(frame) if event else frame
        self.times.append(frame.time)
        return frame

    def picture(self, number):
        """Numbers up to 255 as brightness in steps of one, with noise below."""
        if self.spec.kind == "wrench":
            return np.zeros((0, 0, 3), np.uint8)
        rng = np.random.default_rng(number)
        base = number % 200 + 30 if self.moves else 120
        return rng.integers(base, base + 3, (*self.shape, 3)).astype(np.uint8)

    def raw(self, number, due):
        if self.spec.kind == "image":
            return None
        if self.spec.kind == "wrench":
            return np.array([due - 1000.0, 0, 1, 0, 0, 0], np.float32)
        return np.full((4, 1), number, np.float32)

    def close(self):
        self.is_open = False

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *error):
        self.close()


@pytest.fixture
def scripted():
    return Scripted


@pytest.fixture
def options(tmp_path):
    """Options for a take of a second without a background."""

    def make(**given):
        defaults = {
            "out": str(tmp_path / "out"),
            "seconds": 0.6,
            "segment": 0.2,
            "pause": 0.0,
            "background": Background(seconds=0.0),
            "codec": "png",
        }
        return Options(**(defaults | given))

    return make


@pytest.fixture(autouse=True)
def _no_thread_is_left():
    yield
    end = time.monotonic() + 5
    while any(t.name.startswith(("capture", "encode")) for t in threading.enumerate()):
        assert time.monotonic() < end, [t.name for t in threading.enumerate()]
        time.sleep(0.02)
