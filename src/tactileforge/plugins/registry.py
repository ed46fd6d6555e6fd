"""Plugins by name: the only module with access to entry points.

Listing reads metadata only, imports nothing and never fails. Using a plugin fails loudly.
"""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from email import message_from_string
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import Parameter
from typing import Any, get_type_hints

from tactileforge.errors import (
    ConfigError,
    PluginError,
    TactileForgeError,
    check_names,
    nearest_name,
    unknown,
)
from tactileforge.plugins import local, moves
from tactileforge.plugins.class_contracts import check_constructor, check_contract
from tactileforge.plugins.class_contracts import context as context
from tactileforge.plugins.class_contracts import parameters as parameters
from tactileforge.plugins.distributions import how_to_get
from tactileforge.plugins.source_options import (
    read_attribute,
    read_docstrings,
    read_hints,
    read_options,
)
from tactileforge.util import strict

KINDS = ("sensors", "datasets", "encoders", "heads", "objectives", "optimizers", "checks")
#: Kinds whose entry points name a module: verbs of the command line.
MODULES = ("verbs",)
#: Kinds without a conformance suite by name: publishers of ``live``, schedules of the learning rate
#: and runners of suites of ``bench`` (a function each), trackers of ``data pack``, callbacks and
#: loggers of Lightning, changes of batches on the device, readers of tables by the endings of their
#: files, packages of YAML options, and containers of data, checked on a file of theirs.
OTHERS = (
    *("containers", "publishers", "schedules", "curves", "runners", "importers", "trackers"),
    *("callbacks", "loggers", "augmentations", "tables", "conf"),
)

#: Kind of plugin behind the options of each group of a configuration.
GROUPS = {
    "sensor": "sensors",
    "force": "sensors",
    "camera": "sensors",
    "robot": "sensors",
    "data": "datasets",
    "encoder": "encoders",
    "head": "heads",
    "objective": "objectives",
    "text_encoder": "encoders",
    "image_encoder": "encoders",
    "optim": "optimizers",
    "callbacks": "callbacks",
    "logger": "loggers",
}


@dataclass(frozen=True)
class PluginInfo:
    """One installed plugin, from metadata alone.

    Attributes:
        name: Name that users type.
        kind: One of `KINDS`, `MODULES` or `OTHERS`.
        target: ``module:Class``, or a module.
        distribution: Package that installed the plugin; "" if unknown.
        version: Version of that package; "" if unknown.
        status: ``ok``, or ``conflict`` when another distribution claims the same name.
    """

    name: str
    kind: str
    target: str
    distribution: str
    version: str
    status: str


def _owner(entry: EntryPoint) -> tuple[str, str]:
    """Name and version of the distribution of an entry point; empty without one."""
    text = (
        entry.dist.read_text("METADATA") or entry.dist.read_text("PKG-INFO") if entry.dist else ""
    )
    return _name_and_version(text or "")


@cache
def _name_and_version(metadata: str) -> tuple[str, str]:
    """Of a distribution; parsed once, since each entry point would parse it anew."""
    message = message_from_string(metadata)
    return message["Name"] or "", message["Version"] or ""


@cache
def _entries(kind: str) -> dict[str, list[EntryPoint]]:
    if kind not in (*KINDS, *MODULES, *OTHERS):
        raise PluginError(unknown("kind of plugin", kind, KINDS))
    # by owner and target: one distribution that is found twice on the path is no conflict
    entries: dict[str, dict[tuple[str, str], EntryPoint]] = {}
    for entry in entry_points(group=f"tactileforge.{kind}"):
        owner = _owner(entry)[0]
        entries.setdefault(entry.name, {}).setdefault((owner, entry.value), entry)
    return {name: list(entries[name].values()) for name in sorted(entries)}


def names(kind: str) -> list[str]:
    """The installed names of a kind, sorted; imports nothing.

    Example:
        >>> "align" in names("objectives")
        True
    """
    own = [name for of, name in _registered if of == kind]
    return sorted({*_entries(kind), *own})


