"""Options of the groups of a configuration: installed plugins and YAML files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import pairwise
from pathlib import Path

from tactileforge.plugins import registry
from tactileforge.plugins.distributions import conf_packages

#: Groups that hold several options at once, each under its own name.
MULTI = frozenset({"head", "objective", "sensor", "callbacks"})
#: Flags of Hydra that name a folder of options.
_FOLDER = ("--config-dir", "-cd")


def own_places(overrides: Sequence[str], flags: Sequence[str]) -> tuple[list[str], list[str]]:
    """Finds the user's own folders and packages of options on a command line.

    Args:
        overrides: ``key=value`` words; ``hydra.searchpath`` may be one.
        flags: Flags of Hydra; ``--config-dir`` may be one.

    Returns:
        The other overrides, and the places in the form of Hydra's search path.

    Example:
        >>> own_places(["seed=1", "hydra.searchpath=[pkg://mine]"], [])
        (['seed=1'], ['pkg://mine'])
    """
    pairs = pairwise(flags)
    places = [f"file://{Path(value).absolute()}" for flag, value in pairs if flag in _FOLDER]
    rest = []
    for word in overrides:
        name, _, value = word.partition("=")
        if name == "hydra.searchpath":
            items = [item.strip("'\" ") for item in value.strip("[]").split(",")]
            places += [item if "://" in item else f"file://{item}" for item in items]
        else:
            rest.append(word)
    return rest, places


def places_of(words: Sequence[str], flags: Sequence[str]) -> list[str]:
    """Words naming the user's own folders of options, as typed."""
    named = [word for pair in pairwise(flags) if pair[0] in _FOLDER for word in pair]
    return [*named, *(word for word in words if word.startswith("hydra.searchpath="))]


def options(group: str, own: Sequence[str] = ()) -> list[str]:
    """The options of a group, sorted; imports no plugin.

    Args:
        group: Name of the group, such as ``recipe``.
        own: Further places, see `own_places`.
    """
    names = set(registry.names(registry.GROUPS[group])) if group in registry.GROUPS else set()
    places = ["tactileforge.conf", "tactileforge.zoo"]
    places += conf_packages()
    for place in [*places, *own]:
        folder = _folder(place, group)
        if folder is not None and folder.is_dir():
            entries = [item.name for item in folder.iterdir()]
            names |= {name.removesuffix(".yaml") for name in entries if name.endswith(".yaml")}
    return sorted(names)


def _folder(place: str, group: str) -> Traversable | None:
    """Folder of a group in a package or folder; None if the package is not installed."""
    kind, _, name = place.rpartition("://")
    if kind == "file":
        return Path(name) / group
    try:
        return files(name) / group
    except ModuleNotFoundError:
        return None


#: Default of a group whose option hangs on the scale; see `chosen_by`.
_BY_SCALE = re.compile(r"\$\{tactileforge_if:\$\{scale\},(\w+),(\w+),(\w+)\}")


def yaml_options(group: str) -> set[str]:
    """Options of a group with a YAML in conf/."""
    names = [item.name for item in (files("tactileforge.conf") / group).iterdir()]
    return {name.removesuffix(".yaml") for name in names if name.endswith(".yaml")}


def yaml_text(name: str) -> str:
    """Text of a YAML in conf/."""
    return (files("tactileforge.conf") / f"{name}.yaml").read_text("utf-8")


def chosen_by(value: str, wanted: str, chosen: str | None, other: str | None) -> str | None:
    """Resolves ``${tactileforge_if:${KEY},wanted,chosen,other}`` of YAML.

    Args:
        value: Value of the key.
        wanted: Value to compare it with.
        chosen: Result where they are equal.
        other: Result elsewhere.

    Example:
        >>> chosen_by("paper", "paper", "clip", "byte"), chosen_by("tiny", "paper", "clip", "byte")
        ('clip', 'byte')
    """
    return chosen if value == wanted else other


def yaml_groups(name: str, scale: str = "") -> dict[str, str]:
    """The groups in the defaults list of a YAML in conf/ and of its recipe, and their defaults.

    Args:
        name: Name of the YAML.
        scale: Scale that was typed; "" for the recipe's.
    """
    import yaml

    rows = yaml.safe_load(yaml_text(name))["defaults"]
    found = {key: value for row in rows if isinstance(row, dict) for key, value in row.items()}
    if "recipe" in found:  # a recipe chooses the options of further groups
        text = (files("tactileforge.zoo") / "recipe" / f"{found['recipe']}.yaml").read_text("utf-8")
        rows = yaml.safe_load(text)["defaults"]
        of_recipe = {k: v for row in rows if isinstance(row, dict) for k, v in row.items()}
        found |= {key[1:]: value for key, value in of_recipe.items() if key.startswith("/")}
    for key, value in found.items():
        if match := _BY_SCALE.fullmatch(str(value)):
            found[key] = chosen_by(scale or found["scale"], *match.groups())
    return {
        key: f"[{','.join(value)}]" if isinstance(value, list) else value
        for key, value in found.items()
        if " " not in key and "/" not in key  # no "override hydra/launcher"
    }
