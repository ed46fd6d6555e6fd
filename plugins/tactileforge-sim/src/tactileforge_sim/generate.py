"""Simulated touches as shards on disk, one scene a file, written by all cores."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import (
    ArrayFrames,
    Index,
    IndexEntry,
    Packed,
    describe_recording,
    encode_image,
    keep_whole,
    write_shard,
)
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.plugins import (
    Bar,
    claim_folder,
    end_with_parent,
    one_thread,
    process_count,
    spread,
    strict,
)
from tactileforge_sim.config import FIRST_VAL, SimConfig
from tactileforge_sim.optics.scene_camera import render_scene_image
from tactileforge_sim.play import play_scenes
from tactileforge_sim.scene import simulated_rate

#: Tier of the tactile dynamic pyramid of a motion; others are specific actions.
_TIERS = {"force_trial": 1, "manipulation": 2}
#: Number of scenes from which starting more processes pays off.
_MANY = 4


def recordings(config: SimConfig, number: int) -> list[Packed]:
    """One scene on every sensor, encoded."""
    scene = config.scene(number)
    count = len(config.sensors)
    pictures: list[list[bytes]] = [[] for _ in range(count)]
    surface: list[list[bytes]] = [[] for _ in range(count)]
    force: list[list[np.ndarray]] = [[] for _ in range(count)]
    torque: list[float] = [0.0] * count
    for shots in play_scenes(
        scene,
        config.sensors,
        config.size,
        markers=config.markers,
        viscosity=config.viscosity,
        surface=True,
    ):
        assert shots.surface is not None
        pictures[shots.sensor] += [encode_image(p, config.codec) for p in shots.pictures]
        # Lossless: these images encode displacements, labels of training.
        surface[shots.sensor] += [encode_image(p, "png") for p in shots.surface]
        force[shots.sensor].append(shots.force)
        torque[shots.sensor] = max(torque[shots.sensor], float(np.abs(shots.torque).max()))
    photo = encode_image(render_scene_image(scene.shape, config.size, scene.seed), config.codec)
    kind = "surface" if scene.shape.index is None else "indenter"
    out = []
    felt = zip(config.sensors, pictures, surface, force, torque, strict=True)
    for sensor, encoded, moved, forces, twist in felt:
        times = scene.times(simulated_rate(sensor))
        # Forces earlier by the lag, and 0 at the end: a path ends clear of the gel.
        early, felt_force = round(config.lag * simulated_rate(sensor)), np.concatenate(forces)
        ahead = np.concatenate([felt_force[early:], np.zeros_like(felt_force[:early])])
        about = Recording(
            key=f"sim/{number:06d}_{sensor}_{scene.shape.name}_{scene.motion}",
            sensor=sensor,
            frames=_NONE,
            times=times,
            no_contact=None,
            force=ahead,
            action=scene.path.action(times),
            object=scene.shape.name,
            text=f"{{action}} a {scene.shape.words} {kind}",
            labels={
                "motion": scene.motion,
                "grip": scene.grip,
                "softness": scene.row["softness"],
                "torque_max": twist,
            },
            source="simulated by tactileforge",
            tier=_TIERS.get(scene.motion, 3),
            licence="CC0-1.0",
        )
        # The path starts clear of the gel.
        out.append(
            Packed(describe_recording(about), config.codec, encoded, encoded[:1], [photo], moved)
        )
    return out


#: Frames of a recording that is described alone; its pictures are encoded already.
_NONE = ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8))


def path_of(folder: Path, number: int) -> Path:
    """The shard of a scene."""
    if number < FIRST_VAL:
        return folder / f"train-{number:06d}.tar"
    return folder / f"val-{number - FIRST_VAL:06d}.tar"


def write_scenes(
    config: SimConfig, folder: Path, numbers: Sequence[int], processes: int | None = None
) -> None:
    """Writes the missing scenes; a killed run resumes with the next one.

    Args:
        config: The simulated scenes.
        folder: Folder of the shards.
        numbers: Numbers of scenes.
        processes: Number of processes; None for one per core.
    """
    missing = [n for n in numbers if not path_of(folder, n).exists()]
    if not missing:
        return
    count = process_count(len(missing), processes)
    many = len(missing) >= _MANY
    with Bar(total=len(missing), desc="simulating", unit="touch", disable=not many) as bar:
        if many and count > 1:
            command = [__name__, json.dumps(asdict(config)), str(folder)]
            spread(command, missing, count, lambda n: path_of(folder, n).exists(), bar)
            return
        for number in missing:
            try:
                _write(config, folder, number)
            except OSError as error:
                raise _unwritten(folder, error) from error
            bar.update()


def _unwritten(folder: Path, error: OSError) -> TactileForgeError:
    return TactileForgeError(
        f"{folder}: cannot be written ({error.strerror or error}). Touches that are whole stay: "
        "make room, and run the same command again"
    )


def _write(config: SimConfig, folder: Path, number: int) -> None:
    with one_thread():  # the bytes must not depend on the machine's number of cores
        write_shard(path_of(folder, number), recordings(config, number))


def write_seconds(
    config: SimConfig, folder: Path, seconds: float, val: float, processes: int | None = None
) -> tuple[int, int]:
    """Writes enough scenes for a duration of touch on each sensor.

    Args:
        config: The simulated scenes.
        folder: Folder of the shards.
        seconds: Duration of touch on each sensor, s, above 0.
        val: Share of the scenes held out for validation; at least 0, below 1.
        processes: Number of processes; None for one per core.

    Returns:
        Number of scenes for training and for validation.

    Raises:
        ConfigError: The duration or the share is out of range, or the folder holds touches of
            another configuration.
    """
    if not seconds > 0 or not 0 <= val < 1:
        raise ConfigError(f"sim: seconds={seconds} and val={val}; give > 0, and 0 or more, below 1")
    process_count(1, processes)  # an impossible number is told before anything is written
    numbers: list[int] = []
    total, held_out = 0.0, 0
    while total < seconds:
        # Validation scenes are spread over the numbers, so their share holds at any length.
        to_val = held_out < val * (len(numbers) + 1) - 0.5
        numbers.append(FIRST_VAL + held_out if to_val else len(numbers) - held_out)
        held_out += to_val
        total += config.scene(numbers[-1]).path.seconds
    # Claimed before anything is written, and indexed last: an index lists whole shards only.
    claim_folder(folder / "sim.json", asdict(config), "touches")
    keep_whole(path_of(folder, n) for n in numbers)
    write_scenes(config, folder, numbers, processes)
    splits = {
        split: [
            IndexEntry.of(path_of(folder, n)) for n in sorted(numbers) if (n < FIRST_VAL) == train
        ]
        for split, train in (("train", True), ("val", False))
    }
    Index("sim", splits, made=json.loads(json.dumps(asdict(config)))).save(folder)
    return len(numbers) - held_out, held_out


def _main(config: str, folder: str, *numbers: str) -> None:
    """Entry point of a worker process; simulates a share of the scenes."""
    scenes = strict.build(SimConfig, "", json.loads(config))
    end_with_parent()
    for number in map(int, numbers):
        _write(scenes, Path(folder), number)


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except TactileForgeError as error:
        sys.exit(str(error))
    except OSError as error:
        sys.exit(str(_unwritten(Path(sys.argv[2]), error)))
