"""Runs commands as Hydra applications: once, or as the jobs of a sweep."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Collection
from itertools import pairwise
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from tactileforge.cli._command import Command, Result
from tactileforge.cli._compose import (
    check_claims,
    check_tasks,
    initialized,
    leave_out_others,
    without_layouts,
)
from tactileforge.cli._known import dotted_keys
from tactileforge.cli._options import own_places, places_of
from tactileforge.cli._quote import quoted
from tactileforge.cli._slips import told
from tactileforge.cli._sweep import JOB, stopped_sweep
from tactileforge.cli._words import Words
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.plugins import local
from tactileforge.util.processes import end_with_parent

#: Files in a folder before a run begins: those written by Hydra, and the run's own lock.
_BEFORE = {".hydra", ".lock", "train.log", JOB}


def run(verb: str, command: Command, words: Words) -> Result:
    """Runs a command as a Hydra application: once, or once for each combination given to ``-m``.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    import hydra
    from hydra.core.hydra_config import HydraConfig

    from tactileforge.cli._sources import register

    register()
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra raises its errors, reported here
    typed, launcher = sys.argv, os.getpid()
    places = [*words.code, *places_of(words.overrides, words.flags)]
    kept = _folders()
    results: list[Result] = []
    started: list[bool] = []
    # an error raised inside `task` would make Hydra print its own traceback, so it is kept here
    ended: list[BaseException] = []

    def task(config: DictConfig) -> Result:
        alone = HydraConfig.get().mode is not hydra.types.RunMode.MULTIRUN
        # processes started by a run repeat sys.argv: the command, or this job of a sweep alone
        task_words = [] if alone else HydraConfig.get().overrides.task
        sys.argv = typed if alone else [typed[0], *verb.split(), *places, *task_words]
        # a job in a process of its own, as joblib's launcher starts them
        if os.getppid() == launcher:
            end_with_parent(launcher)
        started.append(True)
        try:
            # a preset that the command itself composes: Hydra would print its own lines
            with told(verb, command, words, lambda: False):
                if local.given():
                    with initialized():
                        check_claims(name, HydraConfig.get().overrides.task)
                given_words = HydraConfig.get().overrides.task
                check_tasks(config, name, given_words)
                leave_out_others(config, name, given_words)
                given = command.completed(config, given_words)
                results.append(command.start(given))
            # a sweep keeps numbers, and an object for Python is none
            return results[-1] if isinstance(results[-1], int | float) else None
        except TactileForgeError as error:
            _forget(HydraConfig.get(), kept)
            if not alone:
                raise  # the sweep has to see the failure
            ended.append(error)
            return None

    name = command.declare(verb)
    _check_flags(words)
    # before Hydra names the folder of the sweep, which it does by the clock
    if command.yaml and words.sweeps and (folder := stopped_sweep(words.typed)):
        print(f"goes on with the sweep in {folder}; hydra.sweep.dir= starts another", flush=True)
        words.overrides.append(f"hydra.sweep.dir={quoted(str(folder))}")
    if verb == "train" and {("--cfg", "job"), ("-c", "job")} & {*pairwise(words.flags)}:
        return _show(command, words)
    sys.argv = ["tactileforge", *without_layouts(words.typed)]
    try:
        with told(verb, command, words, lambda: not started):
            conf = "pkg://tactileforge.conf"
            hydra.main(version_base="1.3", config_path=conf, config_name=name)(task)()
    # Hydra makes the folder of the run itself, before `task`, and wraps none of its errors
    except (FileExistsError, NotADirectoryError) as error:
        raise ConfigError(
            f"{error.filename}: a file is where a folder is wanted; give another hydra.run.dir="
        ) from error
    except FileNotFoundError as error:
        if started or error.filename is None:
            raise
        raise ConfigError(
            f"{error.filename}: no folder can be made there; give another hydra.run.dir="
        ) from error
    finally:
        sys.argv = typed
        HydraConfig.instance().cfg = None  # the next command does not search this one's places
    if ended:
        raise ended[0]
    return results[-1] if results else None


def _show(command: Command, words: Words) -> None:
    """Prints the configuration of a run: Hydra shows what it composes, and a run completes that."""
    from omegaconf import OmegaConf

    from tactileforge.cli._compose import composed
    from tactileforge.cli._finish import finish
    from tactileforge.cli._known import check_types
    from tactileforge.cli._sources import SearchPath

    overrides, SearchPath.also = own_places(words.overrides, words.flags)
    try:
        with told("train", command, words):
            config = finish(composed("train", overrides), overrides)
    finally:
        SearchPath.also = []
    check_types(config)
    flags = dict(pairwise(words.flags))
    place = flags.get("--package", flags.get("-p", ""))
    shown = OmegaConf.select(config, place) if place else config
    if not OmegaConf.is_config(shown):
        raise ConfigError(unknown("block", place, (key for key in dotted_keys(config))))
    print(OmegaConf.to_yaml(shown, resolve=bool({"--resolve", "-r"} & {*words.flags})), end="")


def _forget(hydra: Any, kept: Collection[Path]) -> None:
    """Removes the folder of a failed start, unless it holds more than Hydra's own files.

    Args:
        hydra: Hydra's settings of the start.
        kept: Folders of runs that were there before it.
    """
    from tactileforge.runs.folder import is_claimed

    folder = Path(hydra.runtime.output_dir)
    begun = hydra.output_subdir is None or not folder.is_dir() or is_claimed(folder)
    if begun or not {item.name for item in folder.iterdir()} <= _BEFORE:
        return
    shutil.rmtree(folder)
    runs = Path("runs").absolute()
    for parent in folder.parents:
        made = parent not in kept and parent.is_relative_to(runs)
        if not made or next(parent.iterdir(), None):
            return
        parent.rmdir()


def _folders() -> set[Path]:
    """The folder of all runs, and those in it, by recipe."""
    runs = Path("runs").absolute()
    return {runs, *runs.iterdir()} if runs.is_dir() else set()


def _check_flags(words: Words) -> None:
    """Checks flags answered by Hydra itself, such as ``--cfg``.

    Raises:
        ConfigError: Two flags exclude each other.
    """
    shows = next((flag for flag in words.flags if flag in ("--cfg", "-c", "--info", "-i")), None)
    if shows and words.sweeps:
        raise ConfigError(
            f"-m and {shows} do not go together: leave -m out, and give the values of one job"
        )
