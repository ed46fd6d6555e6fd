"""A sweep: the folders of its jobs, and the table of their settings and results.

A job is identified by its words. The same command, given again, finds the folders of its jobs,
whatever their order.
"""

from __future__ import annotations

import csv
import json
import math
import re
import statistics
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from io import StringIO
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from tactileforge.runs.folder import LOCK, is_claimed
from tactileforge.util.files import write_text
from tactileforge.util.locks import locked

#: Record of one job, in its folder; table and page of all jobs, in the folder of the sweep.
JOB, TABLE, PAGE = "sweep.json", "sweep.csv", "sweep.html"
#: Record of the sweep: its words, and whether all its jobs have ended.
_SWEEP = ".sweep.json"
#: Lock held while a job chooses its folder.
_CHOOSING = ".choosing"
#: Default parent folder of sweeps (conf/train.yaml).
_HERE = Path("runs") / "sweeps"
#: Words about how jobs are run, not about which jobs there are.
_HOW = re.compile(r"hydra\.sweep\.dir=|hydra[./]launcher|hydra\.verbose")


def job_folder(sweep: str, number: int, words: Sequence[str]) -> str:
    """Name of the folder of a job: the existing one for these words, else a new one.

    Args:
        sweep: Folder of the sweep.
        number: Number of the job; it names a new folder, unless another job has that name.
        words: ``key=value`` words of the job.
    """
    own = _of_job(words)
    folder = Path(sweep)
    with locked(folder / _CHOOSING):  # jobs in other processes choose theirs at the same time
        records = {path.parent.name: record for path, record in _records(folder)}
        for name, record in records.items():
            if _of_job(record["words"]) == own:
                return name
        free = (str(n) for n in [number, *range(10**6)] if str(n) not in records)
        name = next(name for name in free if name == str(number) or not (folder / name).exists())
        write_text(folder / name / JOB, json.dumps({"words": list(words)}))
        return name


def _of_job(words: Sequence[str]) -> list[str]:
    return sorted(word for word in words if not word.startswith("hydra"))


def _records(folder: Path) -> list[tuple[Path, dict[str, Any]]]:
    return [(path, json.loads(path.read_text("utf-8"))) for path in sorted(folder.glob(f"*/{JOB}"))]


def ended(folder: Path) -> float | None:
    """Result of a job of a sweep; None if the job has not ended."""
    path = folder / JOB
    number = json.loads(path.read_text("utf-8")).get("metric") if path.is_file() else None
    return float(number) if isinstance(number, int | float) else None


def stopped_sweep(words: Sequence[str]) -> Path | None:
    """Folder of the last stopped sweep with these words; None if there is none.

    Args:
        words: Words of the command line; words about how jobs are run are ignored.
    """
    if any(word.startswith("hydra.sweep.dir=") for word in words):
        return None
    for path in sorted(_HERE.glob(f"*/{_SWEEP}"), reverse=True):
        about = json.loads(path.read_text("utf-8"))
        same = about == {"words": _of_sweep(words), "ended": False}
        if same and not is_claimed(path.parent):
            return path.parent
    return None


def _of_sweep(words: Sequence[str]) -> list[str]:
    return sorted(word for word in words if not _HOW.match(word))


OmegaConf.register_new_resolver("tactileforge_job", job_folder, replace=True)


