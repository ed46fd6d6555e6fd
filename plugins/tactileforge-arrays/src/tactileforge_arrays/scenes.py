"""Simulated touches, measured by arrays of taxels."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tactileforge_depth.gel import Gel
from tactileforge_sim.config import SimConfig
from tactileforge_sim.generate import path_of
from tactileforge_sim.mechanics.touch import ContactState, contacts
from tactileforge_sim.optics.scene_camera import render_scene_image
from tactileforge_sim.scene import POINTS, SPACING, Scene

from tactileforge.contracts import Recording
from tactileforge.data import ArrayFrames, Packed, describe_recording, encode_image, write_shard
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.plugins import Bar, end_with_parent, one_thread, process_count, spread, strict
from tactileforge.sensors import TaxelLayout

#: Simulated frames per second.
FPS = 30.0
#: Frames without contact in a recording.
_REST = 5
#: Coefficients of friction, from slippery to sticky.
_FRICTION = (0.5, 1.2)
#: Number of missing scenes from which on more processes are worth their start.
_MANY = 4
_NONE = ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8))


@dataclass(frozen=True, kw_only=True)
class Array:
    """An array of taxels below a skin.

    Attributes:
        sensor: Its name in recordings.
        shape: Rows and columns of taxels.
        pitch: Distance between neighbouring taxels, mm.
        axes: 3 for normal force and shear, 1 for normal force alone.
        span: Force on a taxel drawn as full colour, N; larger forces are clipped to it.
        noise: Standard deviation of the noise of a taxel, N.
        bits: Resolution of the converter in bits, over -span to span.
        size: Rows of the image; None for one pixel a taxel.
    """

    sensor: str
    shape: tuple[int, int]
    pitch: float
    axes: int
    span: float
    noise: float
    bits: int
    size: int | None

    def __post_init__(self) -> None:
        rows, columns = self.shape
        if min(rows, columns) < 2 or not self.pitch > 0:
            raise ConfigError(
                f"sim_array: shape={rows} x {columns}, pitch={self.pitch}; give 2 taxels or more a "
                "side, and a pitch above 0 mm"
            )
        if self.axes not in (1, 3):
            raise ConfigError(f"sim_array: axes={self.axes}; give 1 or 3")
        if not self.span > 0 or self.noise < 0 or not 2 <= self.bits <= 16:
            raise ConfigError(
                f"sim_array: span={self.span} N, noise={self.noise} N, bits={self.bits}; give more "
                "than 0, 0 or more, and 2 to 16"
            )
        if self.size is not None and self.size < rows:
            raise ConfigError(f"sim_array: size={self.size} pixels for {rows} rows of taxels")

    def layout(self) -> TaxelLayout:
        """Layout of its taxels in the image."""
        rows, columns = self.shape
        channels = (0, 1, 2) if self.axes == 3 else (0,)
        if self.size is None or self.size == rows:
            return TaxelLayout(self.shape, channels=channels, span=self.span)
        picture = (self.size, round(self.size * columns / rows))
        places = np.indices(self.shape).reshape(2, -1).T + 0.5
        places = places / self.shape * picture - 0.5
        return TaxelLayout(picture, places.tolist(), channels, self.span)

    def measured(
        self, forces: NDArray[np.float64], chance: np.random.Generator
    ) -> NDArray[np.float32]:
        """Adds noise to forces, clips them and rounds to steps of the converter.

        Returns:
            float32 of the same shape, N.
        """
        step = 2 * self.span / (2**self.bits - 1)
        noisy = forces + chance.normal(0, self.noise, forces.shape)
        steps = np.rint(noisy.clip(-self.span, self.span) / step)
        quantised: NDArray[np.float32] = (steps * step).astype(np.float32)
        return quantised


def taxel_forces(
    contact: ContactState, shape: tuple[int, int], pitch: float
) -> NDArray[np.float64]:
    """Sums pressure and shear over the cells of taxels.

    The array lies around the middle of the image. Forces beside it are lost. The force of a point
    is shared bilinearly among the four taxels around it, so that a moving contact changes their
    values smoothly.

    Args:
        contact: One moment of one touch (a batch of 1).
        shape: Rows and columns of taxels.
        pitch: Distance between neighbouring taxels, mm.

    Returns:
        float64 (taxels, 3), N: x, y, z of the object on the array.
    """
    pressure, shear = contact.pressure[0].double().numpy(), contact.shear[0].double().numpy()
    left, top, angle = (float(value) for value in contact.pose[0, :3])
    cos, sin = np.cos(angle), np.sin(angle)
    line = (np.arange(len(pressure)) - (len(pressure) - 1) / 2) * SPACING
    y, x = np.meshgrid(line, line, indexing="ij")
    force = np.stack([cos * shear[0] - sin * shear[1], sin * shear[0] + cos * shear[1], pressure])
    force *= SPACING**2
    row = (top + sin * x + cos * y) / pitch + (shape[0] - 1) / 2
    column = (left + cos * x - sin * y) / pitch + (shape[1] - 1) / 2
    felt = np.abs(force).sum(0) > 0
    out = np.zeros((*shape, 3))
    for place, share in _shares(row[felt], column[felt]):
        inside = ((place >= 0) & (place < shape)).all(1)
        contributions = (share * force[:, felt]).T
        np.add.at(out, tuple(place[inside].T), contributions[inside])
    return out.reshape(-1, 3)


def _shares(
    row: NDArray[np.float64], column: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Yields the four taxels around each point, and the bilinear share of each."""
    first = np.stack([np.floor(row), np.floor(column)], 1).astype(np.int64)
    down, right = row - first[:, 0], column - first[:, 1]
    for i in (0, 1):
        for j in (0, 1):
            share: NDArray[np.float64] = np.abs(1 - i - down) * np.abs(1 - j - right)
            yield first + np.array([i, j]), share


