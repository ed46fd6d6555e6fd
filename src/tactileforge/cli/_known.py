"""Keys that nothing reads: an error with the nearest known one, for every verb and every source.

Hydra takes any key behind a plus, and any key of a YAML; nothing has to read it. Here the composed
configuration is compared with what the command has: its own keys, the groups of its options, and
the constructors of the chosen plugins. Options of ``data``, ``encoder``, ``trainer``, ``batch``,
``augment`` and ``curriculum`` are checked by their own readers, before data is read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Any

import yaml
from omegaconf import Container, DictConfig, ListConfig, Node, OmegaConf

from tactileforge.cli._options import MULTI, yaml_groups, yaml_options, yaml_text
from tactileforge.errors import ConfigError, PluginError, check_names, nearest_name
from tactileforge.plugins import local, registry
from tactileforge.plugins.class_contracts import RESERVED
from tactileforge.plugins.kinds import GROUPS
from tactileforge.plugins.source_options import read_hints

#: Keys of a node beside the options of its plugin, by group.
_BESIDE = {"objective": RESERVED["objectives"]}
#: Groups without plugins whose keys are those of their YAML.
_BY_YAML = ("balance", "logger")
#: Groups of plugins that training builds after its data, and that are checked here for that reason.
_BUILT_LATE = ("objective", "head", "text_encoder", "image_encoder")
#: Lightning's trainer, whose arguments are the keys of ``trainer``.
_TRAINER = "lightning.pytorch.trainer.trainer:Trainer"
#: First word of a key as it is typed: ``objective`` of ``+objective@objective.again=diff``.
_TYPED = re.compile(r"\+{0,2}([\w./]+)(@[\w.]+)?=")


def check_training(config: DictConfig, typed: Sequence[str] = ()) -> None:
    """Checks the composed configuration of a training run.

    Args:
        config: Composed configuration, before `compose.finish` leaves anything out.
        typed: ``key=value`` words of the user; a key of an objective or head that is not chosen is
            an error if it was typed, and left out if a preset gives it.

    Raises:
        ConfigError: Nothing reads a key; names the nearest.
    """
    tree, shared = _training_tree(), _interpolated(config)
    for top, node in _items(config):
        if top in shared and top not in tree:
            continue
        if top not in tree:
            raise ConfigError(message(_leaf(top, node), known_keys(config)))
        if top == "logger" and dict(_items(node)).get("name", "csv") not in yaml_options(top):
            _check_plugin(top, "", node)
            continue
        _check_below(top, node, tree[top], config)
    _check_chosen(config, typed)


def check_plugins(config: DictConfig) -> None:
    """Checks the options of plugins that training builds after its data.

    Args:
        config: Finished configuration.

    Raises:
        ConfigError: A constructor has no such option; names the nearest.
    """
    for group in _BUILT_LATE:
        node = config.get(group)
        for name, row in _items(node) if group in MULTI else [("", node)]:
            _check_plugin(group, name, row)


def check_types(config: DictConfig) -> None:
    """Checks values of a finished configuration against the types of their options.

    Training does so where it builds each part; this is for showing the configuration, and imports
    no plugin that is read from its source.

    Raises:
        ConfigError: A value has another type than the option of its plugin, or of the trainer.
    """
    for group, kind in GROUPS.items():
        node = config.get(group)
        for name, row in _items(node) if group in MULTI else [("", node)]:
            name_of = row.get("name") if isinstance(row, DictConfig) else None
            if name_of and name_of not in _own_yaml(group):
                place = f"{group}.{name}" if name else group
                given: Any = OmegaConf.to_container(row)
                registry.check_node(kind, given, place)
                for key in _BESIDE.get(group, ()):
                    registry.check_hints(given, {key: float}, place)
    schedule = (config.get("optim") or {}).get("schedule")
    if isinstance(schedule, str) and not local.is_local(schedule):
        check_names("optim.schedule", [schedule], registry.names("schedules"))
    trainer: Any = OmegaConf.to_container(config.trainer) if config.get("trainer") else {}
    known = read_hints(_TRAINER) | {"save_every": int, "keep_best": str | None}
    for key in trainer:
        if key not in known:
            beside = ["trainer", *(f"trainer.{one}" for one in known)]
            raise ConfigError(message(f"trainer.{key}", beside))
    registry.check_hints(trainer, known, "trainer")
    if "seed" in config and not isinstance(config.seed, int):
        raise ConfigError(f"seed={config.seed}: give a whole number")


def _own_yaml(group: str) -> list[str]:
    """Options of a group in YAML alone, without a plugin."""
    return [*yaml_options(group)] if group in _BY_YAML else []


def check_command(
    keys: type | None,
    groups: Collection[str],
    config: DictConfig,
    typed: Sequence[str],
) -> None:
    """Checks the configuration of a verb other than ``train``.

    Args:
        keys: Dataclass of the verb's keys; None if it has none.
        groups: Groups of options that it takes.
        config: Its composed configuration.
        typed: ``key=value`` words of the user.

    Raises:
        ConfigError: Nothing reads a key; names the nearest.
    """
    own = {spec.name for spec in fields(keys)} if keys else set()
    own |= {*groups, "scale"} if "data" in groups else {*groups}
    # a preset of data may bring keys that training alone reads; nobody types them here
    given = {*own, *_training_tree()} if "data" in groups else own
    known = [key for key in dotted_keys(config) if key.partition(".")[0] in own]
    shared = _interpolated(config)
    for word in typed:
        match = _TYPED.match(word)
        # a group of Hydra's own, or one that composes into another place: checked with its node
        read = {*own, *shared, "hydra"}
        if match and "/" not in match[1] and match[1].partition(".")[0] not in read:
            raise ConfigError(message(match[1], {*known, *own}))
    for top, node in _items(config):
        if top not in given | shared:
            raise ConfigError(message(_leaf(top, node), {*known, *own}))


def message(key: str, known: Iterable[str], fix: str = "") -> str:
    """One line about an unknown key: the nearest known one, and the keys beside it.

    Args:
        key: Dotted key.
        known: All known keys, dotted.
        fix: Further words at the end.

    Example:
        >>> message("optimizer.lr", ["optim", "optim.lr", "seed"])
        "unknown key 'optimizer.lr'; did you mean 'optim.lr'? Known: optim, seed"
    """
    known = sorted(set(known))
    parent, _, last = key.rpartition(".")
    # the slip may be in an earlier word of the key, as in triner.max_steps
    while parent and parent not in known:
        parent = parent.rpartition(".")[0]
    beside = [option for option in known if option.rpartition(".")[0] == parent]
    near = nearest_name(key, beside)
    if parent and fix and not beside:  # as data.layouts, whose keys are those of tactileforge.yaml
        return f"unknown key {key!r}: {parent} is empty here{fix}"
    # the same last word elsewhere: lr and optimizer.lr are optim.lr
    alike = [option for option in known if re.search(rf"(^|[._]){re.escape(last)}$", option)]
    if alike and "." in key:  # of many such keys, the one whose place is alike
        alike = get_close_matches(key, alike, n=1) or alike
    if alike:
        near = f"; did you mean {' or '.join(map(repr, alike[:3]))}?"
    elif near == ".":
        near = nearest_name(key, known)
    if near == ".":  # of a whole block, the block
        near = nearest_name(key.partition(".")[0], [one for one in known if "." not in one])
    where = f" Known in {parent}" if parent else " Known"
    names = ", ".join(option.rpartition(".")[2] for option in beside)
    return f"unknown key {key!r}{near}{where}: {names or '(none)'}{fix}"


def known_keys(config: Any) -> set[str]:
    """Dotted keys of a training configuration whose first word is known."""
    tops = _training_tree()
    return {key for key in dotted_keys(config) if key.partition(".")[0] in tops} | set(tops)


def dotted_keys(config: Any, prefix: str = "") -> Iterator[str]:
    for key, node in _items(config):
        yield f"{prefix}{key}"
        yield from dotted_keys(node, f"{prefix}{key}.")


def _items(config: Any) -> Iterator[tuple[str, Any]]:
    """Keys and nodes of a mapping; interpolations and missing values are not resolved."""
    if not isinstance(config, DictConfig) or config._is_interpolation():
        return
    if not config._is_none() and not config._is_missing():
        for key in config:
            yield str(key), config._get_node(key)


def _interpolated(config: Any) -> set[str]:
    """First words of the keys that other values interpolate: ``width`` of ``${width}``."""
    found = set()
    nodes = [node for _, node in _items(config)]
    if isinstance(config, ListConfig) and not config._is_none() and not config._is_missing():
        nodes = [config._get_node(place) for place in range(len(config))]
    for node in nodes:
        if isinstance(node, Container) and not node._is_interpolation():
            found |= _interpolated(node)
        elif isinstance(node, Node) and node._is_interpolation():
            found |= set(re.findall(r"\$\{(\w+)", str(node._value())))
    return found


def _leaf(key: str, node: Any) -> str:
    """Dotted key of the first value below a node."""
    rows = dict(_items(node))
    for name, below in () if "name" in rows else rows.items():  # an option, chosen whole
        return _leaf(f"{key}.{name}", below)
    return key


@cache
def _training_tree() -> dict[str, Any]:
    """Keys that training reads: a mapping for a block with fixed keys, None for any other."""
    rows = yaml.safe_load(yaml_text("train"))
    rows = {key: value for key, value in rows.items() if key not in ("defaults", "hydra")}
    groups = {*yaml_groups("train"), *(one.name for one in _folders())}
    tree: dict[str, Any] = {group: None for group in groups}
    for group in _BY_YAML:
        options = [yaml.safe_load(yaml_text(f"{group}/{name}")) for name in yaml_options(group)]
        tree[group] = {key: None for option in options for key in option}
    for key, value in rows.items():
        if key not in groups:
            tree[key] = value if isinstance(value, Mapping) else False
    batch = yaml.safe_load(yaml_text("batch/default"))
    tree["batch"] = {"shares": batch["shares"]}
    return tree


def _folders() -> list[Any]:
    """Groups in conf/."""
    return [item for item in files("tactileforge.conf").iterdir() if item.is_dir()]


def _check_below(where: str, node: Any, known: Any, config: DictConfig) -> None:
    """Checks the keys of a block with fixed keys, at any depth."""
    if known is None or (where in ("batch", "augment") and not isinstance(node, DictConfig)):
        return
    for key, below in _items(node):
        place = f"{where}.{key}"
        if where == "batch":  # its reader knows its keys
            if key in known:
                _check_below(place, below, known[key], config)
        elif not known or key not in known:
            beside = {where, *(f"{where}.{one}" for one in known or ())}
            others = {one for one in known_keys(config) if not f"{one}.".startswith(f"{where}.")}
            raise ConfigError(message(_leaf(place, below), others | beside))
        elif isinstance(known[key], Mapping):
            _check_below(place, below, known[key], config)


def _check_plugin(group: str, name: str, node: Any) -> None:
    """Checks the options of a chosen plugin against its constructor."""
    if not isinstance(node, DictConfig) or "_target_" in node or not (chosen := node.get("name")):
        return  # of a class that Hydra makes, its own constructor checks them
    try:
        own = registry.options(GROUPS[group], str(chosen))
    except PluginError:
        return  # reported when it is built
    known = {"name", *own, *_BESIDE.get(group, ())}
    place = f"{group}.{name}" if name else group
    for key, below in _items(node):
        if key not in known:
            beside = [f"{place}.{one}" for one in known]
            raise ConfigError(message(_leaf(f"{place}.{key}", below), [place, *beside]))


def _check_chosen(config: DictConfig, typed: Sequence[str]) -> None:
    """Refuses typed options of objectives that are not chosen, which would be left out."""
    for key, node in _items(config.get("callbacks")):
        options = dict(_items(node))
        if options and not {"name", "_target_"} & options.keys():
            raise ConfigError(
                f"nothing reads {_leaf(f'callbacks.{key}', node)}: callback {key!r} is not chosen; "
                f"callbacks=[{key}] chooses it"
            )
    objectives = {key for key, node in _items(config.get("objective")) if _is_chosen(node)}
    heads = {key for key, node in _items(config.get("head")) if _is_chosen(node)}
    places = {"objective": objectives, "head": objectives | heads}
    for word in typed:
        match = re.match(r"\+{0,2}(objective|head)\.(\w+)\.", word)
        if match and match[2] not in places[match[1]]:
            key = word.lstrip("+").partition("=")[0]
            raise ConfigError(_not_chosen(key, match[2], objectives))


def _not_chosen(key: str, name: str, objectives: Collection[str]) -> str:
    return (
        f"nothing reads {key}: objective {name!r} is not chosen{nearest_name(name, objectives)} "
        f"Chosen: {', '.join(sorted(objectives))}"
    )


def unknown_below(config: Any, key: str, fix: str = "") -> str:
    """Message about a key unknown in a composed configuration; objectives not chosen do not count.

    Args:
        config: Composed configuration.
        key: Dotted key.
        fix: Further words at the end.
    """
    rows = dict(_items(config.get("objective")))
    chosen = {name for name, node in rows.items() if _is_chosen(node)}
    group, name = f"{key}.".split(".")[:2]
    if group == "objective" and name in rows.keys() - chosen:
        return _not_chosen(key, name, chosen)
    # a scale has options for objectives of several recipes
    unused = tuple(f"objective.{name}." for name in rows.keys() - chosen)
    known = (one for one in dotted_keys(config) if not f"{one}.".startswith(unused))
    return message(key, known, fix)


def _is_chosen(node: Any) -> bool:
    return isinstance(node, DictConfig) and not node._is_none() and bool(node.get("name"))
