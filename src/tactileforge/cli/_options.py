"""Options of the groups of a configuration: plugins that are installed, and YAML files."""

from __future__ import annotations

from importlib.metadata import entry_points
from importlib.resources import files

from tactileforge import registry


def options(group: str) -> list[str]:
    """The options of a group, sorted; imports no plugin.

    Those of ``--config-dir`` and ``hydra.searchpath`` are not among them.
    """
    names = set(registry.names(registry.GROUPS[group])) if group in registry.GROUPS else set()
    places = ["tactileforge.conf", "tactileforge.zoo"]
    places += [entry.value for entry in entry_points(group="tactileforge.conf")]
    for place in places:
        folder = files(place) / group
        if folder.is_dir():
            entries = [item.name for item in folder.iterdir()]
            names |= {name.removesuffix(".yaml") for name in entries if name.endswith(".yaml")}
    return sorted(names)
