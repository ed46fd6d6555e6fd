"""Compositions of configurations, for commands, the API and tests."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from inspect import Parameter
from typing import Any

from hydra import compose as hydra_compose
from hydra import initialize_config_module
from hydra.core.config_store import ConfigStore
from hydra.core.default_element import ResultDefault
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import MissingConfigException
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode
from hydra.version import VersionBase
from omegaconf import DictConfig, OmegaConf, open_dict

from tactileforge.cli._finish import adopt, finish
from tactileforge.cli._options import MULTI, own_places, yaml_text
from tactileforge.cli._sources import SearchPath, parted, register
from tactileforge.cli._words import free_heads
from tactileforge.errors import ConfigError, PluginError
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import how_to_get
from tactileforge.plugins.kinds import GROUPS

log = logging.getLogger(__name__)


#: Override that leaves a layout out; the layout may be defined in the file of the data alone.
_NO_LAYOUT = re.compile(r"data\.(sources\.[^.=]+\.)?layouts\.[^.=]+=null")
#: Hydra's settings for every command but `train`: no folder and no log of its own; jobs of ``-m``
#: keep their record in one folder.
_QUIET = {
    "run": {"dir": "."},
    "sweep": {"dir": "runs/sweeps/${now:%Y-%m-%d_%H-%M-%S-%f}", "subdir": "${hydra:job.num}"},
    "output_subdir": None,
    "job": {"chdir": False},
}


def declare(
    name: str,
    groups: Mapping[str, Any],
    keys: Mapping[str, Any] | None = None,
    groups_last: bool = False,
) -> None:
    """Makes a configuration known to Hydra in this process: groups of options, and keys.

    Args:
        name: Name to compose it by.
        groups: Default option of each group; None for no option, ``???`` for a required one.
        keys: Defaults of the keys; see `strict.node`.
        groups_last: Whether an option may change the keys, and not the other way round.
    """
    defaults: list[Any] = [{group: option} for group, option in groups.items()]
    if "data" in groups:  # some presets of data choose a scale, which only training uses
        defaults.insert(0, {"scale": "paper"})
    defaults.insert(0 if groups_last else len(defaults), "_self_")
    quiet = {"override hydra/job_logging": "none"}, {"override hydra/hydra_logging": "none"}
    # Hydra refuses new keys in a struct: an empty mapping has to accept key={name: value}
    free = {
        key: OmegaConf.create({}, flags={"struct": False}) if value == {} else value
        for key, value in (keys or {}).items()
    }
    made = {"defaults": [*defaults, *quiet], **free, "hydra": _QUIET}
    ConfigStore.instance().store(name, made, provider="tactileforge")


def compose(
    recipe: str | Mapping[str, Any] = "anytouch2", overrides: Sequence[str] = ()
) -> DictConfig:
    """Composes the configuration of a training run, as the command line does.

    Args:
        recipe: Name of a recipe in the zoo; or a configuration that an application of yours has
            composed with Hydra: it is completed by the defaults of ``tactileforge train``, and what
            is not of training is left out.
        overrides: ``key=value`` strings.

    Returns:
        The finished configuration; see `finish`.

    Raises:
        ConfigError: Nothing reads a key; names the nearest. See also `finish`.

    Example:
        >>> compose("anytouch2", ["encoder.size=tiny"]).encoder.size
        'tiny'
    """
    from tactileforge.training.trainer import check_keys

    if not isinstance(recipe, str | Mapping | DictConfig):
        raise ConfigError(f"recipe={recipe}: give a name, then the words: compose('mae', [...])")
    if overrides and not isinstance(recipe, str):
        raise ConfigError(
            f"{overrides[0]}: a configuration is given; change it where it is composed"
        )
    with _package_named():
        if isinstance(recipe, str):
            overrides = free_heads(overrides)
            config = finish(composed("train", [f"recipe={recipe}", *overrides]), overrides)
        else:
            config = finish(_completed(recipe), _typed_elsewhere())
    check_keys(OmegaConf.to_container(config))  # type: ignore[arg-type]
    return config


def complete(config: dict[str, Any]) -> dict[str, Any]:
    """A finished configuration as it is; one of another application with Hydra as of `compose`."""
    from tactileforge.training.parts import is_finished

    return config if is_finished(config) else plain(compose(config))


def _typed_elsewhere() -> list[str]:
    """Words about an encoder or optimizer on the command line of another application with Hydra."""
    words = HydraConfig.get().overrides.task if HydraConfig.initialized() else []
    return [word for word in words if re.match(r"\+{0,2}(optim|(image_)?encoder)[.=]", word)]


def _completed(config: Mapping[str, Any] | DictConfig) -> DictConfig:
    """A configuration of another application, with the defaults of training, and without others."""
    given = config if isinstance(config, DictConfig) else OmegaConf.create(dict(config))
    own: Any = OmegaConf.to_container(given, resolve=True)
    base: Any = composed("train", ["init=null", "text_encoder=byte", "image_encoder=vit"])
    OmegaConf.set_struct(base, False)
    for key, name in (("trainer", "default"), ("optim", "adamw")):
        if "name" not in own.get(key, {"name": ""}):  # what a recipe alone has of it
            own[key] = OmegaConf.merge(OmegaConf.create(yaml_text(f"{key}/{name}")), own[key])
    for key in {*own} - {*base}:
        if near := get_close_matches(str(key), list(base), n=1, cutoff=0.8):
            log.warning("%s= is left to your application; for training it is %s=", key, near[0])
    for key in {*base} & {*own}:
        # of a group the option is the application's; blocks of fixed keys have defaults
        keeps = key in ("data", "augment") and isinstance(own[key], dict)
        left = {"max_bad": base.data.max_bad} if key == "data" else base[key]
        base[key] = OmegaConf.merge(left, own[key]) if keeps else own[key]
    return base  # type: ignore[no-any-return]


def composed(name: str, overrides: Sequence[str] = ()) -> DictConfig:
    """Composes a configuration.

    Args:
        name: Name of a YAML in conf/, or of a declared configuration; see `declare`.
        overrides: ``key=value`` strings.

    Raises:
        HydraException: An override does not fit.
    """
    with initialized():
        config = hydra_compose(name, without_layouts(overrides))
        check_claims(name, overrides)
    check_tasks(config, name, overrides)
    leave_out_others(config, name, overrides)
    return config


def check_claims(name: str, overrides: Sequence[str]) -> None:
    """Refuses two classes with one key in a list of options: the last would win.

    Called where Hydra is initialised.

    Args:
        name: Name of the configuration; see `composed`.
        overrides: ``key=value`` strings.

    Raises:
        PluginError: Two options of one list have one key; names both, and how to name the second.
    """
    if not local.given():  # names of plugins and of YAML differ
        return
    loader = GlobalHydra.instance().config_loader()
    words = [*without_layouts(overrides)]
    found: dict[tuple[str | None, str | None], str] = {}
    for one in loader.compute_defaults_list(name, words, RunMode.RUN).defaults:
        group, option = parted(one.config_path or "")
        if group not in MULTI or one.is_self:
            continue
        first = found.setdefault((one.parent, one.package), option)
        if first != option:
            raise PluginError(
                f"{group}=[...]: {first} and {option} would both be {one.package}: leave one in "
                f"the list, and give the other by a name of its own, "
                f"+{group}@{group}.second={option}"
            )


def check_tasks(config: DictConfig, name: str, overrides: Sequence[str]) -> None:
    """Refuses two suites with different tasks of one name: the last would win.

    Args:
        config: Composed configuration.
        name: Its name; see `composed`.
        overrides: ``key=value`` strings.

    Raises:
        ConfigError: There are such suites; names the task and both files.
    """
    if name != "bench" or len(config.get("suites") or ()) < 2:
        return
    files = [(one, loaded) for one, loaded in _files(name, overrides) if _is_suite(one.config_path)]
    parents = {one.config_path: one.parent for one, _ in files if not one.is_self}
    found: dict[str, tuple[str, str, Any]] = {}
    for one, loaded in files:
        path = word = one.config_path
        while _is_suite(parents.get(word)):  # a suite that begins with another changes its tasks
            word = parents[word]
        content: Any = loaded.config
        for key, task in (content.get("tasks") or {}).items():
            place = f"{loaded.path}/{path}.yaml".removeprefix("file://")
            first, other, before = found.setdefault(key, (str(word), place, task))
            if first != word and before != task:
                raise ConfigError(
                    f"suite=[...]: {other} and {place} have a task of one name, {key!r}: rename it "
                    "in one, or run the suites one by one"
                )


def leave_out_others(config: DictConfig, name: str, overrides: Sequence[str]) -> None:
    """Removes AdamW's options of presets from an optimizer of the user's own in YAML.

    It keeps what the same YAML, a later one and words give it, and its own defaults; options of
    every optimizer, as ``warmup``, stay, and those that have no default.

    Args:
        config: Composed configuration; it is changed.
        name: Its name; see `composed`.
        overrides: ``key=value`` strings.

    Raises:
        PluginError: The class cannot be imported.
    """
    node = config.get("optim")
    words = {word.lstrip("+").partition("=")[0] for word in overrides}
    if not isinstance(node, DictConfig) or "optim" in words or not (own := _own_name(node)):
        return
    from tactileforge.training.optim import COMMON  # imports torch

    written: set[str] = set()
    for one, loaded in _files(name, overrides):
        inside: Any = loaded.config
        inside = inside if one.package == "optim" else inside.get("optim")
        if isinstance(inside, DictConfig):
            written = set() if {"name", "_target_"} & inside.keys() else written
            written |= {str(key) for key in inside}
    known = registry.parameters(registry.adopt("optimizers", own, "optim"))
    with open_dict(node):
        for key in {*node} - written - {*COMMON}:
            if f"optim.{key}" not in words and known.get(key, Parameter.empty) != Parameter.empty:
                del node[key]


def _own_name(node: DictConfig) -> str:
    """Name of a class of the user's own in a node; "" for another."""
    module, _, own = str(node.get("_target_") or "").rpartition(".")
    name = f"{module}:{own}" if module else str(node.get("name"))
    return name if local.is_local(name) else ""


