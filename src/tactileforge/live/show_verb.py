"""``tactileforge live``."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from tactileforge import settings
from tactileforge.errors import ConfigError
from tactileforge.live.contact import ContactOptions, SlipOptions
from tactileforge.live.publish import JsonLines, Publisher, build_publishers
from tactileforge.live.session import LiveOptions, LiveSession, run_session
from tactileforge.live.status_line import LiveStatus
from tactileforge.sensors.background import Background
from tactileforge.sensors.opening import build_sensors as built_sensors
from tactileforge.signals import stopped_by_signals
from tactileforge.strict import part

if TYPE_CHECKING:
    from tactileforge.hub.model import Model

_PARTS: dict[str, type[Any]] = {"contact": ContactOptions, "slip": SlipOptions}


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge live``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    if argv in (["--help"], ["-h"]):
        print(settings.text("live"))
        return 0
    from tactileforge.compose import plain

    config = plain("live", argv)
    options = options_of(config)
    sensors, _, _ = built_sensors(config)
    publishers: list[Publisher] = build_publishers(config["publish"])
    if config["json"]:
        publishers.append(JsonLines())
    status = LiveStatus()

    def say(line: str) -> None:
        status.end()
        print(line, file=sys.stderr if config["json"] else sys.stdout, flush=True)

    with ExitStack() as stack:
        view = stack.enter_context(LiveSession(sensors, _model(config), options))
        stop = stack.enter_context(stopped_by_signals())
        stack.callback(status.end)
        if config["page"]:
            from tactileforge.live.server import LivePage

            page = stack.enter_context(LivePage(view, config["port"]))
            say(f"page: {page.url}")
        try:
            run_session(view, publishers, stop, say, status.tell)
        except BrokenPipeError:  # whoever read standard output has had enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status.end()
        say(status.summary(view))
    return 0


def options_of(config: Mapping[str, Any]) -> LiveOptions:
    """The options of a configuration; see conf/live.yaml.

    Raises:
        ConfigError: An unknown key, or a value that does not fit.
    """
    background = dict(config["background"])
    image = background.pop("image", "") or ""
    parts = {key: part(key, kind, config[key]) for key, kind in _PARTS.items()}
    for key in ("seconds", "frames"):
        if config[key] is not None and not config[key] > 0:
            raise ConfigError(f"{key}={config[key]}: give a value above 0")
    names = ("embedding", "unknown_sensor", "reconnect", "calibration", "seconds", "frames")
    return LiveOptions(
        background=part("background", Background, background),
        image=str(image),
        **parts,
        **{name: config[name] for name in names},
    )


def _model(config: Mapping[str, Any]) -> Model | None:
    if config["threads"]:
        import torch

        torch.set_num_threads(int(config["threads"]))
    if not config["model"]:
        return None
    from tactileforge.hub.loading import load

    return load(config["model"], device=config["device"])
