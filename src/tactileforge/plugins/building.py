"""Plugins made from a configuration: their options, checked by the hints of a constructor."""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Mapping
from contextlib import suppress
from inspect import Parameter
from typing import Any, get_type_hints

from tactileforge.errors import ConfigError, PluginError, TactileForgeError, check_names
from tactileforge.plugins import local, metadata
from tactileforge.plugins.class_contracts import check_constructor, context, parameters
from tactileforge.plugins.loading import get, given_here
from tactileforge.plugins.source_options import read_docstrings, read_hints, read_options
from tactileforge.util import strict

#: Packages whose errors say enough without a place in their files.
_TOLD = ("tactileforge", "lightning", "torch")


def options(kind: str, name: str) -> dict[str, Any]:
    """The configuration of an installed plugin, as `parameters`; imports it only if it has to.

    Raises:
        PluginError: Not installed (names the nearest), claimed twice (names both), or broken.
    """
    place = metadata.target(kind, name)
    found = read_options(place) if place else None
    if found is None:
        return parameters(get(kind, name))
    from tactileforge.contracts import CONTEXT

    return {key: default for key, default in found.items() if key not in CONTEXT}


def meanings(kind: str, name: str) -> dict[str, str]:
    """Descriptions of the options of an installed plugin; imports it only if it has to.

    Raises:
        PluginError: It is not installed, or is claimed twice.
    """
    known, place = options(kind, name), metadata.target(kind, name)
    found: dict[str, str] = {}
    for text in read_docstrings(place) if place else ():
        found |= strict.rows_of(text)
    return found if known.keys() <= found.keys() else strict.arguments(get(kind, name))


