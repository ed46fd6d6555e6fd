"""Plugins as Hydra options, and `compose` for the API and for tests.

Every entry point is an option: ``tactileforge train objective=[pixel,diff]`` works for all
installed plugins. Listing options reads metadata; choosing one imports its class, and the defaults
of its constructor become the node of the configuration.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from enum import Enum
from inspect import Parameter
from pathlib import Path
from typing import Any, ClassVar

from hydra import compose as hydra_compose
from hydra import initialize_config_module
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException, MissingConfigException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.types import RunMode
from hydra.version import VersionBase
from omegaconf import MISSING, DictConfig, ListConfig, OmegaConf, open_dict

from tactileforge.cli import _known
from tactileforge.cli._options import MULTI, tower, yaml_text
from tactileforge.cli._quote import unquoted
from tactileforge.cli._words import free_heads
from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import class_contracts, local, registry
from tactileforge.plugins.distributions import conf_packages, how_to_get
from tactileforge.plugins.registry import GROUPS

log = logging.getLogger(__name__)


class PluginSource(ConfigSource):
    """Serves each entry point as a config: its name and its constructor's defaults."""

    @staticmethod
    def scheme() -> str:
        """Scheme of this source in Hydra's search path."""
        return "tactileforge"

    def available(self) -> bool:
        """Always True."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether a path is a group of plugins."""
        return config_path == "" or config_path in GROUPS

    def is_config(self, config_path: str) -> bool:
        """Whether a path is a plugin.

        A group of several options accepts any name, so that an unknown one gets an error of ours,
        with the nearest name.
        """
        group, name = _parted(config_path)
        if group in GROUPS and local.is_local(name):
            return True
        return group in MULTI or (group in GROUPS and name in registry.names(GROUPS[group]))

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The options of a group, from metadata."""
        if config_path == "":
            return [] if results_filter is ObjectType.CONFIG else sorted(GROUPS)
        if config_path in GROUPS and results_filter is not ObjectType.GROUP:
            return registry.names(GROUPS[config_path])
        return []

    def load_config(self, config_path: str) -> ConfigResult:
        """Imports one plugin and gives its defaults."""
        group, name = _parted(config_path)
        try:
            if local.is_local(name):  # in the words, or the YAML, of the user
                registry.adopt(GROUPS[group], name, group)
            node = node_of(group, name)
        except PluginError as error:
            raise ConfigCompositionException(str(error)) from error
        return ConfigResult(
            provider=self.provider,
            path=f"{self.scheme()}://{config_path}",
            config=OmegaConf.create(node),
            header={"package": f"{group}.{local.key_of(name)}" if group in MULTI else None},
        )


def _parted(config_path: str) -> tuple[str, str]:
    """Group and option of a path; an option of the user's own may be the path of a file."""
    group, _, name = config_path.partition("/")
    return group, name.removesuffix(".yaml")


