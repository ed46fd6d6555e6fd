"""``--explain KEY``: the sources of a key's value, in order; the last one wins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from tactileforge.cli._compose import composed, initialized
from tactileforge.cli._finish import check_presets, defaults_of_optimizer, finish
from tactileforge.cli._options import own_places
from tactileforge.cli._sources import PluginSource, SearchPath
from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import registry


def explain(name: str, key: str, overrides: Sequence[str], flags: Sequence[str] = ()) -> str:
    """Lists the sources of a key's value and its final value.

    Args:
        name: Name of the configuration.
        key: Dotted key, such as ``objective.force.weight``.
        overrides: ``key=value`` words.
        flags: Flags of Hydra; ``--config-dir`` adds a folder of options.

    Raises:
        ConfigError: The configuration has no such key.
        HydraException: An override does not fit the configuration.
    """
    overrides, SearchPath.also = own_places(overrides, flags)
    try:
        config = composed(name, overrides)
        check_presets(config)
        pairs = [word.partition("=")[::2] for word in overrides]
        typed = [("command line", value) for word, value in pairs if word.lstrip("+") == key]
        optimizer, own = defaults_of_optimizer(overrides if "optim" in config else ())
        for option, value in own.items():
            OmegaConf.update(config, f"optim.{option}", value)
            if f"optim.{option}" == key:
                typed += [(f"optim={optimizer}, its own default", _shown(value))]
        rows = [*_files(name, key, overrides), *typed]  # typed words are merged after all files
        if name == "train":  # with the heads that a run gives to its objectives
            config = finish(config, overrides)
            given = OmegaConf.select(config, key, throw_on_missing=False)
            if given is not None and not [place for place, _ in rows if place != "command line"]:
                rows.insert(0, ("its own default", _default(config, key)))
    finally:
        SearchPath.also = []
    if not rows:
        parent = key.rpartition(".")[0]
        node = OmegaConf.select(config, parent) if parent else config
        known = [f"{parent}.{key_below!s}".lstrip(".") for key_below in node or ()]
        raise ConfigError(unknown("key", key, known))
    width = max(len(place) for place, _ in rows)
    lines = [f"  {place:<{width}}  {value}" for place, value in rows]
    final = _shown(OmegaConf.select(config, key, throw_on_missing=False))
    return "\n".join([f"{key} = {final}", *lines, "  (the last one wins)"])


def _default(config: DictConfig, key: str) -> str:
    """Default of an option of a plugin outside of all files, such as a head of an objective."""
    parent, _, option = key.rpartition(".")
    node = OmegaConf.select(config, parent) if parent else None
    kind = registry.GROUPS.get(key.partition(".")[0], "")
    if not kind or not isinstance(node, DictConfig) or "name" not in node:
        return _shown(OmegaConf.select(config, key))
    return _shown(registry.options(kind, node["name"]).get(option))


def _files(name: str, key: str, overrides: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Files and plugins of the defaults list with the key, in the order of merging."""
    with initialized():
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None
        loader: Any = hydra.config_loader
        defaults = loader.compute_defaults_list(name, [*overrides], RunMode.RUN)
        for default in defaults.defaults:
            if default.config_path is None or default.config_path.startswith("hydra"):
                continue
            found = loader._load_single_config(default, loader.repository)
            config = found.config
            if not OmegaConf.is_config(config):
                continue
            absent = object()  # null is a value too
            value = OmegaConf.select(config, key, default=absent, throw_on_missing=False)
            if value is not absent:
                group, _, option = default.config_path.partition("/")
                of_class = str(found.path).startswith(f"{PluginSource.scheme()}://")
                place = (
                    f"{group}={option}, its own default" if of_class else f"{group}/{option}.yaml"
                )
                yield place if option else f"{group}.yaml", _shown(value)


def _shown(value: Any) -> str:
    if isinstance(value, DictConfig):
        return str(OmegaConf.to_container(value))
    return "null" if value is None else str(value)