class SweepTable(Callback):
    """Writes ``sweep.csv`` into the folder of a sweep, the best job first, and prints it.

    Jobs may run in other processes or on other machines, so each leaves its row in its folder.
    """

    _words: Sequence[str] = ()
    _held = ExitStack()  # until the process ends

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Locks the folder of the sweep and writes its record.

        Raises:
            ConfigError: Another process runs this sweep.
        """
        folder = Path(config.hydra.sweep.dir)
        taken = f"{folder}: another process runs this sweep; give another hydra.sweep.dir="
        self._held.enter_context(locked(folder / LOCK, taken))
        # read here, since each job replaces sys.argv by its own words
        self._words = _of_sweep(sys.argv[1:])
        write_text(folder / _SWEEP, json.dumps({"words": self._words, "ended": False}))

    def __getstate__(self) -> dict[str, Any]:
        """Empty state: the lock stays in this process when jobs run in others."""
        return {}

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        """Writes the row of one job of a sweep."""
        hydra = config.hydra
        if "MULTIRUN" not in str(hydra.mode):
            return
        words = [word for word in hydra.overrides.task if not word.startswith("hydra")]
        folder = Path(hydra.runtime.output_dir)
        row: dict[str, Any] = {"words": words}
        try:
            row["metric"] = job_return.return_value
        except Exception as error:  # that of the job
            row |= {"metric": None, "failed": str(error).partition("\n")[0] or repr(error)}
        if folder.is_dir():
            write_text(folder / JOB, json.dumps(row))
            _gather(config, Path(hydra.sweep.dir))  # now, as a failing job ends the sweep

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:
        """Gathers the rows of all jobs, and shows them."""
        folder = Path(config.hydra.sweep.dir)
        write_text(folder / _SWEEP, json.dumps({"words": self._words, "ended": True}))
        self._held.close()
        if not (table := _gather(config, folder)):
            return
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        for line in table:
            print("  ".join(map(str.ljust, line, widths)).rstrip())
        print(f"sweep: {folder / TABLE}, {folder / PAGE}")


def _gather(config: DictConfig, folder: Path) -> list[list[str]]:
    """Writes table and page of the ended jobs: a head and one row each; returns [] for none.

    Where seeds differ, each row also has the mean and deviation over the seeds of its settings.
    """
    found = _records(folder)
    rows = [{"job": path.parent.name, **row} for path, row in found if "metric" in row]
    if not rows:
        return []
    said = [dict(word.partition("=")[::2] for word in row["words"]) for row in rows]
    keys = [key for key in said[0] if len({str(words.get(key)) for words in said}) > 1]
    measure = config.get("optimized_metric") or "loss"
    failed = any("failed" in row for row in rows)
    head, body = ["job", *keys, measure, *(["failed"] if failed else [])], []
    settings: dict[tuple[str, ...], list[tuple[list[str], Any]]] = {}
    for row, words in sorted(zip(rows, said, strict=True), key=_order):
        body.append([str(row["job"]), *(words.get(key, "") for key in keys), _text(row["metric"])])
        body[-1] += [row.get("failed", "")] if failed else []
        setting = tuple(words.get(key, "") for key in keys if key != "seed")
        settings.setdefault(setting, []).append((body[-1], row["metric"]))
    seeded = "seed" in keys
    if seeded:  # of the jobs that differ by their seeds alone
        head += ["seeds", "mean", "deviation"]
        for jobs in settings.values():
            for line, _ in jobs:
                line += _spread([metric for _, metric in jobs])
    text = StringIO(newline="")
    csv.writer(text).writerows([head, *body])
    write_text(folder / TABLE, text.getvalue())
    tables = [("jobs", "Jobs", head, body)]
    if seeded:
        rest = [key for key in keys if key != "seed"] or ["configuration"]
        grouped = [
            [*(setting or ["all jobs"]), *_spread([metric for _, metric in jobs])]
            for setting, jobs in settings.items()
        ]
        grouped.sort(key=lambda line: float(line[-2] or "inf"))
        told = [*rest, "seeds", f"mean of {measure}", "deviation"]
        tables.insert(0, ("seeds", "By configuration, over seeds", told, grouped))
    _page(folder, tables)
    return [head, *body]


def _text(metric: Any) -> str:
    return f"{metric:.5g}" if isinstance(metric, int | float) else ""


def _spread(metrics: Sequence[Any]) -> list[str]:
    """Number of seeds with a finite result, their mean, and their sample deviation."""
    known = [float(m) for m in metrics if isinstance(m, int | float) and math.isfinite(m)]
    mean = _text(statistics.fmean(known)) if known else ""
    return [str(len(known)), mean, _text(statistics.stdev(known)) if len(known) > 1 else ""]


def _page(folder: Path, tables: Sequence[tuple[str, str, list[str], list[list[str]]]]) -> None:
    """Writes the tables as a page."""
    from tactileforge.pages import Section, facts, html_page, next_commands, table

    sections = [
        Section(name, title, table(f"table-{name}", head, rows))
        for name, title, head, rows in tables
    ]
    best = f"{folder.as_posix()}/{tables[-1][3][0][0]}" if tables[-1][3] else "RUN"
    onward = [
        (f"tactileforge report {best}", "the report of the best job"),
        (f"tactileforge train resume={best} trainer.max_steps=STEPS", "train it on"),
        (f"tactileforge zoo pack {best}", "pack it into one file for others"),
    ]
    sections.append(next_commands(onward))
    about = {"Folder": str(folder), "Jobs that have ended": str(len(tables[-1][3]))}
    write_text(folder / PAGE, html_page(f"Sweep {folder.name}", facts(about), sections))


def _order(pair: tuple[dict[str, Any], dict[str, str]]) -> tuple[float, int, str]:
    """The smallest number first; jobs without one last."""
    metric = pair[0]["metric"]
    known = isinstance(metric, int | float) and math.isfinite(metric)
    job = pair[0]["job"]
    return (float(metric) if known else math.inf), len(job), job  # job 9 before job 10
