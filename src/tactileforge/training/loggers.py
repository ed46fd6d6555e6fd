"""Loggers of a run: its own CSV file, and TensorBoard, Weights & Biases or MLflow beside it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities import rank_zero_only

from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.pages.curves import METRICS, metric_rows
from tactileforge.pages.drawings import Drawing
from tactileforge.plugins import local, registry
from tactileforge.util.files import write_text
from tactileforge.util.untrusted import dump_yaml

#: File with MLflow's identity of the run, for its resumption.
MLFLOW_RUN = "mlflow_run.txt"


class CannotLogError(OSError):
    """Failure of a logger in a run; the run is saved first."""


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Raises any error of a logger as a `CannotLogError` with its name."""
    try:
        yield
    except Exception as error:  # loggers of other packages raise what they like
        why = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise CannotLogError(f"logger={name} cannot write ({why})") from error


def _guarded(logger: Logger, name: str) -> Logger:
    """The logger, with its name in its errors."""
    for method in ("log_metrics", "save", "after_save_checkpoint", "finalize"):
        setattr(logger, method, _named(name)(getattr(logger, method)))
    return logger


class MetricsFile(Logger):
    """Writes ``metrics.csv``, one row at each logging.

    A resumed run continues the file. Rows of steps that it repeats are dropped, as is a row cut off
    by a killed process.

    Args:
        folder: Folder of the run.
        step: Optimiser steps taken before; 0 for a new run.
    """

    def __init__(self, folder: Path, step: int = 0) -> None:
        super().__init__()
        self.path = folder / METRICS
        self._step = step
        self._keys: set[str] | None = None

    @property
    def name(self) -> str:
        """Name of the file."""
        return METRICS

    @property
    def version(self) -> str:
        """Empty: a run has one file."""
        return ""

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:
        """Does nothing: the configuration is in ``config.yaml``."""

    @rank_zero_only
    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Appends a row; rewrites the whole file if the row has new names."""
        row: dict[str, Any] = {"step": step, **metrics}
        if self._keys is not None and row.keys() <= self._keys:
            with self.path.open("a", newline="", encoding="utf-8") as file:
                file.write(_text([row], self._keys))
            return
        # a CSV file has one head: a new name, such as that of an objective that wakes up, needs
        # another
        rows: list[dict[str, Any]] = metric_rows(self.path)
        if self._keys is None:
            rows = [kept for kept in rows if int(kept["step"]) < self._step]
        self._keys = {key for kept in [*rows, row] for key in kept}
        write_text(self.path, _text([*rows, row], self._keys, head=True))


def _text(rows: Iterable[Mapping[str, Any]], keys: Iterable[str], head: bool = False) -> str:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, sorted(keys), lineterminator="\n")
    if head:
        writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def build_loggers(
    config: Mapping[str, Any], folder: Path, run: str | None = None, step: int = 0
) -> list[Logger]:
    """Builds the logger of the CSV file, and the configured one; a resumed run continues both.

    Args:
        config: Options of the logger: ``name`` (csv, tensorboard, wandb, mlflow) and ``project``,
            or those of one's own.
        folder: Folder of the run.
        run: Identity of the run; see `run_folder.identity`.
        step: Optimiser steps taken before; 0 for a new run.
    """
    loggers: list[Logger] = [_guarded(MetricsFile(folder, step), "csv")]
    name, project = config["name"], config.get("project", "tactileforge")
    if name == "tensorboard":
        from lightning.pytorch.loggers import TensorBoardLogger

        options: dict[str, Any] = {"name": "tensorboard", "version": "", "default_hp_metric": False}
        if step:
            options["purge_step"] = step  # hides the steps that are taken again
        loggers.append(TensorBoardLogger(folder, **options))
    elif name == "wandb":
        from lightning.pytorch.loggers import WandbLogger

        # allow, not must: the first start of the run has nothing to resume
        loggers.append(WandbLogger(project=project, save_dir=folder, id=run, resume="allow"))
    elif name == "mlflow":
        from lightning.pytorch.loggers import MLFlowLogger

        # MLflow chooses the identity of a run itself, so it is kept beside the run
        kept = folder / MLFLOW_RUN
        known = kept.read_text("utf-8").strip() if step and kept.is_file() else None
        loggers.append(MLFlowLogger(project, save_dir=str(folder / "mlflow"), run_id=known))
    elif name != "csv":
        loggers.append(own_logger(config))
    return [*loggers[:1], *(_guarded(logger, name) for logger in loggers[1:])]


def own_logger(config: Mapping[str, Any]) -> Logger:
    """Builds a logger of a package, or of the user's own.

    Args:
        config: Its name, and the arguments of its constructor.

    Raises:
        PluginError: It is not installed, or is not a logger of Lightning.
        ConfigError: An unknown option, or one that its constructor refuses.
    """
    name = str(config["name"])
    if not local.is_local(name) and name not in (known := registry.names("loggers")):
        own = ("csv", "tensorboard", "wandb", "mlflow")
        fix = "A class of yours is my_module:Logger"
        raise PluginError(unknown("logger", name, (*own, *known), fix))
    try:
        made = registry.build("loggers", config, "logger")
    except (TypeError, ValueError) as error:
        raise ConfigError(f"logger: {error}") from error
    if not isinstance(made, Logger):
        raise PluginError(f"logger={name} is not a lightning.pytorch.loggers.Logger")
    return made


@rank_zero_only
def log_config(loggers: Iterable[Logger], config: Mapping[str, Any], folder: Path) -> None:
    """Gives the resolved configuration to every logger, flat by key and whole as YAML.

    Raises:
        ConfigError: Weights & Biases has no key, and is not offline.
    """
    from lightning.pytorch.loggers import MLFlowLogger, TensorBoardLogger

    for logger in loggers:
        with _wandb_explained():
            logger.log_hyperparams(dict(config))  # the first call of a logger, which starts it
        if isinstance(logger, TensorBoardLogger):
            text = "".join(f"    {line}\n" for line in dump_yaml(dict(config)).splitlines())
            logger.experiment.add_text("config", text)
        elif isinstance(logger, MLFlowLogger):
            write_text(folder / MLFLOW_RUN, str(logger.run_id))
            logger.experiment.log_dict(logger.run_id, dict(config), "config.yaml")


@contextmanager
def _wandb_explained() -> Iterator[None]:
    """Says how to go on without a key of Weights & Biases."""
    try:
        yield
    except Exception as error:
        # wandb is not imported for its classes of errors: it may not be installed
        if type(error).__name__ not in ("UsageError", "AuthenticationError", "CommError"):
            raise
        raise ConfigError(
            f"logger=wandb: {' '.join(str(error).split())}. Without a key (WANDB_API_KEY=, wandb "
            "login) set WANDB_MODE=offline: it logs into the run's folder, and wandb sync sends it"
        ) from error


@rank_zero_only
def log_report(
    loggers: Iterable[Logger], report: Path, drawings: Iterable[Drawing], step: int
) -> None:
    """Logs the report's figures everywhere but in the CSV file, and its page in MLflow.

    Args:
        loggers: Loggers of the run.
        report: Page of the report.
        drawings: Figures of the report.
        step: Step of the report.

    Raises:
        CannotLogError: A logger cannot write.
    """
    for logger in loggers:
        with _named(type(logger).__name__.removesuffix("Logger").lower()):
            _log_report(logger, report, drawings, step)


def _log_report(logger: Logger, report: Path, drawings: Iterable[Drawing], step: int) -> None:
    from lightning.pytorch.loggers import MLFlowLogger, TensorBoardLogger, WandbLogger

    if isinstance(logger, TensorBoardLogger):
        for drawing in drawings:
            name = f"report/{drawing.name}"
            logger.experiment.add_image(name, drawing.pixels, step, dataformats="HWC")
        logger.experiment.flush()
    elif isinstance(logger, WandbLogger):
        for drawing in drawings:
            logger.log_image(f"report/{drawing.name}", [drawing.pixels])
    elif isinstance(logger, MLFlowLogger):
        for drawing in drawings:
            path = f"report/{drawing.name}.png"
            logger.experiment.log_image(logger.run_id, drawing.pixels, path)
        logger.experiment.log_artifact(logger.run_id, str(report))
