"""Writes the report of a run again."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli._command import Command
from tactileforge.cli._moved_data import put_in, taken_out


@dataclass(frozen=True, kw_only=True)
class _Report:
    """Keys of ``report``.

    Attributes:
        run: Folder of a run.
    """

    run: str


def _report(keys: _Report, _: dict[str, Any]) -> None:
    """Writes the report of a run again; data.root=NEW for moved data."""
    # before torch is imported, and the data is listed: both may take long
    if Path(keys.run).is_dir():
        said = f"report: reading the run {keys.run}, its data and weights"
        print(said, file=sys.stderr, flush=True)
    from tactileforge.report.run import report_of_run

    print(f"report: {report_of_run(Path(keys.run), lambda config: put_in(config, _moved))}")


#: New folders of the data of the run, where it has moved; they are not keys of the command.
_moved: dict[str, str] = {}


def _prepare(overrides: list[str]) -> list[str]:
    rest, moved = taken_out(overrides)
    _moved.clear()  # those of an earlier command in this process
    _moved.update(moved)
    return rest


COMMANDS = {
    "": Command(
        run=_report,
        keys=_Report,
        bare=("run",),
        prepare=_prepare,
        # a folder that does not exist is reported by the command, which knows what a run is
        writes=lambda keys: Path(keys.run, "report.html") if Path(keys.run).is_dir() else None,
    )
}
