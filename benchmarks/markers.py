"""Markers followed through simulated touches: error against their true motion, and frames a second.

Peers, from OpenCV, start from the same markers at rest: `SimpleBlobDetector` in each frame with the
nearest blob to each marker, and the optical flow of Lucas and Kanade from frame to frame. One
thread; CPU time.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import torch
from common import save
from marker_truth import simulated
from numpy.typing import NDArray
from tactileforge_markers.find import MarkerGrid, find_markers
from tactileforge_markers.track import MarkerTracker

#: Gels with printed dots; each seed is another unit, touched another way.
SENSORS = ("gelsight_mini", "gelsight", "gelslim", "duragel")

Film = NDArray[np.uint8]
Follow = Callable[[Film, MarkerGrid], NDArray[np.float64]]


def ours(frames: Film, grid: MarkerGrid) -> NDArray[np.float64]:
    """Displacements by the tracker, (T, N, 2), pixels."""
    tracker = MarkerTracker(frames[0])
    return np.stack([tracker.read(frame) for frame in frames]).astype(np.float64)


def blobs(frames: Film, grid: MarkerGrid) -> NDArray[np.float64]:
    """Displacements by blobs: each marker takes the blob nearest to its last place."""
    options = cv2.SimpleBlobDetector.Params()
    options.filterByArea, options.minArea = True, 0.3 * np.pi * grid.radius**2
    options.maxArea = 3 * np.pi * grid.radius**2
    options.filterByCircularity = options.filterByConvexity = options.filterByInertia = False
    options.minDistBetweenBlobs = 0.4 * grid.pitch
    detector = cv2.SimpleBlobDetector.create(options)
    last, out = grid.places, []
    for frame in frames:
        found = np.array([key.pt for key in detector.detect(_grey(frame))], np.float64)
        at = np.full_like(last, np.nan)
        if len(found):
            apart = np.hypot(*(last[:, None] - found).transpose(2, 0, 1))
            near = apart.min(1) < 0.5 * grid.pitch
            at[near] = found[apart.argmin(1)[near]]
        last = np.where(np.isfinite(at), at, last)
        out.append(at)
    # a blob's centre is not our centre of mass: only the motion is compared
    return np.stack(out) - np.where(np.isfinite(out[0]), out[0], grid.places)


def flow(frames: Film, grid: MarkerGrid) -> NDArray[np.float64]:
    """Displacements by optical flow, from one frame to the next."""
    side = 2 * int(np.ceil(1.5 * grid.radius)) + 1
    before = _grey(frames[0])
    at = grid.places.astype(np.float32)[:, None]
    out = []
    for frame in frames:
        now = _grey(frame)
        at, good, _ = cv2.calcOpticalFlowPyrLK(before, now, at, None, winSize=(side, side))
        out.append(np.where(good > 0, at[:, 0], np.nan))
        before = now
    return np.stack(out).astype(np.float64) - grid.places


def _grey(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)


def measure(follow: Follow, frames: Film, true: NDArray[np.float64]) -> dict[str, float]:
    """Errors of one way to follow markers, in pixels, and its speed."""
    grid = find_markers(frames[0])
    which = np.hypot(*(grid.places[:, None] - true[0]).transpose(2, 0, 1)).argmin(1)
    wanted = (true - true[0])[:, which]
    start = time.process_time()
    found = follow(frames, grid)
    seconds = time.process_time() - start
    away = np.hypot(*(found - wanted).transpose(2, 0, 1))
    moving = np.hypot(*wanted.transpose(2, 0, 1)) > 1
    return {
        "rms_px": round(float(np.sqrt(np.nanmean(away**2))), 3),
        "rms_px_moved_by_1": round(float(np.sqrt(np.nanmean(away[moving] ** 2))), 3),
        "seen": round(float(np.isfinite(away).mean()), 3),
        "frames_a_second": round(len(frames) / seconds, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="units of each sensor")
    parser.add_argument("--name", default="markers", help="of the result")
    words = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    ways = {"ours": ours, "SimpleBlobDetector and nearest": blobs, "optical flow": flow}
    films: dict[str, Any] = {}
    for sensor in SENSORS:
        for seed in range(words.seeds):
            film = simulated(sensor, seed)
            films[f"{sensor} {seed}"] = {name: measure(way, *film) for name, way in ways.items()}
            print(sensor, seed, films[f"{sensor} {seed}"])
    middle = {
        name: {
            key: round(statistics.median(film[name][key] for film in films.values()), 3)
            for key in ("rms_px", "rms_px_moved_by_1", "seen", "frames_a_second")
        }
        for name in ways
    }
    save(words.name, {"frame": "240 rows", "median": middle, "films": films})


if __name__ == "__main__":
    main()
