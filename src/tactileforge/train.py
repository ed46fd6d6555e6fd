"""``tactileforge train``: one run, from a finished configuration to a report."""

from __future__ import annotations

import logging
import platform
import re
import shlex
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import lightning as L
from omegaconf import DictConfig, OmegaConf

from tactileforge import curriculum, precision, registry, run_folder
from tactileforge.assemble import build_data
from tactileforge.callbacks.checkpoints import Checkpoints
from tactileforge.callbacks.met import MetLabels, SkippedRecordings
from tactileforge.checkpoint_file import (
    RESUMED,
    find_checkpoint,
    initialise,
    left_out,
    read_checkpoint,
    read_own,
)
from tactileforge.compiled import compile_blocks
from tactileforge.data.batches.columns import plain_sizes
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.files import sealed, write_text
from tactileforge.finite import NotFiniteError
from tactileforge.initial import check_facts, new_in, start_from, warn_of_dropped
from tactileforge.loggers import log_config, log_report
from tactileforge.module import TouchModule
from tactileforge.pages.drawings import collected_drawings
from tactileforge.precompute import remember_features
from tactileforge.provenance import commit
from tactileforge.run_length import change_run
from tactileforge.strategies import Sharded
from tactileforge.threads import flushed
from tactileforge.trainer import build_trainer, check_options

log = logging.getLogger(__name__)

#: Packages with their versions recorded in a run.
_PACKAGES = ("tactileforge", "torch", "lightning", "hydra-core", "kornia", "numpy")

#: Messages of torch after the loss of a process of the group.
_LOST = re.compile(r"closed by peer|reset by peer|Connection refused|NCCL|Broken pipe", re.I)

#: Warnings of Lightning about intended behaviour.
_EXPECTED = (
    r".*isinstance\(treespec, LeafSpec\).*",
    r"Found \d+ module\(s\) in eval mode at the start of training.*",  # frozen towers, EMA copies
    r"The number of training batches .* is smaller than the logging interval.*",
    r"The '\w+_dataloader' does not have many workers.*",
    r"Total length of `list` across ranks is zero.*",  # nothing is held out: the run itself says so
    r"It is recommended to use `self.log\('val/.*",  # values are those of all processes already
    r"Checkpoint directory .* exists and is not empty.*",  # a resumed run
)


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
        step, is_news = 0, True
        if resume:
            state = read_own(resume, plain.get("run"), RESUMED)  # before data is made or read
            step = int(state["global_step"])
            is_news = change_run(plain, run_folder.read_config(folder), state)
            if 0 < plain["trainer"]["max_steps"] <= step:
                log.info("the run has ended at step %d; to go further: trainer.max_steps=", step)
        else:
            plain["run"] = run_folder.identity()
            plain["data"] = run_folder.anywhere(plain["data"])
        return _train(plain, folder, resume, step, is_news)


