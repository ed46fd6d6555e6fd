"""A composed configuration, completed: heads of objectives, names of classes, options left out."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from omegaconf import MISSING, DictConfig, ListConfig, OmegaConf, open_dict

from tactileforge.cli import _known
from tactileforge.cli._quote import unquoted
from tactileforge.cli._sources import node_of
from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import class_contracts, local, registry
from tactileforge.plugins.kinds import GROUPS

log = logging.getLogger(__name__)


#: Groups of presets, whose keys are those of the whole configuration.
_PRESETS = ("recipe", "scale", "ablation", "debug", "tuned", "early")
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