class SearchPath(SearchPathPlugin):
    """Hydra's search path: conf/, then zoo/, then the YAML of packages, then bare plugins.

    Hydra finds it in `hydra_plugins.tactileforge_searchpath`, so every application with Hydra has
    our groups, behind its own.

    Attributes:
        also: Places named on the command line, if Hydra itself does not add them.
    """

    also: ClassVar[list[str]] = []

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Appends the places of options to the search path."""
        places = list(SearchPath.also)
        # a job that composes further configurations, such as the data preset of a suite, searches
        # the places named on its command line, too
        if HydraConfig.initialized():
            places += [
                source.path if "://" in source.path else f"{source.schema}://{source.path}"
                for source in HydraConfig.get().runtime.config_sources
                if source.schema and "command-line" in source.provider
            ]
        for place in dict.fromkeys(places):
            search_path.append("command-line", place)
        conf = "pkg://tactileforge.conf"
        if all(element.path != conf for element in search_path.get_path()):  # another application
            search_path.append("tactileforge", conf)
        search_path.append("tactileforge-zoo", "pkg://tactileforge.zoo")
        for package in conf_packages():
            search_path.append(package, f"pkg://{package}")
        search_path.append("tactileforge-plugins", f"{PluginSource.scheme()}://")


def node_of(group: str, name: str) -> dict[str, Any]:
    """The configuration node of an installed plugin in a group: name, weight, defaults."""
    kind = GROUPS[group]
    defaults = registry.options(kind, name)
    class_contracts.check_free(kind, defaults, f"{kind.removesuffix('s')} {name!r}")
    shared: dict[str, Any] = {"weight": 1.0} if group == "objective" else {}
    if group == "optim":
        from tactileforge.training.optim import COMMON  # imports torch

        shared = COMMON
    return (
        {"name": name}
        | shared
        | {
            key: MISSING if value is Parameter.empty else value
            for key, value in defaults.items()
            if key != "name"  # a parameter of that name, as CSVLogger's, keeps its default
            if value is Parameter.empty or _is_plain(value)  # torch.device("cpu") stays a default
        }
    )


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(map(_is_plain, [*value, *value.values()]))
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, bool | int | float | str | Enum | Path)


def register() -> None:
    """Makes plugins known to Hydra in this process; safe to call twice.

    Hydra finds them by itself where the package is installed, and not where it runs from sources.
    """
    Plugins.instance().register(PluginSource)
    Plugins.instance().register(SearchPath)
    OmegaConf.register_new_resolver("tactileforge_tower", tower, replace=True)


#: Override that leaves a layout out; the layout may be defined in the file of the data alone.
_NO_LAYOUT = re.compile(r"data\.(sources\.[^.=]+\.)?layouts\.[^.=]+=null")
#: Groups of presets, whose keys are those of the whole configuration.
_PRESETS = ("recipe", "scale", "ablation", "debug", "tuned", "early")
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
        group, option = _parted(one.config_path or "")
        if group not in MULTI or one.is_self:
            continue
        first = found.setdefault((one.parent, one.package), option)
        if first != option:
            raise PluginError(
                f"{group}=[...]: {first} and {option} would both be {one.package}: leave one in "
                f"the list, and give the other by a name of its own, "
                f"+{group}@{group}.second={option}"
            )


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


#: Kinds of plugins by group, those of a group without a choice too.
_KINDS = {**GROUPS, "augment": "augmentations"}
#: Keys whose value names a plugin, wherever they are, and its kind.
_NAMED = {"schedule": "schedules", "curve": "curves"}


def adopt(config: DictConfig) -> None:
    """Imports the user's own names in a composed configuration, as in ``name: my_module:Contrast``.

    ``_target_: my_module.Contrast`` is the same, as Hydra's users know it. The configuration is
    what the user typed, and his YAML; that of a run or a model is never given to this function.

    Args:
        config: Composed configuration; a ``_target_`` in it becomes a ``name``.

    Raises:
        PluginError: A name cannot be imported, or is something else; one line with the place.
    """
    with open_dict(config):
        for group in config:
            node = None if OmegaConf.is_missing(config, group) else config._get_node(group)
            if isinstance(node, DictConfig) and not node._is_none():
                if group == "augment" and isinstance(node.get("also"), ListConfig):
                    node.also = _by_key(node.also)
                _adopt(node, str(group), _KINDS.get(str(group), ""))


def _by_key(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Nodes of listed changes of batches, by the keys of their classes.

    Raises:
        PluginError: Two of them have one key.
    """
    nodes: dict[str, dict[str, str]] = {}
    for name in names:
        key = local.key_of(name)
        if key in nodes:
            raise PluginError(
                f"augment.also=[...]: {nodes[key]['name']} and {name} would both be "
                f"augment.also.{key}: name them, augment.also={{{key}: {{name: "
                f"{nodes[key]['name']}}}, second: {{name: {name}}}}}"
            )
        nodes[key] = {"name": name}
    return nodes


