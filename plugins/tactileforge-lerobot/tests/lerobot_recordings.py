"""Recordings for tests of LeRobot's format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from tactileforge_lerobot.dataset import LeRobot

from tactileforge.plugin import ArrayFrames, Recording

#: Lowest accepted quality of the video on these pictures, dB (PSNR).
PSNR = 36.0


def touch(number: int, sensor: str = "digit", frames: int = 24, fps: float = 30.0) -> Recording:
    """A recording of a moving blob on a coloured background, with forces, actions and a track."""
    rng = np.random.default_rng([number, len(sensor)])
    rows, columns = np.mgrid[:64, :48]
    still = np.stack([80 + columns, 90 + rows * 0.5, 160 - columns], -1)
    path = rng.uniform(12, 36, 2) + np.linspace(0, 8, frames)[:, None]
    away = [(rows - r) ** 2 + (columns - c) ** 2 for r, c in path]
    pictures = still + 60 * np.exp(-np.stack(away) / 60)[..., None] * [1, -0.5, 0.3]
    force = rng.normal(0, 3, (frames, 3)).astype(np.float32)
    return Recording(
        key=f"touch/{number}/{sensor}",
        sensor=sensor,
        frames=ArrayFrames(pictures.clip(0, 255).round().astype(np.uint8)),
        times=0.013 + np.arange(frames) / fps,
        no_contact=ArrayFrames(still.round().astype(np.uint8)[None]),
        force=force,
        action=rng.integers(-1, 8, frames),
        object="cup",
        text="{action} the cup",
        labels={"unit": "D1", "grip": 0.5},
        tracks={"wrench": rng.normal(0, 1, (frames, 6)).astype(np.float32)},
        source="a test",
        tier=1,
        licence="CC0-1.0",
    )


def psnr(images: np.ndarray, wanted: np.ndarray) -> float:
    error = np.mean((images.astype(float) - wanted) ** 2)
    return float(10 * np.log10(255**2 / error)) if error else 99.0


def all_of(root: Path, **options: object) -> list[Recording]:
    data = LeRobot(str(root), val=0.0, **options)
    recordings = list(data.recordings("train"))
    assert data.skipped == []
    return recordings


def demonstration(number: int, frames: int = 24) -> list[Recording]:
    """Two fingers of one episode; the camera belongs to the left one."""
    rng = np.random.default_rng(number)
    views = np.full((frames, 32, 32, 3), 1, np.uint8)
    views *= np.arange(10, 10 + 6 * frames, 6, np.uint8)[:, None, None, None]
    tracks = {
        "state": rng.normal(0, 3, (frames, 5)).astype(np.float32),
        "robot_action": rng.normal(0, 1, (frames, 4)).astype(np.float32),
    }
    both = []
    for i, finger in enumerate(("left", "right")):
        episode = f"chip_{number:05d}"
        labels = {"episode": episode, "finger": finger, "task": "chip", "success": 1.0}
        both.append(
            replace(
                touch(10 * number + i, frames=frames, fps=6),
                key=f"{episode}/{finger}",
                labels=labels,
                tracks=tracks,
                text="pick the chip up",
                action=None,
                image=ArrayFrames(views) if finger == "left" else None,
            )
        )
        both[-1] = replace(both[-1], image_times=both[-1].times if finger == "left" else None)
    return both
