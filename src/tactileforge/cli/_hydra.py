"""Runs commands under Hydra and reports Hydra's errors in one line."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from tactileforge.cli._options import options, own_places, places_of
from tactileforge.cli._quote import quoted
from tactileforge.cli._sweep import JOB, stopped_sweep
from tactileforge.cli._words import Words
from tactileforge.cli.command import Command, Result
from tactileforge.cli.compose import without_layouts
from tactileforge.errors import ConfigError, TactileForgeError, nearest_name, unknown
from tactileforge.plugins.distributions import package_of
from tactileforge.plugins.registry import GROUPS
from tactileforge.util.processes import end_with_parent

#: Options of Hydra's own groups that come as packages, ``hydra-NAME-GROUP``; source: Hydra 1.3.
_OF_PACKAGES = {
    "launcher": ("joblib", "ray", "rq", "submitit"),
    "sweeper": ("ax", "nevergrad", "optuna"),
}
#: Files in a folder before a run begins: those written by Hydra, and the run's own lock.
_BEFORE = {".hydra", ".lock", "train.log", JOB}


def run(verb: str, command: Command, words: Words) -> Result:
    """Runs a command as a Hydra application: once, or once for each combination given to ``-m``.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    import hydra
    from hydra.core.hydra_config import HydraConfig

    from tactileforge.cli.compose import plain, register

    register()
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra raises its errors, reported here
    typed, launcher = sys.argv, os.getpid()
    places = places_of(words.overrides, words.flags)
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
                given = plain(command.finish(config) if command.finish else config)
                results.append(command.start(given))
            return results[-1]
        except TactileForgeError as error:
            _forget(HydraConfig.get())
            if not alone:
                raise  # the sweep has to see the failure
            ended.append(error)
            return None

    name = command.declare(verb)
    _check_flags(name, words)
    # before Hydra names the folder of the sweep, which it does by the clock
    if command.yaml and words.sweeps and (folder := stopped_sweep(words.typed)):
        print(f"goes on with the sweep in {folder}; hydra.sweep.dir= starts another", flush=True)
        words.overrides.append(f"hydra.sweep.dir={quoted(str(folder))}")
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


def _forget(hydra: Any) -> None:
    """Removes the folder of a failed start, unless it holds more than Hydra's own files."""
    from tactileforge.runs.folder import is_claimed

    folder = Path(hydra.runtime.output_dir)
    begun = hydra.output_subdir is None or not folder.is_dir() or is_claimed(folder)
    if not begun and {item.name for item in folder.iterdir()} <= _BEFORE:
        shutil.rmtree(folder)


def _check_flags(name: str, words: Words) -> None:
    """Checks flags answered by Hydra itself, such as ``--cfg``.

    Raises:
        ConfigError: Two flags exclude each other, or a preset lacks its package line.
    """
    shows = next((flag for flag in words.flags if flag in ("--cfg", "-c", "--info", "-i")), None)
    if shows and words.sweeps:
        raise ConfigError(
            f"-m and {shows} do not go together: leave -m out, and give the values of one job"
        )
    if shows and name == "train":
        from tactileforge.cli.compose import SearchPath, check_presets, composed

        overrides, SearchPath.also = own_places(words.overrides, words.flags)
        try:
            check_presets(composed(name, overrides))
        except HydraException:
            return  # reported when Hydra shows the configuration
        finally:
            SearchPath.also = []


@contextmanager
def told(
    verb: str, command: Command, words: Words, composing: Callable[[], bool] = lambda: True
) -> Iterator[None]:
    """Turns errors of composing a configuration into a ConfigError of one line.

    Args:
        verb: Verb and action as typed.
        command: Command whose configuration is composed.
        words: Words of the command line.
        composing: Tells whether composing is still going on, so that no work has begun; general
            Python errors are turned only then.

    Raises:
        ConfigError: The configuration cannot be composed; says the fix.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        # the place of a slip often stands in the cause alone
        said, cause = str(error), str(error.__cause__ or "")
        whole = said if cause in said else f"{said}\n{cause}"
        raise ConfigError(_told(command.name(verb), whole, words)) from error
    except yaml.YAMLError as error:
        raise ConfigError(yaml_slip(error)) from error
    except RecursionError as error:
        if not composing():  # no YAML is to blame
            raise
        raise ConfigError(
            "the defaults of a YAML of yours choose its own group: an option that changes another "
            "one of its group begins with defaults: [OTHER, _self_]"
        ) from error
    except (ValueError, TypeError, AttributeError, LookupError, AssertionError) as error:
        if not composing():
            raise
        raise ConfigError(_wrong(error, words)) from error


def _wrong(error: Exception, words: Words) -> str:
    """Message for errors of composing without a message of Hydra's own."""
    overrides, own = own_places(words.overrides, words.flags)
    if "Config group override" in str(error):
        pairs = [word.lstrip("+").partition("=")[::2] for word in overrides]
        group, value = next(
            ((key, value) for key, value in pairs if value == "null" and _options(key, own)),
            ("a group", "null"),
        )
        return f"{group}={value}: give the name of an option. Known: {_known(group, own)}"
    places = f" in {', '.join(own)}" if own else ""
    if isinstance(error, UnicodeDecodeError):
        return f"a YAML{places} is not UTF-8 ({error.reason}); save it as UTF-8"
    return f"the configuration cannot be composed{places}: {type(error).__name__}: {_line(error)}"


