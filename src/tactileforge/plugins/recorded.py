"""Absent plugins of a run, with their distributions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tactileforge.errors import PluginError
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import how_to_get, package_of

#: Groups with several plugins, each by a key.
_SEVERAL = ("objective", "head", "callbacks")


def check_installed(
    config: Mapping[str, Any],
    recorded: Mapping[str, str],
    what: str,
    groups: Collection[str] = tuple(registry.GROUPS),
) -> None:
    """Checks that the plugins of a run are installed, if the run recorded their distributions.

    Args:
        config: Configuration of the run.
        recorded: Distribution and version of each plugin that was installed then, by
            ``KIND/NAME``, as in ``versions.json``.
        what: The run, for the error.
        groups: Groups of the configuration to look at.

    Raises:
        PluginError: Some are absent; names each, with its distribution.
    """
    absent: dict[str, list[tuple[str, str]]] = {}
    for kind, name in _named(config, groups):
        source = recorded.get(f"{kind}/{name}", "").strip()
        if source and name not in registry.names(kind) and not local.is_local(name):
            absent.setdefault(source, []).append((kind, name))
    if absent:
        said = "; ".join(_said(source, plugins) for source, plugins in absent.items())
        raise PluginError(f"{what} was made with {said}")


def _said(source: str, plugins: Collection[tuple[str, str]]) -> str:
    """What came from one distribution, and how to have it again."""
    named = " and ".join(f"{kind.removesuffix('s')} {name!r}" for kind, name in plugins)
    distribution, _, was = source.partition(" ")
    kind, name = next(iter(plugins))
    if package_of(kind, name) == distribution:
        return f"{named}, which {how_to_get(kind, name)}"
    try:
        now = version(distribution)
    except PackageNotFoundError:
        return f"{named} of {source}, which is not installed: install it as for that run"
    return f"{named} of {source}, and {now} is installed, which has none: install {was}"


def _named(config: Mapping[str, Any], groups: Collection[str]) -> Iterator[tuple[str, str]]:
    """Kinds and names of the plugins in a configuration, each once."""
    found: dict[tuple[str, str], None] = {}
    augment = config.get("augment")
    also = augment.get("also") if isinstance(augment, Mapping) else None
    blocks = [(registry.GROUPS[group], config.get(group), group in _SEVERAL) for group in groups]
    for kind, block, several in [*blocks, ("augmentations", also, True)]:
        nodes = block if several else {"": block}
        for key, node in nodes.items() if isinstance(nodes, Mapping) else ():
            if isinstance(node, Mapping) and (name := node.get("name") or key):
                found[kind, str(name)] = None
    optim = config.get("optim")
    if isinstance(optim, Mapping) and optim.get("schedule"):
        found["schedules", str(optim["schedule"])] = None
    yield from found
