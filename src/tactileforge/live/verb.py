"""``tactileforge record``."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from tactileforge import registry, settings
from tactileforge.contracts import Sensor
from tactileforge.errors import ConfigError, unknown
from tactileforge.live.options import Options
from tactileforge.live.record import record
from tactileforge.live.status import Status, Summary, of_drops


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
    options = Options.of(config)
    sensors, force, camera = built(config)
    status = Status()
    with stopped_by_signals() as stop:
        try:
            found = record(options, sensors, force, camera, stop, _say(status), status)
        finally:
            status.end()
    print(_told(found))
    print(f"look at it: tactileforge data inspect data=shards data.root={options.out}")
    return 0


def built(
    config: Mapping[str, Any],
) -> tuple[dict[str, Sensor], Sensor | None, Sensor | None]:
    """The sensors of a configuration, not open: ``sensor`` by name, ``force`` and ``camera``.

    Raises:
        ConfigError: A node names no plugin.
        PluginError: A plugin is not installed.
    """
    nodes: dict[str, Any] = {key: node for key, node in config["sensor"].items() if node}
    for key, node in nodes.items():
        if "name" not in node:
            raise ConfigError(unknown("sensor", key, registry.names("sensors")))
    sensors = {key: registry.build("sensors", node) for key, node in nodes.items()}
    others = [config.get(group) for group in ("force", "camera")]
    force, camera = (registry.build("sensors", node) if node else None for node in others)
    return sensors, force, camera


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set; a second Ctrl-C ends at once."""
    stop = threading.Event()

    def heard(number: int, frame: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, heard) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(status: Status) -> Any:
    def say(line: str) -> None:
        status.end()
        print(line, flush=True)

    return say


def _told(found: Summary) -> str:
    frames = ", ".join(f"{name} {count}" for name, count in found.frames.items())
    takes = "1 take" if found.takes == 1 else f"{found.takes} takes"
    return (
        f"{takes}, {found.seconds:.1f} s, {found.bytes / 1e6:.1f} MB; frames: {frames}; "
        f"dropped: {of_drops(found.reasons)}"
    )