def without_start(kind: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """A plugin's configuration without the options of its first weights.

    The class names them in ``starting_options``: files of weights, or whether to fetch some. They
    are of no use to a plugin whose weights come from a checkpoint, and a downloaded file must not
    cause a download.

    Args:
        kind: One of `KINDS`.
        config: ``{"name": ..., **arguments}``; one whose plugin is not installed stays as it is.
    """
    name = str(config.get("name"))
    options: tuple[str, ...] = ()
    if name in metadata.names(kind) or local.is_local(name):
        with suppress(PluginError):  # one of the user's own that was not given here
            options = getattr(get(kind, name), "starting_options", ())
    return {key: value for key, value in config.items() if key not in options}


def chosen(kind: str, config: Mapping[str, Any]) -> tuple[type[Any], str, dict[str, Any]]:
    """The plugin of a configuration, its name, and its checked arguments.

    Args:
        kind: One of `KINDS` or `OTHERS`.
        config: ``{"name": ..., **arguments}``.

    Raises:
        PluginError: The plugin is not installed, claimed twice, or broken.
        ConfigError: The configuration names no plugin, or an argument is unknown.
    """
    arguments = strict.mapping(f"the {kind.removesuffix('s')}", config)
    if "name" not in arguments:
        raise ConfigError(f"the {kind.removesuffix('s')} names no plugin: its YAML has no name:")
    name = str(arguments.pop("name"))
    plugin = get(kind, name)
    known, what = parameters(plugin), f"{kind.removesuffix('s')} {name!r}"
    if isinstance(plugin, type):
        check_constructor(kind, plugin, what)
    for key in arguments:
        fix = f"Where a recipe or scale gave it, take it away: ~encoder.{key}"
        check_names(f"option of {what}", [key], known, fix if kind == "encoders" else "")
    return plugin, name, arguments


def build(kind: str, config: Mapping[str, Any], where: str = "", /, **given: Any) -> Any:
    """Builds a plugin from its configuration: ``name`` and constructor arguments.

    Args:
        kind: One of `KINDS` or `OTHERS`.
        config: ``{"name": ..., **arguments}``.
        where: Place of the node in a configuration, for errors: ``data``, ``head.force``; "" for
            none.
        given: Values for constructor parameters in `contracts.CONTEXT`; those the plugin does not
            name are not passed.

    Raises:
        PluginError: The plugin is not installed, claimed twice, or broken; or where ``where`` is
            given, its constructor raised: one line with the place in its file. Otherwise, and of
            our own and Lightning's plugins, that error is as it was.
        ConfigError: An argument is unknown, missing, or of another type than its hint.

    Example:
        >>> build("objectives", {"name": "surface"}).head
        'surface'
    """
    plugin, name, arguments = checked(kind, config, where)
    known = parameters(plugin)
    if not isinstance(plugin, type) and not inspect.isroutine(plugin):
        return copy.deepcopy(plugin)
    wanted = context(plugin)
    try:
        return plugin(**arguments, **{key: given[key] for key in wanted if key in given})
    except ConfigError as error:
        text = str(error)
        # a plugin knows the name of its option, not its place
        if where and re.split(r"=| is |: ", text, maxsplit=1)[0] in known:
            raise ConfigError(_below(where, text)) from error
        raise
    except TactileForgeError:
        raise
    except Exception as error:
        # what reads files of models tells of errors itself
        if not where or plugin.__module__.partition(".")[0] in _TOLD:
            raise
        # the author's line, not a traceback of ours
        raise PluginError(f"{where}: {name} cannot be built: {local.place_of(error)}") from error


def checked(
    kind: str, config: Mapping[str, Any], where: str = ""
) -> tuple[type[Any], str, dict[str, Any]]:
    """The plugin of a configuration, its name and arguments: known, present and of their types.

    Arguments and errors are those of `build`; nothing is built.
    """
    plugin, name, arguments = chosen(kind, config)
    what = f"{kind.removesuffix('s')} {name!r}"
    for key, default in parameters(plugin).items():
        if default is Parameter.empty and key not in arguments:
            raise ConfigError(f"{what} needs {key!r}: set {_below(where, key)}=...")
    check_types(f"{where}." if where else f"{what}: ", plugin, arguments)
    return plugin, name, arguments


def check_node(kind: str, config: Mapping[str, Any], where: str) -> None:
    """Checks values of a plugin's options by the hints of its constructor.

    Args:
        kind: One of `KINDS` or `OTHERS`.
        config: ``{"name": ..., **arguments}``; interpolations and missing values pass.
        where: Place of the node in a configuration.

    Raises:
        PluginError: The plugin is not installed, or is claimed twice.
        ConfigError: A value is of another type.
    """
    name = str(config["name"])
    arguments = {key: value for key, value in config.items() if key in options(kind, name)}
    if place := metadata.target(kind, name):
        check_hints(arguments, read_hints(place), where)
    elif given_here(kind, name) is not None:
        check_types(f"{where}.", get(kind, name), _written(arguments))


def check_hints(arguments: Mapping[str, Any], hints: Mapping[str, Any], where: str) -> None:
    """Checks values by the hints of a constructor.

    Args:
        arguments: Values by parameter; those of other names pass.
        hints: Types by parameter; see `source_options.read_hints`.
        where: Place of the values in a configuration.

    Raises:
        ConfigError: A value is of another type.
    """
    for key, value in _written(arguments).items():
        strict.typed(f"{where}.{key}", value, hints.get(key, Any))


def _written(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Values given as such: neither missing nor interpolated."""
    return {key: x for key, x in arguments.items() if "???" not in str(x) and "${" not in str(x)}


def _below(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def check_types(before: str, plugin: type[Any], arguments: Mapping[str, Any]) -> None:
    """Checks arguments against the hints of a constructor.

    Args:
        before: Place of the arguments with what separates it from their names, for errors.
        plugin: The class.
        arguments: Its arguments, as plain data.

    Raises:
        ConfigError: One is of another type.
    """
    try:
        hints = get_type_hints(plugin.__init__)
    except Exception:  # names imported for type checking alone cannot be resolved: no check
        return
    for key, value in arguments.items():
        strict.typed(f"{before}{key}", value, hints.get(key, Any))
