"""Trains a recipe, and resumes a stopped run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactileforge.cli._command import Command
from tactileforge.cli._moved_data import put_in, taken_out
from tactileforge.cli._quote import quoted, unquoted
from tactileforge.cli._words import free_heads
from tactileforge.errors import ConfigError, command
from tactileforge.plugins.local import check_given, code_words, names_in, of_library
from tactileforge.training.run_length import LENGTHS, MACHINE


def _train(_: None, config: dict[str, Any]) -> float:
    """Trains a recipe; resume=RUN resumes a stopped run."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from tactileforge.runs.folder import LAST

    hydra = HydraConfig.get()
    words = list(hydra.overrides.task)
    if hydra.mode is not RunMode.MULTIRUN:
        return _run(config, Path(hydra.run.dir))
    from tactileforge.cli._job import run_job

    folder = Path(hydra.runtime.output_dir)
    if (folder / LAST).is_file():
        config = {**config, "resume": str(folder)}
    anew = [word for word in words if word.partition("=")[0] in _ANEW]
    return run_job(folder, config, words, anew, lambda: _run(config, folder, True))


def _run(config: dict[str, Any], folder: Path, sweeps: bool = False) -> float:
    """Trains and returns the number of the run; NaN for a run in a sweep that logged none."""
    from hydra.core.hydra_config import HydraConfig

    from tactileforge.runs.folder import LAST

    if config.get("resume"):
        config = resumed(config, HydraConfig.get().overrides.task)
    elif config.get("init"):
        _check_encoder(str(config["init"]))
    try:
        # this import takes seconds, so it is inside the try: the user may stop it
        from tactileforge.api import metric, train
        from tactileforge.training.trainer import is_time_over

        module = train(config, folder)
    except KeyboardInterrupt as stop:
        kept = (folder / LAST).is_file()
        said = str(stop) or "stopped"
        if not kept:
            early = "" if "step" in said else " before the first step"
            said += f"{early}; nothing was saved"
        again = _onward(config, folder) if kept else "the same command again"
        raise KeyboardInterrupt(f"{said}; go on with: {again}") from stop
    if is_time_over(module.trainer):
        step, again = module.trainer.global_step, _onward(config, folder)
        print(f"trainer.max_time is over at step {step} of {module.total}; go on with: {again}")
    try:
        return metric(module, config.get("optimized_metric"))
    except ConfigError:
        if not sweeps:
            raise
        return float("nan")


def resumed(config: dict[str, Any], typed: Sequence[str]) -> dict[str, Any]:
    """Configuration of the run in ``resume``, with what a resumed run may change.

    Args:
        config: Composed configuration.
        typed: ``key=value`` words of the user.
    """
    from tactileforge.plugins.recorded import check_installed
    from tactileforge.runs.folder import read_versions

    run = _of_run(config["resume"])
    check_given(run, str(config["resume"]))
    recorded = read_versions(Path(config["resume"])).get("plugins", {})
    check_installed(run, recorded, str(config["resume"]))
    put_in(run, _moved)
    given = {word.lstrip("+").partition("=")[0] for word in typed}
    for path in given.intersection(_ANEW):
        group, key = path.split(".")
        run[group] = {**run[group], key: config[group][key]}
    return run


def _onward(config: dict[str, Any], folder: Path) -> str:
    """Command that resumes a run, with the user's own classes in it."""
    own = [name for name in names_in(config) if not of_library(name)]
    return command("train", f"resume={folder}", *code_words(own))


def _check_encoder(init: str) -> None:
    """Refuses options of an encoder beside an ``init=`` model with its own encoder.

    Raises:
        ConfigError: Such an option was typed.
    """
    from hydra.core.hydra_config import HydraConfig

    from tactileforge.runs.folder import IMAGENET, OF_TRAINING, is_run, with_photographs

    init, _ = with_photographs(init)
    if init == IMAGENET or is_run(init):  # options are checked later, when weights are read
        return
    free = tuple(f"encoder.{key}=" for key in OF_TRAINING)
    typed = [w for w in HydraConfig.get().overrides.task if w.startswith(("encoder=", "encoder."))]
    if given := [word for word in typed if not word.startswith(free)]:
        raise ConfigError(
            f"init={init} brings its encoder with its options, so {' '.join(given)} cannot be "
            "given with it; leave that out, or start from random weights with init=null"
        )


#: Keys that a resumed run may change: its length, and options of the machine, which change neither
#: the data nor its order.
_ANEW = (
    *(f"trainer.{key}" for key in LENGTHS),
    "batch.workers",
    "batch.cache_mb",
    *(f"trainer.{key}" for key in MACHINE),
)


#: New folders of the data of the run to resume. Not left to Hydra: the run has another data set
#: than the configuration that it composes.
_moved: dict[str, str] = {}


def _prepare(overrides: list[str]) -> list[str]:
    """Keeps a resumed run in its folder and lets it change only its length and machine.

    An option of a head may be given even if the recipe does not name the head.
    """
    _moved.clear()  # those of an earlier command in this process
    overrides = free_heads(overrides)
    given = [word.partition("=")[2] for word in overrides if word.startswith("resume=")]
    folders = [unquoted(word).replace("\\=", "=") for word in given]
    if not folders or folders[-1] in ("", "null"):
        return overrides
    overrides, moved = taken_out(overrides)
    _moved.update(moved)
    free = ("resume=", "hydra.", *(f"{path}=" for path in _ANEW))
    given = [word for word in overrides if not word.lstrip("+").startswith(free)]
    if given:
        raise ConfigError(
            f"resume= goes on with the same run, so {' '.join(given)} cannot be given with it, but "
            f"for its length (trainer.max_steps=), its machine ({', '.join(_ANEW[2:])}) and the "
            "new place of the same data (data.root=); init= starts a new run from its weights"
        )
    _of_run(folders[-1])  # fails for a folder without a run, before Hydra makes one
    words = [word for word in overrides if not word.startswith("resume=")]
    name = quoted(folders[-1])  # a path may hold any character
    return [*words, f"resume={name}", f"hydra.run.dir={name}", "hydra.output_subdir=null"]


def _of_run(folder: str) -> dict[str, Any]:
    """Configuration of the run in a folder, with ``resume`` set to the folder."""
    from tactileforge.runs.folder import read_config

    return {**read_config(Path(folder)), "resume": folder}


def _finish(config: Any) -> Any:
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from tactileforge.cli._finish import finish

    if not HydraConfig.initialized():
        return finish(config)
    hydra = HydraConfig.get()
    return finish(config, hydra.overrides.task, sweeps=hydra.mode is RunMode.MULTIRUN)


COMMANDS = {"": Command(run=_train, yaml="train", prepare=_prepare, finish=_finish)}