def _is_suite(path: str | None) -> bool:
    return (path or "").startswith("suite/")


def _files(name: str, overrides: Sequence[str]) -> list[tuple[ResultDefault, ConfigResult]]:
    """The files of a composition in their order, each with its content."""
    words, places = own_places(without_layouts(overrides), [])
    kept, SearchPath.also = SearchPath.also, [*SearchPath.also, *places]
    try:
        with initialized():
            loader: Any = GlobalHydra.instance().config_loader()
            listed = loader.compute_defaults_list(name, words, RunMode.RUN).defaults
            return [(one, loader.repository.load_config(one.config_path)) for one in listed]
    finally:
        SearchPath.also = kept


@contextmanager
def initialized() -> Iterator[None]:
    """Initialises Hydra with our configurations; afterwards the caller's Hydra is as it was."""
    register()
    kept, base = GlobalHydra.instance(), VersionBase.instance().getbase()
    GlobalHydra.set_instance(_fresh())  # Hydra refuses to initialise a second time
    try:
        with initialize_config_module("tactileforge.conf", version_base="1.3"):
            yield
    finally:
        GlobalHydra.set_instance(kept)
        VersionBase.instance().version_base = base


def _fresh() -> GlobalHydra:
    """A GlobalHydra that is not the singleton of the process."""
    fresh: GlobalHydra = object.__new__(GlobalHydra)
    fresh.hydra = None
    return fresh