def _known(group: str, own: Sequence[str]) -> str:
    return ", ".join(_options(group, own)) or "(none)"


def _options(group: str, own: Sequence[str]) -> list[str]:
    """Options of a group, including groups of Hydra itself."""
    return _of_hydra(group) if group.startswith("hydra/") else options(group, own)


def _line(error: BaseException) -> str:
    return re.sub(r"\s*\n\s*", "; ", str(error).strip())[:300]


def _of_hydra(group: str) -> list[str]:
    """Options of a group of Hydra itself, such as ``hydra/launcher``."""
    from hydra.core.config_store import ConfigStore

    return sorted(name.removesuffix(".yaml") for name in ConfigStore.instance().list(group))


def yaml_slip(error: yaml.YAMLError) -> str:
    """Describes a YAML syntax error and its place in one line."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    where = f"{mark.name}, line {mark.line + 1}" if mark else "a YAML"
    what = getattr(error, "problem", None) or _line(error)
    return f"{where}: no YAML ({what}); correct that line or the one before it"


def _told(name: str, said: str, words: Words) -> str:
    # Hydra 1.3 raises one class for most mistakes, so only its sentences tell them apart
    overrides, own = own_places(words.overrides, words.flags)
    if match := re.search(r"Could not override '(.+?)'\.? ?(No match in the defaults list)?", said):
        key = match[1].removesuffix("@_global_")
        # of a mapping it is one of its keys that is new
        inner = re.search(r"full_key: (\S+)", said)
        key = inner[1] if inner and inner[1].startswith(f"{key}.") else key
        return unknown_key(name, key, overrides, own)
    if match := re.search(r"Could not find '(hydra/\w+)/'", said):
        return f"{match[1]}=: give the name of an option. Known: {_known(match[1], own)}"
    if match := re.search(r"Could not find '([\w/]+)/(.+?)'", said):
        if match[1].startswith("hydra/"):
            kind = match[1].partition("/")[2]
            if match[2] in _OF_PACKAGES.get(kind, ()):
                package = f"hydra-{match[2]}-{kind}"
                return f"{match[1]}={match[2]} comes with {package}: pip install {package}"
            return unknown(match[1], match[2], {*_of_hydra(match[1]), *_OF_PACKAGES.get(kind, ())})
        # what was typed comes before a default, which Hydra may have looked for first
        typed = [word.partition("=")[::2] for word in overrides]
        missing = [(group, one) for group, one in typed if one not in options(group, own)]
        for group, one in [*missing, (match[1], match[2])]:
            if package := package_of(GROUPS.get(group, group), one):
                return f"{group}={one} comes with {package}: pip install {package}"
        fix = "" if own else "Options of your own need --config-dir DIR"
        return unknown(match[1], match[2], options(match[1], own), fix)
    if match := re.search(r"You must specify '(\w+)'", said):
        return f"give {match[1]}=NAME; Known: {', '.join(options(match[1], own))}"
    if match := re.search(r"LexerNoViableAltException: (.*)|(mismatched input .*?)[;\n]", said):
        what = match[1] or match[2]
        return f"{what}: not key=value; quote values with special characters: \"key='value'\""
    return re.sub(r"\s*\n\s*", "; ", said.partition("\nprimary config")[0].strip()).strip("; ")


def unknown_key(name: str, key: str, overrides: Sequence[str], own: Sequence[str] = ()) -> str:
    """Message for an unknown key, with the nearest key beside it or of the same name elsewhere.

    Args:
        name: Name of the configuration, see `compose.composed`.
        key: Key as typed.
        overrides: The typed ``key=value`` words.
        own: Further places of options, see `_options.own_places`.
    """
    from tactileforge.cli.compose import composed

    # keys depend on the chosen options alone; other words may be the ones that fail
    chosen = []
    for word in overrides:
        name_of_it = word.partition("=")[0]
        group = name_of_it.partition("@")[0].lstrip("+")
        if name_of_it.lstrip("+~") != key and "." not in group and options(group, own):
            chosen.append(word)
    try:
        config = composed(name, chosen)
    except HydraException:  # an option is unknown as well
        return f"unknown key {key!r}"
    known = sorted(_keys(config))
    parent, _, last = key.rpartition(".")
    # the slip may be in an earlier word of the key, as in triner.max_steps
    while parent and parent not in known:
        parent = parent.rpartition(".")[0]
    beside = [option for option in known if option.rpartition(".")[0] == parent]
    if parent and not beside:  # as data.layouts, whose keys are those of tactileforge.yaml
        return f"unknown key {key!r}: {parent} is empty here. A key that is new: +{key}=..."
    near = nearest_name(key, beside)
    alike = [option for option in known if re.search(rf"(^|[._]){re.escape(last)}$", option)]
    if alike:
        near = f"; did you mean {' or '.join(map(repr, alike[:3]))}?"
    elif near == ".":
        near = nearest_name(key, known)
    where = f" Known in {parent}" if parent else " Known"
    names = ", ".join(option.rpartition(".")[2] for option in beside)
    new = f". A key that is new: +{key}=..." if parent else ""
    return f"unknown key {key!r}{near}{where}: {names}{new}"


def _keys(config: Any, prefix: str = "") -> Iterator[str]:
    if not isinstance(config, DictConfig) or config._is_none() or config._is_missing():
        return
    for key in config:
        yield f"{prefix}{key!s}"
        yield from _keys(config._get_node(key), f"{prefix}{key!s}.")
