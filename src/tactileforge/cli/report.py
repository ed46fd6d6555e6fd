"""Writes the report of a run again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli.command import Command


@dataclass(frozen=True, kw_only=True)
class _Report:
    """Keys of ``report``.

    Attributes:
        run: Folder of a run.
    """

    run: str


def _report(keys: _Report, _: dict[str, Any]) -> None:
    """Writes the report of a run again."""
    from tactileforge.report.run import report_of_run

    print(f"report: {report_of_run(Path(keys.run))}")


COMMANDS = {
    "": Command(
        run=_report,
        keys=_Report,
        bare=("run",),
        # a folder that does not exist is reported by the command, which knows what a run is
        writes=lambda keys: Path(keys.run, "report.html") if Path(keys.run).is_dir() else None,
    )
}
