"""Marks contact, slip and bad frames of recordings by hand, on a local page."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import ConfigError, home_path
from tactileforge.pages import LocalPage
from tactileforge.plugins import build, locked
from tactileforge.sensors import ContactOptions
from tactileforge_labels.propose import SlipMotion


@dataclass(frozen=True, kw_only=True)
class Label:
    """Keys of ``label``.

    Attributes:
        out: Folder of the CSVs, one per recording; None for ``labels`` in data.root.
        port: Port of the page; 0 for any free one.
        contact: Thresholds of proposed contact.
        slip: Thresholds of proposed slip.
        seconds: Duration of the page, s; None until Ctrl-C.
    """

    out: str | None = None
    port: int = 0
    contact: ContactOptions = field(default_factory=ContactOptions)
    slip: SlipMotion = field(default_factory=SlipMotion)
    seconds: float | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None and not self.seconds > 0:
            raise ConfigError(f"seconds={self.seconds}: give a value above 0")


def label(keys: Label, config: dict[str, Any]) -> None:
    """Marks contact, slip and bad frames by hand, on a local page (docs/labels.md)."""
    # here: the command line starts faster without it
    from tactileforge.checks import frame_lines
    from tactileforge_labels.server import LabelAnswers
    from tactileforge_labels.session import LabelSession

    assert keys.out is not None  # `_beside_the_data` has set it
    options = dict(config["data"])
    if (
        options["name"] == "recordings"
    ):  # frames are numbered with those that an earlier day left out
        options["tracks"] = False
    folder = home_path(keys.out)
    taken = f"{folder} is labeled by process {{holder}}; use its page, or end it"
    with locked(folder / ".lock", taken):
        session = LabelSession(build("datasets", options), folder, keys.contact, keys.slip)
        for line in [*session.skipped, *(one.problem for one in session.entries if one.problem)]:
            print(f"skipped: {line}", flush=True)
        for line in frame_lines([one.recording for one in session.entries]):
            print(f"note: {line}", flush=True)
        answers = LabelAnswers(session)
        with LocalPage(answers.get, answers.post, keys.port) as page:
            print(f"{len(session.entries)} recordings, CSVs in {folder}", flush=True)
            print(f"page: {page.url}", flush=True)
            with suppress(KeyboardInterrupt):
                _wait(keys.seconds)
    written = sum(one.path.is_file() for one in session.entries)
    print(f"{written} of {len(session.entries)} recordings have a CSV in {folder}")


def _wait(seconds: float | None) -> None:
    end = None if seconds is None else time.monotonic() + seconds
    while end is None or time.monotonic() < end:
        time.sleep(0.2 if end is None else min(0.2, max(0.0, end - time.monotonic())))


def _beside_the_data(config: Any) -> Any:
    """The configuration with the folder of the CSVs.

    Raises:
        ConfigError: The data has no root, and no folder is given.
    """
    if config.get("out") is None:
        if "root" not in config.data.keys():  # noqa: SIM118 - a root that is missing is one of them
            raise ConfigError("give out=FOLDER for the CSVs: this data has no root")
        if root := config.data.get("root"):
            config.out = str(home_path(root) / "labels")
    return config


COMMANDS = {
    "": Command(run=label, keys=Label, groups={"data": "???"}, into=True, finish=_beside_the_data)
}
