"""Plugins as Hydra options.

Every entry point is an option: ``tactileforge train objective=[pixel,diff]`` works for all
installed plugins. Listing options reads metadata; choosing one imports its class, and the defaults
of its constructor become the node of the configuration.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from enum import Enum
from inspect import Parameter
from pathlib import Path
from typing import Any, ClassVar

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.hydra_config import HydraConfig
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import MISSING, OmegaConf

from tactileforge.cli._options import MULTI, chosen_by
from tactileforge.errors import PluginError
from tactileforge.plugins import class_contracts, local, registry
from tactileforge.plugins.distributions import conf_packages
from tactileforge.plugins.kinds import GROUPS

log = logging.getLogger(__name__)


# here: Hydra imports this module for its search path, in every application
OmegaConf.register_new_resolver("tactileforge_if", chosen_by, replace=True)


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
        group, name = parted(config_path)
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
        group, name = parted(config_path)
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


def parted(config_path: str) -> tuple[str, str]:
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