def _adopt(node: DictConfig, place: str, kind: str) -> None:
    former = ""
    if kind and "_target_" in node:
        module, _, name = str(node.pop("_target_")).rpartition(".")
        former, node["name"] = str(node.get("name") or ""), f"{module}:{name}"
    for key in map(str, node):
        inner = node._get_node(key)
        if isinstance(inner, DictConfig):
            if not inner._is_none():
                _adopt(inner, f"{place}.{key}", kind)
            continue
        wanted = kind if key == "name" else _NAMED.get(key, "")
        value = inner._value() if inner is not None and hasattr(inner, "_value") else None
        if wanted and isinstance(value, str) and local.is_local(value):
            registry.adopt(wanted, value, f"{place}.{key}".removesuffix(".name"))
    if former and former in registry.names(kind):
        # options of the class that a recipe or the default had in its place
        own = registry.parameters(registry.get(kind, str(node["name"])))
        for key in registry.options(kind, former).keys() - own.keys():
            node.pop(key, None)


def check_presets(config: DictConfig) -> None:
    """Checks the package line of presets.

    Raises:
        ConfigError: A recipe or another preset lacks its package line.
    """
    for group in _PRESETS:
        if config.get(group):
            raise ConfigError(
                f"{group}=: the first line of its YAML has to be '# @package _global_', or its "
                "keys stay below its own name, where nothing reads them"
            )


def finish(config: DictConfig, typed: Sequence[str] = (), sweeps: bool = False) -> DictConfig:
    """Completes a composed configuration: one head for each objective, no more, no fewer.

    An objective set to null (``objective.diff=null``) is not chosen. Curriculum rows of objectives
    that are not chosen are left out, and so are heads without an objective. An objective without a
    head gets the one named by its class, with the options given for it. Options of the encoder that
    a recipe or scale set for another encoder are left out.

    Args:
        config: Composed configuration; it is changed.
        typed: Overrides typed by the user, ``key=value``; the options they set are never left out.
        sweeps: Whether the configuration is that of a job of a sweep, whose words may be about
            objectives that other jobs choose.

    Raises:
        ConfigError: No objective is chosen, one is called ``loss``, a curriculum row does not
            belong to an objective, or nothing reads a key.
        PluginError: A plugin is not installed.
    """
    check_presets(config)
    _name_networks(config, typed)
    adopt(config)
    chosen = _chosen("objective", config)
    if not chosen:
        raise ConfigError("no objective: choose some, e.g. objective=[pixel,diff]")
    if "loss" in chosen:  # the key of a class of this name
        raise ConfigError(
            "objective.loss: the sum of all objectives is logged by that name; give it another, "
            f"+objective@objective.mine={chosen['loss'].get('name')}"
        )
    heads = _chosen("head", config, chosen)  # also of an objective whose head is a class
    options: Mapping[str, Any] = config.get("head") or {}
    if not config.get("curriculum"):
        config.curriculum = OmegaConf.create({}, flags={"struct": False})
    rows: Mapping[str, Any] = config.curriculum.get("objective") or {}
    _known.check_training(config, () if sweeps else typed)
    # checked before rows are left out below, where a misspelt one would vanish without a word
    for key in rows:
        if key not in chosen and key not in registry.names("objectives"):
            known = {*chosen, *registry.names("objectives")}
            raise ConfigError(unknown("objective in curriculum.objective", key, known))
    # Hydra's struct refuses new keys: open only while nodes are completed here
    OmegaConf.set_struct(config, False)
    config.objective = chosen
    config.head = {
        # without a chosen one its own, with the options that a scale or a + gives it
        key: heads.get(key)
        or OmegaConf.merge(node_of("head", registry.head_of(node["name"])), options.get(key) or {})
        for key, node in chosen.items()
    }
    config.curriculum.objective = {key: row for key, row in rows.items() if key in chosen}
    _leave_out(config.encoder, "encoders", _SIZED, "encoder", typed)
    if local.is_local(config.optim.get("name")):
        _leave_out(config.optim, "optimizers", ("adamw",), "optim", typed)
    for key, node in config.head.items():
        if key in registry.names("heads") and local.is_local(node.get("name")):
            _leave_out(node, "heads", (key,), f"head.{key}", typed)
    if config.encoder.name != "tactile_vit" and not any(w.startswith("init=") for w in typed):
        config.init = None if config.init == "clip.vitb16" else config.init  # it would replace it
    _, own = defaults_of_optimizer(typed)
    for key, value in own.items():
        if config.optim.get(key) != value:
            log.info("optim.%s=%s, the optimizer's own; the recipe's is for another", key, value)
            config.optim[key] = value
    OmegaConf.set_struct(config, True)
    _known.check_plugins(config)
    return config