def play_on_array(scene: Scene, array: Array) -> NDArray[np.float64]:
    """Simulates the force on every taxel of an array over a scene.

    Returns:
        float64 (T, taxels, 3), N.
    """
    low, high = _FRICTION
    gel = Gel(friction=low + scene.grip * (high - low))
    heights = torch.from_numpy(scene.shape.map(POINTS, SPACING))[None].float()
    poses = torch.from_numpy(scene.path.pose(scene.times(FPS)))[None].float()
    moments = contacts(heights, SPACING, [gel], poses, [FPS], f"touch of seed {scene.seed}")
    return np.stack([taxel_forces(moment, array.shape, array.pitch) for moment in moments])


def recording(config: SimConfig, array: Array, number: int) -> Packed:
    """Simulates one scene on the array, encoded without loss; the forces on taxels are a track.

    The label is their sum without noise. Forces beside the array are not part of it.
    """
    scene = config.scene(number)
    forces = play_on_array(scene, array)
    force = forces.sum(1).astype(np.float32)
    chance = np.random.default_rng([config.seed, number, 0xA2])
    forces = forces if array.axes == 3 else forces[..., 2:]
    still = np.zeros((_REST, *forces.shape[1:]))
    values = array.measured(np.concatenate([still, forces]), chance)
    layout, rest = array.layout(), np.zeros(forces.shape[1:], np.float32)
    pictures = [encode_image(layout.draw(frame, rest), "png") for frame in values]
    times = scene.times(FPS)
    kind = "surface" if scene.shape.index is None else "indenter"
    about = Recording(
        key=f"sim_array/{number:06d}_{array.sensor}_{scene.shape.name}_{scene.motion}",
        sensor=array.sensor,
        frames=_NONE,
        times=times,
        no_contact=None,
        force=force,
        action=scene.path.action(times),
        object=scene.shape.name,
        text=f"{{action}} a {scene.shape.words} {kind}",
        labels={"motion": scene.motion, "grip": scene.grip, "pitch_mm": array.pitch},
        tracks={"taxels": values[_REST:]},
        source="simulated by tactileforge",
        tier=3,
        licence="CC0-1.0",
    )
    photo = encode_image(render_scene_image(scene.shape, max(config.size, 16), scene.seed), "png")
    return Packed(describe_recording(about), "png", pictures[_REST:], pictures[:_REST], [photo])


def folder_name(config: SimConfig, array: Array) -> str:
    """Digest of the simulated scenes, the array and the code of this module."""
    text = json.dumps([config.digest(), asdict(array)], sort_keys=True)
    return hashlib.sha256(text.encode() + Path(__file__).read_bytes()).hexdigest()[:16]


def write_array_scenes(
    config: SimConfig, array: Array, folder: Path, numbers: Sequence[int], processes: int | None
) -> None:
    """Writes the missing scenes, one shard each.

    Args:
        config: The simulated scenes.
        array: The taxel array.
        folder: Folder of the shards.
        numbers: Numbers of scenes; validation starts at `tactileforge_sim.config.FIRST_VAL`.
        processes: Number of simulating processes; None for one per core.
    """
    missing = [n for n in numbers if not path_of(folder, n).exists()]
    count = process_count(len(missing), processes)
    with Bar(
        total=len(missing), desc="simulating", unit="touch", disable=len(missing) < _MANY
    ) as bar:
        if len(missing) >= _MANY and count > 1:
            options = [json.dumps(asdict(one)) for one in (config, array)]
            command = [__name__, *options, str(folder)]
            spread(command, missing, count, lambda n: path_of(folder, n).exists(), bar)
            return
        for number in missing:
            _write(config, array, folder, number)
            bar.update()


def _write(config: SimConfig, array: Array, folder: Path, number: int) -> None:
    with one_thread():
        write_shard(path_of(folder, number), [recording(config, array, number)])


def _main(config: str, array: str, folder: str, *numbers: str) -> None:
    """Simulates a share of the scenes, in a process of its own."""
    scenes = strict.build(SimConfig, "", json.loads(config))
    taxels = strict.build(Array, "", json.loads(array))
    end_with_parent()
    for number in map(int, numbers):
        _write(scenes, taxels, Path(folder), number)


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except (TactileForgeError, OSError) as error:
        sys.exit(str(error))