#: Packages whose errors say enough without a place in their files.
_TOLD = ("tactileforge", "lightning", "torch")
#: What `register` was given, by kind and name.
_registered: dict[tuple[str, str], Any] = {}


def register(kind: str, name: str, plugin: Any) -> None:
    """Gives a class, function or instance of one's own a name in this process.

    Args:
        kind: One of `KINDS` or `OTHERS`, such as ``objectives``.
        name: Name to be typed; letters, digits and underscores.
        plugin: The class; or a finished instance, of which every use gets a copy.

    Raises:
        PluginError: An unknown kind, a name that is no word or that an installed plugin has, or
            something that lacks methods of its contract.

    Example:
        >>> from tactileforge.objectives import Pixel
        >>> register("objectives", "my_pixel", Pixel)
        >>> build("objectives", {"name": "my_pixel"}).head
        'pixel'
    """
    if name in _entries(kind):
        raise PluginError(
            f"an installed {kind.removesuffix('s')} has the name {name!r}: take another"
        )
    if not re.fullmatch(r"[A-Za-z_]\w*", name):
        raise PluginError(f"{name!r} is not a name: use letters, digits and underscores")
    check_contract(kind, plugin, f"{kind.removesuffix('s')} {name!r}")
    _registered[kind, name] = plugin


def give(name: str, plugin: Any) -> None:
    """Gives the class for a name of one's own in a file, such as ``my_module:Tiny``.

    Args:
        name: Name as the file has it.
        plugin: The class. The head of an objective, if that is a class, is given with it.
    """
    local.keep(name, plugin)
    head = getattr(plugin, "head", None)
    if isinstance(head, type):
        local.keep(_beside(name, plugin, head), head)


def _beside(name: str, objective: Any, head: Any) -> str:
    """Name of an objective's head: beside the objective, and found as that is."""
    source, _, _ = name.rpartition(":")
    same = getattr(head, "__module__", "") == objective.__module__
    return f"{source}:{head.__qualname__}" if source and same else local.name_of(head)


def adopt(kind: str, name: str, where: str = "") -> Any:
    """Imports a name of one's own that the user typed, and checks its contract.

    Never call it with a name that a downloaded file holds.

    Args:
        kind: Kind of plugin that is wanted there.
        name: Name as typed, ``module:NAME`` or ``./file.py:NAME``.
        where: Place of the name, for errors.

    Raises:
        PluginError: It cannot be imported, or is something else; one line with the place.
    """
    _entries(kind)  # an unknown kind
    plugin = local.resolve(name, where)
    check_contract(kind, plugin, f"{where}={name}" if where else name)
    return plugin


def head_of(objective: str) -> str:
    """Name of the head of an objective; a class that the objective names is known by it.

    Args:
        objective: Name of the objective.

    Raises:
        PluginError: The class has something else for a head.
    """
    entries = _entries("objectives").get(objective, [])
    if len(entries) == 1 and ("objectives", objective) not in _registered:
        written = read_attribute(entries[0].value, "head")  # without an import of torch
        if isinstance(written, str):
            return written
    head = get("objectives", objective).head
    if isinstance(head, str):
        return head
    target = f"{head.__module__}:{head.__qualname__}"
    for installed, entries in _entries("heads").items():
        if any(entry.value == target for entry in entries):  # in a package, beside its objective
            return installed
    check_contract("heads", head, f"the head of objective {objective!r}")
    name = _beside(objective, get("objectives", objective), head)
    local.keep(name, head)
    return name


def list_plugins() -> list[PluginInfo]:
    """Every installed plugin, by kind and name; imports nothing and never fails.

    Example:
        >>> "tactile_vit" in [plugin.name for plugin in list_plugins()]
        True
    """
    return [
        PluginInfo(
            name,
            kind,
            entry.value,
            *_owner(entry),
            "ok" if len(entries) == 1 else "conflict",
        )
        for kind in (*KINDS, *MODULES, *OTHERS)
        for name, entries in _entries(kind).items()
        for entry in entries
    ]


