"""Records sensors, forces, a camera and a robot, as shards."""

from __future__ import annotations

from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import command
from tactileforge.plugins import stopped_by_signals
from tactileforge.sensors import build_sensors, of_drops
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.record import record
from tactileforge_live.record.status import RecordStatus


def _record(keys: RecordOptions, config: dict[str, Any]) -> None:
    """Records sensors, forces, a camera and a robot together (docs/record.md).

    Options of a sensor are sensor.NAME.option=value, and so are those of force, camera and robot:
    force.option=value. A second sensor of one kind: +sensor@sensor.second=NAME
    """
    touch, force, camera, robot = build_sensors(config)
    status = RecordStatus()

    def say(line: str) -> None:
        status.end()  # a line of its own, below the status
        print(line, flush=True)

    with stopped_by_signals() as stop:
        try:
            summary = record(keys, touch, force, camera, stop, say, status, robot)
        finally:
            status.end()
    frames = ", ".join(f"{name} {count}" for name, count in summary.frames.items())
    takes = "1 take" if summary.takes == 1 else f"{summary.takes} takes"
    print(
        f"{takes}, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB; frames: {frames}; "
        f"dropped: {of_drops(summary.reasons)}"
    )
    for finding in (one for ones in summary.findings.values() for one in ones):
        print(f"noticed: {finding}")
    look = command("data", "inspect", "data=shards", f"data.root={keys.out}")
    print(f"look at it: {look}")


_SENSORS = {"sensor": "???", "force": None, "camera": None, "robot": None}
COMMANDS = {"": Command(run=_record, keys=RecordOptions, groups=_SENSORS, into=True)}
