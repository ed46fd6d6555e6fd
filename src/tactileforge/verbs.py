"""The verbs of the command line as Python functions: the same words, and objects back.

``tactileforge.train("scale=demo", data="recordings", optim={"lr": 1e-3})`` is
``tactileforge train scale=demo data=recordings optim.lr=1e-3``. A notebook shows the page of what
they return.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from inspect import isroutine
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig

from tactileforge.cli._command import Command
from tactileforge.cli._quote import for_hydra, hydra_value
from tactileforge.cli._verbs import commands
from tactileforge.cli._words import Words
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.pages.shown import Shown
from tactileforge.plugins import local, registry

if TYPE_CHECKING:
    from tactileforge.hub.model import Model
    from tactileforge.pages.curves import Curve
    from tactileforge.training.module import TouchModule

#: Text that Hydra's grammar reads as it is, such as the name of a plugin.
_NAME = re.compile(r"[A-Za-z_][\w.:/-]*")
#: Words about Hydra's own job; where YAML is looked for is not one.
_OF_HYDRA = re.compile(r"hydra\.(?!searchpath)")


@dataclass(frozen=True)
class Run:
    """A training run.

    Attributes:
        folder: Folder of the run.
        module: The trained module, in the process that trained it; None for a run that is opened.

    Example:
        >>> Run(Path("runs/anytouch2/first")).report.name
        'report.html'
    """

    folder: Path
    module: TouchModule | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", Path(self.folder))

    def __fspath__(self) -> str:
        """The folder: ``resume=run`` and ``init=run`` take it."""
        return str(self.folder)

    @property
    def report(self) -> Path:
        """Page of the run."""
        return self.folder / "report.html"

    @cached_property
    def config(self) -> dict[str, Any]:
        """Resolved configuration, as plain data."""
        from tactileforge.runs.folder import read_config

        return read_config(self.folder)

    @property
    def curves(self) -> dict[str, Curve]:
        """Curves of all metrics by name, such as ``val/force``."""
        from tactileforge.pages.curves import read_metrics

        return read_metrics(self.folder)

    @property
    def metrics(self) -> dict[str, float]:
        """Last value of each metric by name."""
        return {name: float(curve.values[-1]) for name, curve in self.curves.items()}

    def model(self, **options: Any) -> Model:
        """The model of the last checkpoint; `options` are those of `tactileforge.load`."""
        from tactileforge.hub.loading import load

        return load(self.folder, **options)

    def _repr_html_(self) -> str:
        """The report, with its curves and pictures, in a notebook."""
        rows = [{"metric": name, "last value": value} for name, value in self.metrics.items()]
        return Shown(self.folder, self.report, rows)._repr_html_()


def train(*overrides: Any, folder: str | PathLike[str] | None = None, **keys: Any) -> Run:
    """Trains a recipe, or goes on with a run: ``resume=RUN``.

    Args:
        overrides: ``key=value`` words as on the command line; or one finished configuration: of
            `tactileforge.compose`, one of an application of yours with Hydra, which is completed as
            there, or a run's own with ``resume`` set to its folder.
        folder: Folder of the run; None for ``runs/RECIPE/TIME``.
        keys: The same as keywords. A mapping holds keys of a group (``optim={"lr": 1e-3}``), with
            ``name`` the option of the group as well; a list chooses several; a class of yours is
            named by its module, and a finished module or callback (an instance) is used as it is; a
            run or path is its folder. ``classes`` are classes of your own for a run or file that
            names them, as in `tactileforge.load`: ``{"my_module:Contrast": Contrast}``.

    Raises:
        TactileForgeError: Configuration or data are invalid; says the fix.
        KeyboardInterrupt: The run was stopped and saved.
    """
    from tactileforge.api import train as trained
    from tactileforge.cli._compose import complete, composed, plain
    from tactileforge.cli._finish import finish
    from tactileforge.cli._slips import told
    from tactileforge.cli.train import resumed

    if overrides and isinstance(overrides[0], DictConfig | Mapping):
        if len(overrides) > 1 or keys:
            raise ConfigError("a finished configuration takes no overrides: compose it with them")
        config: dict[str, Any] = (
            plain(overrides[0]) if isinstance(overrides[0], DictConfig) else dict(overrides[0])
        )
        recipe = "anytouch2"
        config = config if config.get("resume") else complete(config)
        if config.get("resume") and config.get("run") is None:
            raise ConfigError(
                "a run goes on with its own configuration, not a composed one: "
                f"train(resume={str(config['resume'])!r}), with trainer.max_steps= for more steps"
            )
    else:
        command, typed = commands("train")[""], _typed(overrides, keys)
        given = [*typed]
        typed = [word for word in command.prepare(typed) if not _OF_HYDRA.match(word)]
        with told("train", command, Words(overrides=given)):
            config = plain(finish(composed("train", typed), typed))
        config = resumed(config, typed) if config.get("resume") else config
        recipe = next((w.partition("=")[2] for w in typed if w.startswith("recipe=")), "anytouch2")
    if folder is None and config.get("resume"):
        folder = str(config["resume"])
    time = datetime.now().strftime("%Y-%m-%d_%H-%M-%S-%f")
    place = Path(folder) if folder is not None else Path("runs") / recipe.strip("'") / time
    return Run(place, trained(config, place))


def inspect(*overrides: Any, **keys: Any) -> Shown:
    """Writes a page about a data set; arguments as of `train`, keys of ``data inspect``.

    A path is a folder of unknown format: ``tactileforge.inspect(path="touches")``.
    """
    return _shown("data", "inspect", overrides, keys)


def pack(*overrides: Any, **keys: Any) -> Shown:
    """Packs a data set into shards; arguments as of `train`, keys of ``data pack``.

    What it returns is a data set for others: ``train(data={"name": "shards", "root": packed})``.
    """
    return _shown("data", "pack", overrides, keys)


def bench(*overrides: Any, **keys: Any) -> Shown:
    """Compares encoders on a suite; arguments as of `train`, keys of ``bench``.

    Its rows are the table: task, model, metric and value. ``tasks={"press": {...}}`` is a suite of
    your own: without ``suite=`` none of the installed ones runs beside it.
    """
    if keys.get("tasks") and not any(str(word).startswith("suite=") for word in overrides):
        keys = {"suite": [], **keys}
    return _shown("bench", "", overrides, keys)


def simulate(*overrides: Any, **keys: Any) -> Shown:
    """Simulates touch as shards; arguments as of `train`, keys of ``sim``."""
    return _shown("sim", "", overrides, keys)


def calibrate(*overrides: Any, **keys: Any) -> Shown:
    """Finds light, scale and force of a sensor; arguments as of `train`, keys of ``calibrate``."""
    return _shown("calibrate", "", overrides, keys)


def _shown(verb: str, action: str, overrides: Sequence[Any], keys: Mapping[str, Any]) -> Shown:
    """Runs a command, with Hydra's errors in one line, and gives what it made.

    Raises:
        ConfigError: A package is not installed (says the command), or a key is wrong.
        TactileForgeError: The package is older than this function.
    """
    from tactileforge.cli._slips import told

    known = commands(verb)
    if action not in known:
        from tactileforge.plugins.distributions import how_to_get

        fix = how_to_get("verbs", f"{verb}.{action}")
        raise ConfigError(f"{verb} {action} {fix}" if fix else unknown("action", action, known))
    command: Command = known[action]
    name = f"{verb} {action}".strip()
    typed = [
        command.also.get(word.partition("=")[0], word.partition("=")[0])
        + "".join(word.partition("=")[1:])
        for word in _typed(overrides, keys)
    ]
    typed = command.prepare(typed)
    with told(name, command, Words(overrides=typed)):
        config = command.compose(name, typed)
    made = command.start(config)
    if not isinstance(made, Shown):
        raise TactileForgeError(
            f"{name}: its package gives no result to Python: install a newer one"
        )
    return made


def _typed(overrides: Sequence[Any], keys: Mapping[str, Any]) -> list[str]:
    """Words of a verb, once the classes of the user's own among them are given."""
    from tactileforge.cli._run import taken_code
    from tactileforge.cli._words import check_twice

    keys = dict(keys)
    # bench has options classes.root and the like; a name of one's own has a colon
    classes = keys.get("classes")
    if isinstance(classes, Mapping) and any(":" in str(name) for name in classes):
        for name, given in keys.pop("classes").items():
            registry.give(name, given)
    typed = words(overrides, keys)
    check_twice(typed)
    return taken_code(typed)[1]


