"""Writes the report of a run: one HTML file."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tactileforge.data.batches.clips import Skipped
from tactileforge.data.batches.columns import plain_sizes
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import ConfigError
from tactileforge.pages.curves import Curve, read_metrics
from tactileforge.pages.page import Section, html_page, next_commands
from tactileforge.report import captions, classes, embedding, forces, sections, summary
from tactileforge.report.findings import RunFindings, run_findings
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import read_checkpoint, read_own
from tactileforge.training.labels import Labels
from tactileforge.training.module import TouchModule
from tactileforge.util.files import write_text


def report_of_run(folder: Path, change: Callable[[dict[str, Any]], None] | None = None) -> Path:
    """Writes the report of a run again, from the files in its folder.

    Args:
        folder: Folder of the run, with ``config.yaml`` and ``checkpoints/last.ckpt``. The training
            data must still be in its place, or ``change`` say where it is.
        change: Changes the configuration that is read from the folder, in place.

    Returns:
        Path of the report.

    Raises:
        DataNotFoundError: The folder is not of a run, or the data is missing.
        ConfigError: The checkpoint does not fit the configuration.
    """
    from tactileforge.training.assemble import build_data

    config = run_folder.read_config(folder)
    if change is not None:
        change(config)
    state = read_own(folder, config.get("run"), ("skipped", "labels"))
    data, _ = build_data(config)
    assert data.train is not None  # set up by `build_data`
    config["facts"], config["columns"] = dict(data.train.facts), plain_sizes(data.columns)
    module = TouchModule.from_config(config, data.summary("train").labels)
    try:
        module.load_state_dict(state["state_dict"])
    except RuntimeError as error:
        raise ConfigError(f"{folder}: the checkpoint does not fit config.yaml: {error}") from error
    return write_report(folder, module, data, state["skipped"], Labels(state["labels"]))[0]


def write_report(
    folder: Path, module: TouchModule, data: TouchData, skipped: Skipped, labels: Labels
) -> tuple[Path, list[str]]:
    """Writes ``report.html`` of a finished run.

    The report depends only on the weights, the data and the files of the run, so writing it twice
    gives the same file. Neither the random generators nor the module change.

    Args:
        folder: Folder of the run.
        module: Trained module.
        data: Data of the run, set up.
        skipped: Recordings that training could not read.
        labels: Counts of the labels seen by each objective in training.

    Returns:
        Path of the report, and the result in lines for the terminal.
    """
    config = run_folder.read_config(folder)
    curves = read_metrics(folder)
    steps, seconds = _progress(folder, curves)
    weights = {key: float(node["weight"]) for key, node in config["objective"].items()}
    assert data.train is not None
    facts = data.train.facts
    # a short run has a short report: not more clips are read than it was trained on
    learned = max(1, steps) * config["batch"]["size"]
    findings = run_findings(module, data, skipped, learned) if data.train.is_touch else None
    lines = [line for line, _ in (data.skipped | dict(skipped)).values()]
    lines = lines if findings is None else findings.skipped
    kept = run_folder.read_versions(folder)
    top = summary.run_facts(folder, config, module, data, steps, seconds, curves, kept)
    held_out = data.val is not None
    top += summary.checks_table(data.findings)
    top += summary.run_verdict(curves, weights, findings, labels, held_out, lines)
    planned = int(config["trainer"].get("max_steps") or 0)  # -1 and null: by epochs
    parts = [
        *_of_clips(findings, data, curves, steps),
        sections.losses(curves, list(weights), steps),
        *sections.balance(curves, list(weights), steps),
        *([sections.facts(facts)] if facts else []),
        sections.data_section(data, lines),
        sections.recipe(folder),
        next_commands(_next(folder, steps, planned, data)),
    ]
    report = folder / "report.html"
    what = "Heads on a frozen touch encoder" if config.get("freeze") else "Touch encoder"
    title = f"{what}, trained with {', '.join(weights)}"
    write_text(report, html_page(title, top, parts))
    return report, summary.result_lines(findings, curves, weights)


def _next(folder: Path, steps: int, planned: int, data: TouchData) -> list[tuple[str, str]]:
    """Next commands for a run, also for one ended before its planned number of steps."""
    run = shlex.quote(folder.as_posix())
    sensors = data.summary("train").sensors
    sensor = sensors[0] if sensors else "SENSOR"
    again = f"tactileforge train resume={run}"
    further = (
        (again, f"go on to step {planned}, where it was to end")
        if steps < planned
        else (f"{again} trainer.max_steps={2 * steps}", "train it further")
    )
    return [
        further,
        (f"tactileforge live model=run:{run} sensor={sensor}", "watch what it reads of a sensor"),
        (f"tactileforge zoo pack {run}", "pack it into one file for others"),
    ]


def _of_clips(
    findings: RunFindings | None, data: TouchData, curves: Mapping[str, Curve], steps: int
) -> list[Section]:
    """Sections on the module's outputs for single clips; none for data other than touch."""
    if findings is None:
        return []
    nearest = findings.captions  # None for a run without alignment
    # what matters most of a run comes first
    first = []
    if findings.forces:
        first.append(forces.forces_section(findings.forces, data, curves, steps))
    if findings.classes:
        first.append(classes.classes_section(findings.classes, findings.clips))
    return [
        *first,
        sections.frames(findings),
        embedding.embedding_section(findings.embedding, findings.scores),
        *([captions.captions_section(nearest, findings.strips)] if nearest else []),
    ]


def _progress(folder: Path, curves: Mapping[str, Curve]) -> tuple[int, float | None]:
    """Number of steps, and seconds of training over all restarts; None if not recorded."""
    if not (folder / run_folder.LAST).is_file():
        # steps are logged from 0 on
        return max((int(curve.steps[-1]) + 1 for curve in curves.values()), default=0), None
    state = read_checkpoint(folder)
    timer = state.get("callbacks", {}).get("JobTimer", {})
    seconds = timer.get("time_elapsed", {}).get("train")
    return int(state["global_step"]), seconds
