"""Synthetic demonstrations: shards of episodes with commands visible in touch alone."""

from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards.shards import Packed, describe_recording, encode_image, write_shard

#: Height and width of a picture of touch, and of the camera, pixels.
SIZE, CAMERA = 32, 24


def dent(place: float, size: int = SIZE, depth: float = 90.0) -> np.ndarray:
    """Draws a dent at column ``place`` (-1..1), uint8 (H, W, 3)."""
    y, x = np.meshgrid(*[np.linspace(-1, 1, size)] * 2, indexing="ij")
    bump = np.exp(-(y**2 + (x - 0.7 * place) ** 2) / 0.08)
    return np.clip(120 + depth * bump[..., None] * [1.0, -0.5, 0.3], 0, 255).astype(np.uint8)


def rest(size: int = SIZE) -> np.ndarray:
    """Draws a gel without contact, uint8 (H, W, 3)."""
    return np.full((size, size, 3), 120, np.uint8)


def episode(
    number: int,
    steps: int = 12,
    rate: float = 6.0,
    seed: int = 0,
    fingers: tuple[str, ...] = ("left", "right"),
    sensor: str = "digit",
    image: bool = True,
    size: int = SIZE,
    actions: int = 2,
) -> list[Recording]:
    """Recordings of one episode: a dent wanders over the gel, and the command counters it.

    The command is (-place of the dent, half of its place); the state is random.
    """
    rng = np.random.default_rng([seed, number])
    place = np.clip(rng.uniform(-1, 1) + np.cumsum(rng.normal(0, 0.15, steps)), -1, 1)
    state = rng.uniform(-1, 1, (steps, 3)).astype(np.float32)
    command = np.stack([-place, 0.5 * place, *[0 * place] * (actions - 2)], 1).astype(np.float32)
    times = np.arange(steps) / rate
    touch = np.stack([dent(p, size) for p in place])
    force = np.stack([0.3 * place, 0 * place, 1 + 0 * place], 1).astype(np.float32)
    camera = rng.integers(0, 255, (steps, CAMERA, CAMERA, 3)).astype(np.uint8)
    name = f"follow_{number:05d}"
    return [
        Recording(
            key=f"{name}/{finger}",
            sensor=sensor,
            frames=ArrayFrames(touch),
            times=times,
            no_contact=ArrayFrames(rest(size)[None]),
            force=force,
            text="follow the dent",
            image=ArrayFrames(camera) if image and finger == fingers[0] else None,
            image_times=times if image and finger == fingers[0] else None,
            labels={"episode": name, "finger": finger, "task": "follow", "seed": float(number)},
            tracks={"state": state, "robot_action": command[:, :actions]},
        )
        for finger in fingers
    ]


def packed(recording: Recording) -> Packed:
    """Packs a recording, with its pictures as PNG."""

    def encoded(frames: ArrayFrames | None) -> list[bytes]:
        if frames is None:
            return []
        return [encode_image(one, "png") for one in frames.read(range(len(frames)))]

    return Packed(
        describe_recording(recording),
        "png",
        encoded(recording.frames),
        encoded(recording.no_contact),
        encoded(recording.image),
    )


def write(root: Path, recordings: list[Recording]) -> Path:
    """Writes shards without an index."""
    write_shard(root / "train-000000.tar", [packed(one) for one in recordings])
    return root


def demonstrations(root: Path, count: int = 6, **options: object) -> Path:
    """Writes some episodes; see `episode`."""
    return write(root, [one for n in range(count) for one in episode(n, **options)])
