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


def yaml_text(name: str) -> str:
    """Text of a YAML in conf/."""
    return (files("tactileforge.conf") / f"{name}.yaml").read_text("utf-8")


def yaml_groups(name: str) -> dict[str, str]:
    """The groups in the defaults list of a YAML in conf/, and the default of each."""
    import yaml

    rows = yaml.safe_load(yaml_text(name))["defaults"]
    found = {key: value for row in rows if isinstance(row, dict) for key, value in row.items()}
    return {key: value for key, value in found.items() if " " not in key and "/" not in key}
