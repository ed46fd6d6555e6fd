"""From frame to force: latency of `tactileforge live` at 30 Hz, and number of skipped frames.

A synthetic camera of 320 x 240 returns a picture every 1/30 s, in the reading thread of live. The
encoders are AnyTouch 2's with random weights, as fast as trained ones: ``tiny`` is that of
``anytouch2.tiny`` (64 pixels, 4 blocks), ``small`` and ``base`` take 224 pixels. ``--model NAME``
times a model of the zoo. ``--page`` adds a viewer: requests of the page's state and pictures
twenty times a second.
"""

from __future__ import annotations

import argparse
import threading
import time
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any, Self

import numpy as np
import torch
from common import save
from tactileforge_live.server import LivePage
from tactileforge_live.session import LiveOptions, LiveSession, ShowBackground

import tactileforge
from tactileforge.contracts import Frame, SensorSpec
from tactileforge.encoders import TactileViT
from tactileforge.heads import ForceHead
from tactileforge.hub import Model, make_header
from tactileforge.specs import spec

FPS = 30.0
ENCODERS: dict[str, dict[str, Any]] = {
    "tiny": {"size": "tiny", "depth": 4, "image_size": 64},
    "small": {"size": "small", "image_size": 224},
    "base": {"size": "base", "image_size": 224},
}


class SyntheticCamera:
    """Pictures of a moving spot with noise, each at its time; late ones are lost."""

    def __init__(self) -> None:
        self.spec = SensorSpec(
            name="digit",
            height=320,
            width=240,
            fps=FPS,
            area_mm=None,
            force_scale=spec("digit").force_scale,
        )
        rng = np.random.default_rng(0)
        rows, columns = np.mgrid[:320, :240]
        self.pictures = []
        for angle in np.linspace(0, 2 * np.pi, 30, endpoint=False):
            far = (rows - 160 - 60 * np.sin(angle)) ** 2 + (columns - 120 - 60 * np.cos(angle)) ** 2
            shade = 110 + 60 * np.exp(-far / 800)[..., None] + rng.normal(0, 2, (320, 240, 3))
            self.pictures.append(shade.clip(0, 255).astype(np.uint8))
        self.start, self.number, self.lost = 0.0, 0, 0

    def discover(self) -> list[str]:
        """Returns an empty list: there is no device."""
        return []

    def open(self) -> None:
        """Starts the clock."""
        self.start, self.number = time.monotonic(), 0

    def read(self, timeout: float = 1.0) -> Frame:
        """The next frame, after a wait for its time; overdue ones are skipped."""
        late = int((time.monotonic() - self.start) * FPS) - self.number
        if late > 0:
            self.number += late
            self.lost += late
        due = self.start + self.number / FPS
        time.sleep(max(0.0, due - time.monotonic()))
        self.number += 1
        return Frame(array=self.pictures[self.number % len(self.pictures)], time=due)

    def close(self) -> None:
        """Does nothing."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def random_model(name: str) -> Model:
    """An untrained model of a size."""
    node = {"name": "tactile_vit", **ENCODERS[name]}
    torch.manual_seed(0)
    encoder = TactileViT(**ENCODERS[name])
    head = ForceHead(encoder).eval()
    entry = {"node": {"name": "force"}, "scale": {"digit": list(spec("digit").force_scale)}}
    header = make_header(
        encoder,
        node,
        licence="CC0-1.0",
        spacing=1 / 15,
        name=f"random {name}",
        recipe={"encoder": node},
        heads={"force": entry},
    )
    encoder.requires_grad_(False)
    return Model(encoder, header, heads={"force": head.requires_grad_(False)})


def look(url: str, stop: threading.Event) -> None:
    """Requests the page's data like a browser, until ``stop``."""
    while not stop.wait(0.05):
        for what in ("state", "frame/camera", "difference/camera"):
            with urllib.request.urlopen(url + what, timeout=10) as answer:
                answer.read()


def run(model: Model, seconds: float, with_page: bool) -> dict[str, float]:
    """Latency and counts of one model."""
    camera = SyntheticCamera()
    options = LiveOptions(background=ShowBackground(seconds=0.0), seconds=seconds)
    latencies: list[float] = []
    with ExitStack() as stack:
        view = stack.enter_context(LiveSession({"camera": camera}, model, options))
        view.take_background()
        clip = np.zeros((model.frames, 64, 64, 3), np.uint8)
        model.readings(clip, "first", "digit")  # warm-up
        stop = threading.Event()
        if with_page:
            page = stack.enter_context(LivePage(view))
            viewer = threading.Thread(target=look, args=(page.url, stop))
            viewer.start()
            stack.callback(viewer.join)
            stack.callback(stop.set)
        for reading in view.readings():
            if reading is not None:
                assert reading.force is not None
                latencies.append(reading.latency)
        stream = view.fingers["camera"].stream
        counts = {"readings": stream.done, "skipped": stream.skipped, "lost": camera.lost}
    milli = 1000 * np.array(latencies)
    p50, p99 = np.percentile(milli, [50, 99])
    return {
        "p50_ms": round(float(p50), 2),
        "p99_ms": round(float(p99), 2),
        "max_ms": round(float(milli.max()), 2),
        "seconds": seconds,
        **counts,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0, help="of each encoder")
    parser.add_argument("--encoders", nargs="*", default=list(ENCODERS), choices=list(ENCODERS))
    parser.add_argument("--model", nargs="*", default=[], help="NAME.TAG, or file:PATH, as well")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--page", action="store_true", help="look at the page meanwhile")
    parser.add_argument("--name", default="live", help="of the result")
    words = parser.parse_args()
    torch.set_num_threads(words.threads)
    models: dict[str, Callable[[], Model]] = {
        name: partial(random_model, name) for name in words.encoders
    }
    models |= {name: partial(tactileforge.load, name) for name in words.model}
    found = {name: run(make(), words.seconds, words.page) for name, make in models.items()}
    result: dict[str, Any] = {"fps": FPS, "frame": "320 x 240", "page": words.page}
    save(words.name, result | {"models": found})


if __name__ == "__main__":
    main()
