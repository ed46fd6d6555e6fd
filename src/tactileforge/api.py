"""``tactileforge train``: one run, from a finished configuration to a report."""

from __future__ import annotations

import logging
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import lightning as L
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from tactileforge.data.batches.columns import plain_sizes
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.encoders.compiled import compile_blocks
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.pages.drawings import collected_drawings
from tactileforge.plugins import registry
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import (
    RESUMED,
    find_checkpoint,
    initialise,
    left_out,
    read_checkpoint,
    read_own,
)
from tactileforge.training import curriculum, precision
from tactileforge.training.assemble import build_data
from tactileforge.training.checkpoints import Checkpoints
from tactileforge.training.coverage import LabelCoverage, SkippedRecordings
from tactileforge.training.fitting import fit
from tactileforge.training.initial import check_facts, new_in, start_from, warn_of_dropped
from tactileforge.training.loggers import CannotLogError, log_config, log_report
from tactileforge.training.module import TouchModule
from tactileforge.training.parts import outline
from tactileforge.training.precompute import remember_features
from tactileforge.training.run_length import change_run
from tactileforge.training.strategies import ShardedStrategy
from tactileforge.training.trainer import build_trainer, check_options
from tactileforge.util.files import sealed, write_text
from tactileforge.util.provenance import commit
from tactileforge.util.threads import flushed

log = logging.getLogger(__name__)

#: Packages with their versions recorded in a run.
_PACKAGES = ("tactileforge", "torch", "lightning", "hydra-core", "kornia", "numpy")


def train(config: DictConfig | dict[str, Any], folder: Path) -> TouchModule:
    """Trains, and writes a report.

    In ``folder``: ``config.yaml`` (resolved), ``versions.json``, ``metrics.csv``,
    ``checkpoints/last.ckpt`` and ``report.html``.

    Args:
        config: Finished configuration; see `compose.finish`. With ``resume``, the configuration of
            the run in ``folder``; see `run_folder.read_config`.
        folder: Folder of the run.

    Returns:
        The trained module.

    Raises:
        TactileForgeError: Configuration, data or weights are invalid, training has left the finite
            numbers, or another process has died; states the fix.
        KeyboardInterrupt: The run was stopped and saved; ``resume=`` continues it.
    """
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    plain: dict[str, Any] = config if isinstance(config, dict) else _plain(config)
    resume = find_checkpoint(folder) if plain.get("resume") else None
    with run_folder.claimed(folder, resumes=resume is not None), flushed():
        step, is_news, known = 0, True, {}
        if resume:
            state = read_own(resume, plain.get("run"), RESUMED)  # before data is made or read
            step = int(state["global_step"])
            known = run_folder.read_config(folder)
            # data that moved is news: the next command has to find it
            is_news = change_run(plain, known, state) or plain["data"] != known["data"]
            if 0 < plain["trainer"]["max_steps"] <= step:
                log.info("the run has ended at step %d; to go further: trainer.max_steps=", step)
        else:
            plain["run"] = run_folder.identity()
            plain["data"] = run_folder.anywhere(plain["data"])
        weights = _check(plain, resume)
        run, why = _build(plain, folder, resume, step, weights)
        _note(run, why, is_news)
        try:
            fit(run.trainer, run.module, run.data, run.saver, folder, resume, step)
        except ConfigError:
            if known and run.trainer.global_step == step:  # other data: the run stays as it was
                run_folder.write_config(folder, known)
            raise
        if run.trainer.is_global_zero:
            _report(run)
        return run.module


@dataclass(frozen=True)
class _Run:
    """A run, ready to start.

    Attributes:
        config: Resolved configuration, with the sensors, columns and facts of its data, and its
            precision.
        folder: Folder of the run.
        resume: Checkpoint to resume from; None for a new run.
        step: Optimiser steps taken before; 0 for a new run.
        data: Data of the run, indexed.
        module: Module with its first weights.
        trainer: Lightning's trainer.
        saver: Callback that saves checkpoints.
        lost: Callback that counts recordings that cannot be read.
        coverage: Callback that counts the labels of each objective.
    """

    config: dict[str, Any]
    folder: Path
    resume: Path | None
    step: int
    data: TouchData
    module: TouchModule
    trainer: L.Trainer
    saver: Checkpoints
    lost: SkippedRecordings
    coverage: LabelCoverage


def _check(plain: dict[str, Any], resume: Path | None) -> Mapping[str, Tensor] | None:
    """Checks the configuration before data is made or read; returns a new run's first weights.

    The encoder of a zoo model is taken with its options.
    """
    if not isinstance(plain["seed"], int) or plain["seed"] < 0:
        raise ConfigError(f"seed={plain['seed']}: give a whole number, 0 or more")
    L.seed_everything(plain["seed"], verbose=False)
    state = None if resume else start_from(plain)
    check_options(plain)
    weights = {key: node["weight"] for key, node in plain["objective"].items()}
    # the length of the run is not known yet
    curriculum.from_config(plain["curriculum"], weights, total=sys.maxsize, epoch=1)
    return state


