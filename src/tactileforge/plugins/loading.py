"""Classes of plugins: imported by name, given in this process, and checked by their contract."""

from __future__ import annotations

import re
from typing import Any

from tactileforge.errors import PluginError, nearest_name, unknown
from tactileforge.plugins import local, metadata, moves
from tactileforge.plugins.class_contracts import check_contract
from tactileforge.plugins.distributions import how_to_get
from tactileforge.plugins.kinds import GROUPS
from tactileforge.plugins.source_options import read_attribute


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
        >>> from tactileforge.plugins import build
        >>> register("objectives", "my_pixel", Pixel)
        >>> build("objectives", {"name": "my_pixel"}).head
        'pixel'
    """
    if name in metadata.entries(kind):
        raise PluginError(
            f"an installed {kind.removesuffix('s')} has the name {name!r}: take another"
        )
    if not re.fullmatch(r"[A-Za-z_]\w*", name):
        raise PluginError(f"{name!r} is not a name: use letters, digits and underscores")
    check_contract(kind, plugin, f"{kind.removesuffix('s')} {name!r}")
    metadata.registered[kind, name] = plugin


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
    metadata.entries(kind)  # an unknown kind
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
    if place := metadata.target("objectives", objective):
        written = read_attribute(place, "head")  # without an import of torch
        if isinstance(written, str):
            return written
    head = get("objectives", objective).head
    if isinstance(head, str):
        return head
    target = f"{head.__module__}:{head.__qualname__}"
    for known, entries in metadata.entries("heads").items():
        if any(entry.value == target for entry in entries):  # in a package, beside its objective
            return known
    check_contract("heads", head, f"the head of objective {objective!r}")
    name = _beside(objective, get("objectives", objective), head)
    local.keep(name, head)
    return name


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
    if (kind, name) in metadata.registered:
        return metadata.registered[kind, name]
    if local.is_local(name):
        return given_here(kind, name)
    entries = metadata.entries(kind).get(name, [])
    if not entries:
        is_typo = nearest_name(name, metadata.names(kind)) != "."
        got = how_to_get(kind, name)
        fix = "" if is_typo else "Install the package that provides it"
        if fix and kind in GROUPS.values():
            fix += ", or give a class of your own as my_module:Class"
        if fix and kind == "callbacks":
            fix = "Others are lightning.pytorch.callbacks:Class, and your own my_module:Class"
        fix = f"It {got}" if got else fix
        fix = dotted(name) or fix
        raise PluginError(unknown(kind.removesuffix("s"), name, metadata.names(kind), fix))
    if len(entries) > 1:
        claims = " and ".join(metadata.describe(kind, entry) for entry in entries)
        raise PluginError(f"{claims} claim one name: uninstall one of the two packages")
    try:
        return entries[0].load()
    except (Exception, SystemExit) as error:  # a plugin that exits must not end this process
        why = f"{type(error).__name__}: {error}"
        hint = moves.import_hint(error)
        raise PluginError(
            f"{metadata.describe(kind, entries[0])} cannot be loaded: {why}{hint and f'; {hint}'}"
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


def given_here(kind: str, name: str) -> Any:
    """A class of the user's own that was typed or given in this process; imports nothing."""
    what = f"{kind.removesuffix('s')} {name!r}"
    try:
        found = local.find(name)
    except KeyError:
        raise local.not_given(f"{what} is", [name]) from None
    check_contract(kind, found, what)
    return found
