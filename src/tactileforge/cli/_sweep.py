"""The table of a sweep: what each job was given, and the number that it gave."""

from __future__ import annotations

import csv
import json
import math
from io import StringIO
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from tactileforge.files import write_text

#: Of a job, in its folder; and of all jobs, in that of the sweep.
_JOB, TABLE = "sweep.json", "sweep.csv"


class SweepTable(Callback):
    """Writes ``sweep.csv`` into the folder of a sweep, the best job first, and prints it.

    Jobs may run in other processes or on other machines, so each leaves its row in its folder.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        """Leaves the row of one job of a sweep."""
        hydra = config.hydra
        if "MULTIRUN" not in str(hydra.mode) or job_return.status is not JobStatus.COMPLETED:
            return
        words = [word for word in hydra.overrides.task if not word.startswith("hydra")]
        row = {"job": hydra.job.num, "words": words, "metric": job_return.return_value}
        folder = Path(hydra.runtime.output_dir)
        if folder.is_dir():
            write_text(folder / _JOB, json.dumps(row))
            _gather(config, Path(hydra.sweep.dir))  # the next one may fail, which ends the sweep

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:
        """Gathers the rows of all jobs, and shows them."""
        folder = Path(config.hydra.sweep.dir)
        if not (table := _gather(config, folder)):
            return
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        for line in table:
            print("  ".join(map(str.ljust, line, widths)).rstrip())
        print(f"sweep: {folder / TABLE}")


def _gather(config: DictConfig, folder: Path) -> list[list[str]]:
    """Writes the table of the jobs that have ended: a head and a row each; [] for none."""
    rows = [json.loads(path.read_text("utf-8")) for path in folder.glob(f"*/{_JOB}")]
    if not rows:
        return []
    said = [dict(word.partition("=")[::2] for word in row["words"]) for row in rows]
    keys = [key for key in said[0] if len({str(words.get(key)) for words in said}) > 1]
    head = ["job", *keys, config.get("optimized_metric") or "loss"]
    body = [
        [str(row["job"]), *(words.get(key, "") for key in keys), _number(row["metric"])]
        for row, words in sorted(zip(rows, said, strict=True), key=_order)
    ]
    text = StringIO(newline="")
    csv.writer(text).writerows([head, *body])
    write_text(folder / TABLE, text.getvalue())
    return [head, *body]


def _number(metric: Any) -> str:
    return f"{metric:.5g}" if isinstance(metric, int | float) else ""


def _order(pair: tuple[dict[str, Any], dict[str, str]]) -> tuple[float, int]:
    """The smallest number first; jobs without one last."""
    metric = pair[0]["metric"]
    known = isinstance(metric, int | float) and math.isfinite(metric)
    return (float(metric) if known else math.inf), pair[0]["job"]