def _build(
    plain: Mapping[str, Any],
    folder: Path,
    resume: Path | None,
    step: int,
    state: Mapping[str, Tensor] | None,
) -> tuple[_Run, str]:
    """Builds data, module and trainer; also returns the reason for the precision."""
    data, encoder = build_data(plain, outline(_first_node(plain["encoder"], resume)))
    assert data.train is not None  # set up by `build_data`
    found = {"facts": dict(data.train.facts), "columns": plain_sizes(data.columns)}
    config = {**plain, **found, "encoder": encoder}
    check_facts(config)
    built = {**config, "encoder": _first_node(encoder, resume)}
    module = TouchModule.from_config(built, data.summary("train").labels, data.augment)
    lost, coverage = SkippedRecordings(data.allowed), LabelCoverage(module)
    lost.skip(data.skipped)
    data.observers += [coverage.observe, lost.observe]
    if state is not None:
        new = new_in(str(config["init"]), state)
        log.info(initialise(module, state, new))
        warn_of_dropped(config, left_out(module, state, new))
    if not resume:  # a resumed run has the measurements in its checkpoint
        module.prepare(data.train)
    if config["freeze"]:
        if resume:  # needed for the tokens now; Lightning loads the other weights in fit
            kept = read_checkpoint(resume)["state_dict"].items()
            own = {k.removeprefix("encoder."): v for k, v in kept if k.startswith("encoder.")}
            module.encoder.load_state_dict(own)
        remember_features(module.encoder, data)
    measure = partial(precision.step_times, module, data.train)
    # measured before blocks are compiled; a resumed run keeps the precision of its start
    chosen = precision.choose_precision(config["trainer"], measure)
    log.info("trainer.precision=%s: %s", chosen.name, chosen.reason)
    config["trainer"] = {**config["trainer"], "precision": chosen.name}
    if config.get("compile"):
        compile_blocks(module)
    static = getattr(module.encoder, "static_graph", False)
    trainer, saver = build_trainer(config, folder, [coverage, lost], step, static)
    run = _Run(config, folder, resume, step, data, module, trainer, saver, lost, coverage)
    return run, chosen.reason


def _first_node(encoder: Mapping[str, Any], checkpoint: Path | None) -> dict[str, Any]:
    """The encoder's node; where a checkpoint has its weights, no others are read or fetched."""
    return registry.without_start("encoders", encoder) if checkpoint else dict(encoder)


def _note(run: _Run, why: str, is_news: bool) -> None:
    """Writes the configuration of a new run, or of a resumed run with changes."""
    if run.resume and is_news and run.trainer.is_global_zero:
        run_folder.write_config(run.folder, {**run.config, "resume": None})
    if is_news:
        log_config(run.trainer.loggers[1:], run.config, run.folder)
    if run.trainer.is_global_zero and not run.resume:
        data = run.data
        licences = {kind.licence for split in data.sources for kind in data.summary(split)}
        _keep(run.config, run.folder, sorted(licences), data, why)


def _report(run: _Run) -> None:
    from tactileforge.report.run import write_report

    whole = run.module
    if isinstance(whole.trainer.strategy, ShardedStrategy):
        # this process has a share of the weights; all of them are in the checkpoint
        config = {**run.config, "encoder": _first_node(run.config["encoder"], run.folder)}
        whole = TouchModule.from_config(config, run.data.summary("train").labels)
        whole.load_state_dict(read_checkpoint(run.folder)["state_dict"])
    loggers = run.trainer.loggers
    with collected_drawings(wanted=len(loggers) > 1) as drawings:
        report, lines = write_report(
            run.folder, whole, run.data, run.lost.skipped, run.coverage.labels
        )
    try:
        log_report(loggers[1:], report, drawings, run.trainer.global_step)
    except CannotLogError as error:
        raise TactileForgeError(f"{error}; the run is whole, with its report: {report}") from error
    print("\n".join([f"report: {report}", *lines]))


def metric(module: TouchModule, name: str | None = None) -> float:
    """The metric minimised by a sweep, at the last validation.

    Args:
        module: Module after its training.
        name: Name in the metrics, for example ``val/force``; None for the sum of all validation
            losses, or of all training losses if nothing is held out.

    Raises:
        ConfigError: No metric of that name was logged.
    """
    logged = module.trainer.callback_metrics
    if name and name not in logged:
        raise ConfigError(unknown("metric", name, [key for key in logged if "/" in key]))
    if name:
        return float(logged[name])
    losses = [
        [float(logged[f"{split}/{key}"]) for key in module.objectives if f"{split}/{key}" in logged]
        for split in ("val", "train")
    ]
    return sum(losses[0] or losses[1] or [float("nan")])


def _plain(config: DictConfig) -> dict[str, Any]:
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def _keep(
    config: Mapping[str, Any],
    folder: Path,
    licences: Sequence[str],
    data: TouchData,
    why: str,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    run_folder.write_config(folder, config)
    versions = {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()}
    plugins = {
        f"{plugin.kind}/{plugin.name}": f"{plugin.distribution} {plugin.version}"
        for plugin in registry.list_plugins()
    }
    kept = {
        "command": sys.argv,
        "versions": versions,
        "plugins": plugins,
        "licences": list(licences),  # of the recordings
        "sensors": data.summary("train").sensors,  # of the training data
        # names of the classes of a head, which keeps their numbers
        "objects": data.objects if "classify" in config["head"] else [],
        "precision": why,
        "commit": commit(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    write_text(folder / run_folder.VERSIONS, sealed(kept))