def defaults_of_optimizer(typed: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """The typed optimizer, and the defaults of its class for all other options.

    A recipe's learning rate is for the recipe's optimizer: another one that is chosen beside it has
    its own, where its class has one.

    Args:
        typed: Overrides, ``key=value``.

    Returns:
        The name, "" without one, and the options by name.
    """
    words = {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in typed)}
    name = unquoted(words.get("optim", ""))
    if name in ("", "adamw", "null"):
        return "", {}
    from tactileforge.training.optim import COMMON  # imports torch

    if local.is_local(name):  # typed, and not composed yet where Hydra only shows it
        registry.adopt("optimizers", name, "optim")
    return name, {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in node_of("optim", name).items()
        if key not in {*COMMON, "name"} and value != MISSING and f"optim.{key}" not in words
    }


def _name_networks(config: DictConfig, typed: Sequence[str]) -> None:
    """Takes ``encoder=timm encoder.name=X`` as the network X of the plugin timm.

    The key ``name`` is the plugin's own. A class whose networks have names says in ``named_by``
    which option gives them.
    """
    words = dict(word.lstrip("+").partition("=")[::2] for word in typed)
    for group in ("encoder", "image_encoder"):
        plugin, network = words.get(group, ""), words.get(f"{group}.name")
        if network is None or plugin not in registry.names("encoders"):
            continue
        option = getattr(registry.get("encoders", plugin), "named_by", None)
        if option is not None:
            config[group].update({"name": plugin, option: network})


#: Encoders whose options are set by recipes and scales.
_SIZED = ("tactile_vit", "plain_vit")


def _leave_out(
    node: DictConfig, kind: str, usual: Collection[str], place: str, typed: Sequence[str]
) -> None:
    """Removes options of the usual classes, given by a preset, from a class without them.

    Args:
        node: Node of the chosen class; it is changed.
        kind: Its kind.
        usual: Names of the usual classes.
        place: Place of the node, as in ``head.pixel``.
        typed: Overrides typed by the user; the options they set stay.
    """
    name = node.get("name")
    if name in usual or not (name in registry.names(kind) or local.is_local(name)):
        return
    own = {"name", *class_contracts.RESERVED.get(kind, ())}
    own |= registry.parameters(registry.get(kind, name)).keys()
    known = {key for one in usual for key in registry.options(kind, one)}
    given = {word.lstrip("+").partition("=")[0] for word in typed}
    left = [key for key in node if key in known - own and f"{place}.{key}" not in given]
    for key in left:
        del node[key]
    if left:
        names = ", ".join(sorted(left))
        log.info("%s=%s: left out what it has not and a preset gave: %s", place, name, names)


def _chosen(group: str, config: DictConfig, also: Collection[str] = ()) -> dict[str, Any]:
    """The nodes of a group with the name of a plugin; `also` are further keys without a name.

    Raises:
        ConfigError: A node without a name has a key that is not the name of a plugin either.
    """
    given: Mapping[str, Any] = config.get(group) or {}
    nodes = {key: node for key, node in given.items() if node is not None}
    for key, node in nodes.items():
        if "name" not in node and key not in (known := {*registry.names(GROUPS[group]), *also}):
            raise ConfigError(unknown(group, key, known))
    return {key: node for key, node in nodes.items() if "name" in node}
