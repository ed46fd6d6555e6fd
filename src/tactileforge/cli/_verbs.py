"""The verbs: a file of this folder each, and modules of installed packages.

A package brings a verb by an entry point in ``tactileforge.verbs``: its name, and a module with the
contract of a file of this folder. Listing reads source text and metadata; only a verb that is used
is imported.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.distributions import package_of
from tactileforge.errors import ConfigError, PluginError, unknown

if TYPE_CHECKING:
    from tactileforge.cli._command import Command


def builtin() -> dict[str, str]:
    """Summaries of the verbs of the package itself, by name."""
    files = sorted(Path(__file__).parent.glob("[a-z]*.py"))
    return {file.stem: _summary(file) for file in files}


def verbs() -> dict[str, str]:
    """Summaries of all verbs by name, built-in first; imports none of them.

    A package cannot replace a built-in verb: the built-in one is listed, and
    ``tactileforge plugins list`` shows the conflict.
    """
    from tactileforge import registry  # numpy: the verbs of the package itself need none

    known = builtin()
    for plugin in registry.list_plugins():
        if plugin.kind == "verbs" and plugin.name not in known:
            conflict = plugin.status == "conflict"
            claim = "claimed by several packages: see tactileforge plugins list"
            known[plugin.name] = claim if conflict else summary(plugin.target)
    return known


def commands(verb: str) -> Mapping[str, Command]:
    """The commands of a verb, by action.

    Raises:
        ConfigError: The verb is unknown; names the nearest, or the package to install.
        PluginError: The verb comes with a package, and cannot be imported or is claimed twice.
    """
    if verb in builtin():
        found: Mapping[str, Command] = import_module(f"tactileforge.cli.{verb}").COMMANDS
        return found
    from tactileforge import registry

    if verb not in registry.names("verbs"):
        if package := package_of("verbs", verb):
            raise ConfigError(f"{verb} comes with {package}: pip install {package}")
        fix = "tactileforge --help says what each does"
        raise ConfigError(unknown("verb", verb, verbs(), fix))
    module = registry.load("verbs", verb)
    found = getattr(module, "COMMANDS", None) or {}
    if not isinstance(found, Mapping):
        raise PluginError(f"verb {verb!r} ({module.__name__}): COMMANDS is not a dict of commands")
    if not found:
        raise PluginError(f"verb {verb!r} ({module.__name__}): the module has no COMMANDS")
    return found


@cache
def summary(module: str) -> str:
    """First line of a module's docstring, from its source; "" where there is no source to read.

    Only the package at the top is looked up, which imports nothing.
    """
    top, *rest = module.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return ""
    places = list(spec.submodule_search_locations or ()) if spec and rest else []
    paths = [Path(place, *rest) for place in places]
    if spec and spec.origin and not rest:
        paths = [Path(spec.origin).with_suffix("")]
    for path in paths:
        for file in (path.with_suffix(".py"), path / "__init__.py"):
            if file.is_file():
                return _summary(file)
    return ""


def _summary(file: Path) -> str:
    try:
        doc = ast.get_docstring(ast.parse(file.read_text("utf-8")))
    except (SyntaxError, ValueError, OSError):  # named when the verb is used
        return ""
    return (doc or "").partition("\n")[0]