def _describe(kind: str, entry: EntryPoint) -> str:
    dist = f", from {entry.dist.name} {entry.dist.version}" if entry.dist else ""
    return f"{kind.removesuffix('s')} {entry.name!r} ({entry.value}{dist})"


def get(kind: str, name: str) -> type[Any]:
    """Imports one plugin class.

    Raises:
        PluginError: Not installed (names the nearest), claimed twice (names both), or broken.
    """
    loaded: type[Any] = load(kind, name)
    return loaded


def load(kind: str, name: str) -> Any:
    """Imports one plugin: a class, or the module of a verb.

    Raises:
        PluginError: Not installed (names the nearest), claimed twice (names both), or broken.
    """
    if (kind, name) in _registered:
        return _registered[kind, name]
    if local.is_local(name):
        return _given(kind, name)
    entries = _entries(kind).get(name, [])
    if not entries:
        is_typo = nearest_name(name, names(kind)) != "."
        got = how_to_get(kind, name)
        fix = "" if is_typo else "Install the package that provides it"
        if fix and kind in GROUPS.values():
            fix += ", or give a class of your own as my_module:Class"
        if fix and kind == "callbacks":
            fix = "Others are lightning.pytorch.callbacks:Class, and your own my_module:Class"
        fix = f"It {got}" if got else fix
        fix = dotted(name) or fix
        raise PluginError(unknown(kind.removesuffix("s"), name, names(kind), fix))
    if len(entries) > 1:
        claims = " and ".join(_describe(kind, entry) for entry in entries)
        raise PluginError(f"{claims} claim one name: uninstall one of the two packages")
    try:
        return entries[0].load()
    except (Exception, SystemExit) as error:  # a plugin that exits must not end this process
        why = f"{type(error).__name__}: {error}"
        hint = moves.import_hint(error)
        raise PluginError(
            f"{_describe(kind, entries[0])} cannot be loaded: {why}{hint and f'; {hint}'}"
        ) from error


def dotted(name: str) -> str:
    """Fix for a class of one's own with a dot before its name; "" for another name.

    Example:
        >>> dotted("my_module.Contrast"), dotted("pixel")
        ('A class of yours is my_module:Contrast', '')
    """
    module, _, own = name.rpartition(".")
    is_class = own.isidentifier() and own[0].isupper()
    return f"A class of yours is {module}:{own}" if module and is_class else ""


def _given(kind: str, name: str) -> Any:
    """A class of the user's own that was typed or given in this process; imports nothing."""
    what = f"{kind.removesuffix('s')} {name!r}"
    try:
        found = local.find(name)
    except KeyError:
        raise local.not_given(f"{what} is", [name]) from None
    check_contract(kind, found, what)
    return found


def options(kind: str, name: str) -> dict[str, Any]:
    """The configuration of an installed plugin, as `parameters`; imports it only if it has to.

    Raises:
        PluginError: Not installed (names the nearest), claimed twice (names both), or broken.
    """
    entries = _entries(kind).get(name, [])
    plain = len(entries) == 1 and (kind, name) not in _registered
    found = read_options(entries[0].value) if plain else None
    if found is None:
        return parameters(get(kind, name))
    from tactileforge.contracts import CONTEXT

    return {key: default for key, default in found.items() if key not in CONTEXT}


def meanings(kind: str, name: str) -> dict[str, str]:
    """Descriptions of the options of an installed plugin; imports it only if it has to.

    Raises:
        PluginError: It is not installed, or is claimed twice.
    """
    known, entries = options(kind, name), _entries(kind).get(name, [])
    found: dict[str, str] = {}
    plain = len(entries) == 1 and (kind, name) not in _registered
    for text in read_docstrings(entries[0].value) if plain else ():
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
    if name in names(kind) or local.is_local(name):
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
    entries = _entries(kind).get(name, [])
    if len(entries) == 1 and (kind, name) not in _registered:
        check_hints(arguments, read_hints(entries[0].value), where)
    elif _given(kind, name) is not None:
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
