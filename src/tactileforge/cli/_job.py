"""A job of a sweep: its number is reused if it has ended; it is resumed if it was stopped."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tactileforge.cli._sweep import ended
from tactileforge.errors import TactileForgeError
from tactileforge.pages.curves import read_metrics
from tactileforge.runs.folder import LAST
from tactileforge.util.distributed import count_processes
from tactileforge.util.processes import run_program

log = logging.getLogger(__name__)

#: Number of a job without a finite metric, so that it comes last.
NO_NUMBER = math.inf


def run_job(
    folder: Path,
    config: dict[str, Any],
    words: Sequence[str],
    anew: Sequence[str],
    train: Callable[[], float],
) -> float:
    """Runs a job of a sweep and returns its number, to be minimised by the sweep.

    Args:
        folder: Folder of the job.
        config: Finished configuration as plain data.
        words: ``key=value`` words of the job.
        anew: Those of ``words`` that a resumed run may change.
        train: Function that trains in this process and returns the number.

    Raises:
        TactileForgeError: The job failed.
        KeyboardInterrupt: The job was stopped; says how to resume it.
    """
    said = " ".join(word for word in words if not word.startswith("hydra"))
    number = ended(folder)
    if number is not None:
        log.info("taken, as it has ended: %s (%s)", folder, said)
        return number
    stopped = (folder / LAST).is_file()
    if stopped:
        log.info("goes on where it was stopped: %s (%s)", folder, said)
    try:
        # a job of several processes needs new ones, see `_run_apart`
        if count_processes(config["trainer"]) > 1 and "LOCAL_RANK" not in os.environ:
            _run_apart(folder, words, anew, stopped)
            number = logged(folder, config)
        else:
            number = train()
            number = number if math.isfinite(number) else logged(folder, config)
    except KeyboardInterrupt as stop:
        why = str(stop).partition("; go on with")[0] or "stopped"
        raise KeyboardInterrupt(f"{why}; go on with: the same command again") from stop
    if not math.isfinite(number):
        log.warning(
            "%s: no finite number to rank this job by, so it comes last; a run that is shorter "
            "than trainer.log_every_n_steps logs none",
            folder,
        )
        return NO_NUMBER
    return number


def logged(folder: Path, config: dict[str, Any]) -> float:
    """Number of a run from its ``metrics.csv``; NaN if the file has none."""
    curves = {key: float(curve.values[-1]) for key, curve in read_metrics(folder).items()}
    if name := config.get("optimized_metric"):
        return curves.get(name, math.nan)
    rows = [
        [curves[f"{split}/{key}"] for key in config["objective"] if f"{split}/{key}" in curves]
        for split in ("val", "train")
    ]
    return sum(rows[0] or rows[1] or [math.nan])


def _run_apart(folder: Path, words: Sequence[str], anew: Sequence[str], stopped: bool) -> None:
    """Trains in new processes, since those of an earlier job have ended with their group."""
    typed = sys.argv[2:]  # folders of options, then the words of the job
    given = anew if stopped else [word for word in words if not word.startswith("hydra")]
    place = "resume" if stopped else "hydra.run.dir"
    own = [*typed[: len(typed) - len(words)], *given, f"{place}={folder}"]
    status, output = run_program([sys.executable, "-m", "tactileforge", "train", *own])
    if status == 130:  # Ctrl-C, see `cli.main`
        raise KeyboardInterrupt(f"stopped in {folder}")
    if status:
        reason = output.strip().rpartition("error: ")[2] or f"exit status {status}"
        raise TactileForgeError(f"{folder}: the job failed: {' '.join(reason.split())[-500:]}")