@contextmanager
def _package_named() -> Iterator[None]:
    """Names the absent package of an option; the command line does so itself, by what was typed."""
    try:
        yield
    except MissingConfigException as error:
        group, _, chosen = (error.missing_cfg_file or "").rpartition("/")
        if not (fix := how_to_get(GROUPS.get(group, group), chosen)):
            raise
        raise PluginError(f"{group}={chosen} {fix}") from error


def without_layouts(overrides: Sequence[str]) -> list[str]:
    """Overrides with ``++`` before each layout set to null.

    Such a layout may be defined in the file of the data alone; without ``++`` Hydra would refuse
    its unknown name.

    Args:
        overrides: ``key=value`` strings.

    Example:
        >>> without_layouts(["data.root=x", "data.layouts.cups=null"])
        ['data.root=x', '++data.layouts.cups=null']
    """
    return [f"++{word}" if _NO_LAYOUT.fullmatch(word) else word for word in overrides]


def option(group: str, overrides: Sequence[str]) -> dict[str, Any]:
    """One group's node, composed by itself, as plain data.

    Args:
        group: Name of the group, such as ``data``.
        overrides: ``key=value`` strings, one of which chooses the option.

    Raises:
        ConfigError: A required key has no value.
        PluginError: The option comes with one of our packages, which is absent.
        HydraException: An override does not fit.
    """
    declare(f"option_{group}", {group: "???"})
    with _package_named():
        options: dict[str, Any] = plain(composed(f"option_{group}", overrides))[group]
    return options


def plain(config: DictConfig) -> dict[str, Any]:
    """A configuration as plain data.

    Raises:
        ConfigError: A required key has no value.
    """
    # OmegaConf.missing_keys raises where a value interpolates a missing one
    if missing := sorted(_missing(OmegaConf.to_container(config))):
        raise ConfigError(f"give {' '.join(f'{key}=...' for key in missing)}")
    adopt(config)
    out: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    return out


def _missing(node: Any, place: str = "") -> Iterator[str]:
    """Dotted keys of missing required values in plain data."""
    if node == "???":
        yield place
    elif isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from _missing(value, f"{place}.{key}" if place else str(key))
