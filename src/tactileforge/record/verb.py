"""``tactileforge record``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tactileforge import settings
from tactileforge.record.options import RecordOptions
from tactileforge.record.record import record
from tactileforge.record.status import RecordStatus, RecordSummary
from tactileforge.sensors.opening import build_sensors
from tactileforge.sensors.status import of_drops
from tactileforge.signals import stopped_by_signals


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge record``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    if argv in (["--help"], ["-h"]):
        print(settings.text("record"))
        return 0
    from tactileforge.compose import plain

    config = plain("record", argv)
    options = RecordOptions.of(config)
    sensors, force, camera = build_sensors(config)
    status = RecordStatus()
    with stopped_by_signals() as stop:
        try:
            found = record(options, sensors, force, camera, stop, _say(status), status)
        finally:
            status.end()
    print(_told(found))
    print(f"look at it: tactileforge data inspect data=shards data.root={options.out}")
    return 0


def _say(status: RecordStatus) -> Any:
    def say(line: str) -> None:
        status.end()
        print(line, flush=True)

    return say


def _told(found: RecordSummary) -> str:
    frames = ", ".join(f"{name} {count}" for name, count in found.frames.items())
    takes = "1 take" if found.takes == 1 else f"{found.takes} takes"
    return (
        f"{takes}, {found.seconds:.1f} s, {found.bytes / 1e6:.1f} MB; frames: {frames}; "
        f"dropped: {of_drops(found.reasons)}"
    )