def _train(
    plain: dict[str, Any], folder: Path, resume: Path | None, step: int, is_news: bool
) -> TouchModule:
    if not isinstance(plain["seed"], int) or plain["seed"] < 0:
        raise ConfigError(f"seed={plain['seed']}: give a whole number, 0 or more")
    L.seed_everything(plain["seed"], verbose=False)
    state = None if resume else start_from(plain)
    check_options(plain)
    # Mistakes are named before data is made or read; the length of the run is not known yet.
    weights = {key: node["weight"] for key, node in plain["objective"].items()}
    curriculum.from_config(plain["curriculum"], weights, total=sys.maxsize, epoch=1)
    data, plain["encoder"] = build_data(plain)
    assert data.train is not None  # set up by `build_data`
    plain["facts"], plain["columns"] = dict(data.train.facts), plain_sizes(data.columns)
    check_facts(plain)
    module = TouchModule.from_config(plain, data.summary("train").labels, data.augment)
    lost, met = SkippedRecordings(data.allowed), MetLabels(module)
    lost.skip(data.skipped)
    data.observers += [met.observe, lost.observe]
    if state is not None:
        log.info(initialise(module, state, new_in(str(plain["init"]))))
        warn_of_dropped(plain, left_out(module, state))
    if not resume:  # a resumed run has the measurements in its checkpoint
        module.prepare(data.train)
    if plain["freeze"]:
        if resume:  # needed for the tokens now; Lightning loads the other weights in fit
            kept = read_checkpoint(resume)["state_dict"].items()
            own = {k.removeprefix("encoder."): v for k, v in kept if k.startswith("encoder.")}
            module.encoder.load_state_dict(own)
        remember_features(module.encoder, data)
    why = _settle_precision(plain, module, data)
    if plain.get("compile"):
        compile_blocks(module)
    static = getattr(module.encoder, "static_graph", False)
    trainer, saver = build_trainer(plain, folder, [met, lost], step, static)
    if resume and is_news and trainer.is_global_zero:
        run_folder.write_config(folder, {**plain, "resume": None})
    if is_news:
        log_config(trainer.loggers[1:], plain, folder)
    if trainer.is_global_zero and not resume:
        licences = {kind.licence for split in data.sources for kind in data.summary(split)}
        _keep(plain, folder, sorted(licences), data.summary("train").sensors, why)
    with warnings.catch_warnings():
        for message in _EXPECTED:
            warnings.filterwarnings("ignore", message)
        try:
            with _resumed_from(resume, saver):
                trainer.fit(module, data, ckpt_path=resume, weights_only=True)
        except NotFiniteError as error:
            raise NotFiniteError(f"{error}. {_way_back(folder, trainer.precision)}") from error
        except RuntimeError as error:
            if trainer.world_size == 1 or not _LOST.search(str(error)):
                raise
            raise TactileForgeError(
                f"another process of the run has died ({_first_line(error)}). {_kept(folder)}"
            ) from error
        except SystemExit as stop:  # Lightning turns Ctrl-C into it
            done = trainer.global_step
            when = f"in the step after {done}" if done > step else "before the first step"
            raise KeyboardInterrupt(f"{stop.__context__ or 'stopped'} {when}") from stop
        except ValueError as error:
            if "val_check_interval" not in str(error):  # Lightning's check against the data
                raise
            raise ConfigError(f"trainer.val_check_interval: {error}") from error
    if saver.interrupted:
        raise KeyboardInterrupt(f"stopped at step {trainer.global_step}")
    if trainer.is_global_zero:
        from tactileforge.report.run import write_report

        whole = _whole(plain, module, folder, data.summary("train").labels)
        with collected_drawings(wanted=len(trainer.loggers) > 1) as drawings:
            report = write_report(folder, whole, data, lost.skipped, met.labels)
        log_report(trainer.loggers[1:], report, drawings, trainer.global_step)
        print(f"report: {report}")
    return module


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0][:120]


def _kept(folder: Path) -> str:
    """Advice on how to continue an interrupted run."""
    if not (folder / run_folder.LAST).is_file():
        return "Nothing was saved before: give the same command again"
    return f"Go on from its checkpoint: tactileforge train resume={shlex.quote(str(folder))}"


def _way_back(folder: Path, numbers: str) -> str:
    """Advice on the last checkpoint of a run with non-finite numbers, with its commands."""
    exact = "" if numbers.startswith("32") else " trainer.precision=32"
    if not (folder / run_folder.LAST).is_file():
        also = f" or{exact}" if exact else ""
        return f"Nothing was saved before: start again with a smaller optim.lr={also}"
    step = read_checkpoint(folder)["global_step"]
    name = shlex.quote(str(folder))
    return (
        f"The checkpoint of step {step} stays: go back to it with tactileforge train resume={name}"
        f"{exact}, or start from it with init={name} and a smaller optim.lr="
    )


@contextmanager
def _resumed_from(resume: Path | None, saver: Checkpoints) -> Iterator[None]:
    """Names the checkpoint in errors about its content, before the first resumed step."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RuntimeError) as error:
        if resume is None or saver.started:
            raise
        raise ConfigError(
            f"{resume}: the run cannot go on with it ({error!r}): it is whole, but was changed or "
            "is of another program; start a new run from its weights with init="
        ) from error


def _whole(
    plain: dict[str, Any], module: TouchModule, folder: Path, labels: AbstractSet[str]
) -> TouchModule:
    """The module with all its weights on this process, from the checkpoint of a sharded run."""
    if not isinstance(module.trainer.strategy, Sharded):
        return module
    whole = TouchModule.from_config(plain, labels)
    whole.load_state_dict(read_checkpoint(folder)["state_dict"])
    return whole


def _settle_precision(plain: dict[str, Any], module: TouchModule, data: TouchData) -> str:
    """Puts the precision into the configuration, for resumed runs too; returns the reason."""
    assert data.train is not None
    measure = partial(precision.step_times, module, data.train)
    chosen = precision.choose_precision(plain["trainer"], measure)
    plain["trainer"] = {**plain["trainer"], "precision": chosen.name}
    log.info("trainer.precision=%s: %s", chosen.name, chosen.reason)
    return chosen.reason


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
    sensors: Sequence[str],
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
        "sensors": list(sensors),  # of the training data
        "precision": why,  # reason for the choice; the precision is in the configuration
        "commit": commit(),
    }
    write_text(folder / run_folder.VERSIONS, sealed(kept))