def words(overrides: Sequence[Any], keys: Mapping[str, Any]) -> list[str]:
    """Words of a command line for overrides and keywords.

    Raises:
        ConfigError: An override is not text.

    Example:
        >>> words(["seed=1"], {"data": {"name": "shards", "root": Path("in")}, "task": ["a", "b"]})
        ['seed=1', 'data=shards', "data.root='in'", 'task=[a,b]']
    """
    for word in overrides:
        if not isinstance(word, str) or "=" not in word:
            raise ConfigError(f"{word!r}: give 'key=value', or key=value as a keyword")
    return [*map(for_hydra, overrides), *(w for k, v in keys.items() for w in _words_of(k, v))]


def _words_of(key: str, value: Any) -> Iterator[str]:
    if isinstance(value, Mapping) and value:
        if "name" in value and "." not in key:
            yield f"{key}={_plain(value['name'])}"
        for name, below in value.items():
            if name != "name" or "." in key:
                yield from _words_of(f"{key}.{name}", below)
    else:
        yield f"{key}={_plain(value)}"


def _plain(value: Any) -> str:
    """A value in Hydra's grammar; names stay bare, so that they can choose options."""
    has = isinstance(value, type) or isroutine(value) or hasattr(value, "state_dict")
    if has or hasattr(value, "log_metrics"):
        return local.name_of(value)
    if isinstance(value, PathLike):
        return hydra_value(fspath(value))
    if isinstance(value, str) and _NAME.fullmatch(value):
        return value
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_plain, value))}]"
    return hydra_value(value)
