"""Names of plugins in this process: installed ones, from metadata, and registered ones.

The only module with access to entry points. It imports no plugin.
"""

from __future__ import annotations

from dataclasses import dataclass
from email import message_from_string
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from tactileforge.errors import PluginError, unknown
from tactileforge.plugins.kinds import KINDS, MODULES, OTHERS

#: What `register` was given, by kind and name.
registered: dict[tuple[str, str], Any] = {}


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


def owner(entry: EntryPoint) -> tuple[str, str]:
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
def entries(kind: str) -> dict[str, list[EntryPoint]]:
    """Entry points of a kind by name, sorted; several where distributions claim one name.

    Raises:
        PluginError: There is no such kind.
    """
    if kind not in (*KINDS, *MODULES, *OTHERS):
        raise PluginError(unknown("kind of plugin", kind, KINDS))
    # by owner and target: one distribution that is found twice on the path is no conflict
    found: dict[str, dict[tuple[str, str], EntryPoint]] = {}
    for entry in entry_points(group=f"tactileforge.{kind}"):
        package = owner(entry)[0]
        found.setdefault(entry.name, {}).setdefault((package, entry.value), entry)
    return {name: list(found[name].values()) for name in sorted(found)}


def target(kind: str, name: str) -> str:
    """Target of the one entry point of a name; "" without one, or where the name is registered."""
    claims = entries(kind).get(name, [])
    return claims[0].value if len(claims) == 1 and (kind, name) not in registered else ""


def names(kind: str) -> list[str]:
    """The installed names of a kind, sorted; imports nothing.

    Example:
        >>> "align" in names("objectives")
        True
    """
    own = [name for of, name in registered if of == kind]
    return sorted({*entries(kind), *own})


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
            *owner(entry),
            "ok" if len(claims) == 1 else "conflict",
        )
        for kind in (*KINDS, *MODULES, *OTHERS)
        for name, claims in entries(kind).items()
        for entry in claims
    ]


def describe(kind: str, entry: EntryPoint) -> str:
    """Kind, name, target and distribution of an entry point, for errors."""
    dist = f", from {entry.dist.name} {entry.dist.version}" if entry.dist else ""
    return f"{kind.removesuffix('s')} {entry.name!r} ({entry.value}{dist})"
