"""Shows touch as it happens: contact, force, slip, a page."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from tactileforge.cli import Command
from tactileforge.pages import check_port
from tactileforge.plugins import stopped_by_signals
from tactileforge.sensors import build_sensors as built_sensors
from tactileforge_live.publish import JsonLines, Publisher, build_publishers
from tactileforge_live.session import LiveOptions, LiveSession, run_session
from tactileforge_live.status_line import LiveStatus


@dataclass(frozen=True, kw_only=True)
class _Live(LiveOptions):
    """Keys of ``live``.

    Attributes:
        model: NAME.TAG of the zoo, file:PATH or run:FOLDER; None shows pictures and contact alone.
            Forces need a model with a force head.
        device: Torch device of the model.
        threads: Number of threads of the model; None for one with a small model, else torch's
            choice.
        page: Whether to serve a page at 127.0.0.1, for this machine alone.
        port: Port of the page; 0 for any free one.
        json: Whether to write readings to standard output, one JSON object a line.
        publish: Publishers of plugins: [zmq], or {zmq: {address: tcp://127.0.0.1:5556}}.
    """

    model: str | None = None
    device: str = "cpu"
    threads: int | None = None
    page: bool = True
    port: int = 0
    json: bool = False
    publish: list[str] | dict[str, Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_port(self.port)


def _live(keys: _Live, config: dict[str, Any]) -> None:
    """Shows touch as it happens (docs/live.md).

    Options of a sensor are sensor.NAME.option=value; several: sensor=[digit,gelsight_mini]
    """
    sensors = built_sensors(config).touch
    publishers: list[Publisher] = build_publishers(keys.publish)
    if keys.json:
        publishers.append(JsonLines())
    model = None
    if keys.model:
        from tactileforge import load
        from tactileforge.plugins import use_threads

        use_threads(keys.threads)
        model = load(keys.model, device=keys.device)
    status = LiveStatus()

    def say(line: str) -> None:
        status.end()  # a line of its own, below the status
        print(line, file=sys.stderr if keys.json else sys.stdout, flush=True)

    with ExitStack() as stack:
        view = stack.enter_context(LiveSession(sensors, model, keys))
        stop = stack.enter_context(stopped_by_signals())
        stack.callback(status.end)
        if keys.page:
            from tactileforge_live.server import LivePage

            page = stack.enter_context(LivePage(view, keys.port))
            say(f"page: {page.url}")
        try:
            run_session(view, publishers, stop, say, status.tell)
        except BrokenPipeError:  # the reader of standard output has closed it
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status.end()
        say(status.summary(view))


COMMANDS = {"": Command(run=_live, keys=_Live, groups={"sensor": "???"})}
