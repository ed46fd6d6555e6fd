"""Simulates touch, as shards."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import command
from tactileforge.pages import Shown
from tactileforge_sim.config import SimConfig
from tactileforge_sim.generate import write_seconds


@dataclass(frozen=True, kw_only=True)
class _Sim:
    """Simulated touches, as shards for ``data=shards``.

    Attributes:
        out: Folder of the shards.
        sensors: Types of sensors; each touch is felt by all of them.
        indenters: ``few`` (twelve for pretraining), ``pretrain`` (all 61), ``bench`` (validation
            has indenters of its own), ``textures``, ``all``, or names of shapes.
        motions: ``atomic``, ``force_trial``, ``manipulation``, ``all``, or names of motions.
        seconds: Duration of simulated touch for each sensor, s.
        val: Share of the touches for validation, 0 to 1.
        size: Rows or columns of a picture, whichever are fewer.
        action_seconds: Mean duration of one action, s.
        force: Range of the largest normal force of a touch, N.
        markers: Whether the gels have markers; None as their types have.
        viscosity: Relaxation time of the gels, s: forces then lead pictures.
        lag: Seconds by which pictures come later than forces, as from a real camera.
        randomise: How units of a sensor, and touches, differ: ``none``, ``unit``, ``all``, or names
            of rows (docs/simulator.md).
        seed: Seed of the simulation; another seed gives other touches.
        codec: Format of stored pictures: jpg (quality 95), or without loss png or webp.
        processes: Number of simulating processes; None for one per core.
    """

    out: str
    sensors: tuple[str, ...] = ("digit", "gelsight", "gelsight_mini")
    indenters: str | tuple[str, ...] = "pretrain"
    motions: str | tuple[str, ...] = "atomic"
    seconds: float = 60.0
    val: float = 0.1
    size: int = 240
    action_seconds: float = 0.6
    force: tuple[float, float] = (0.5, 8.0)
    markers: bool | None = None
    viscosity: float = 0.0
    lag: float = 0.0
    randomise: str | tuple[str, ...] = "all"
    seed: int = 0
    codec: str = "jpg"
    processes: int | None = None


def _sim(keys: _Sim, _: dict[str, Any]) -> Shown:
    """Simulates touch and writes it as shards for data=shards."""
    simulated = {spec.name for spec in fields(SimConfig)}
    own = {name: value for name, value in vars(keys).items() if name in simulated}
    # `seconds` of the verb is the length of all touch, and that of `SimConfig` one action's
    config = SimConfig(**{**own, "seconds": keys.action_seconds})
    folder = Path(keys.out)
    train, val = write_seconds(config, folder, keys.seconds, keys.val, keys.processes)
    print(f"{train} touches for training and {val} for validation: {folder}")
    print(f"train on them: {command('train', 'data=shards', f'data.root={folder}')}")
    rows = [{"split": "train", "touches": train}, {"split": "val", "touches": val}]
    return Shown(folder, rows=rows, value=config)


COMMANDS = {"": Command(run=_sim, keys=_Sim, into=True)}
