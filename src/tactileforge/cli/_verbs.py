"""The verbs: a file of this folder each, and modules of installed packages.

A package brings a verb by an entry point in ``tactileforge.verbs``: its name, and a module with the
contract of a file of this folder. A name with a dot, such as ``data.lerobot``, is an action of a
verb.
Listing reads source text and metadata; only a verb that is used is imported.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins.distributions import how_to_get

if TYPE_CHECKING:
    from tactileforge.cli._command import Command
    from tactileforge.plugins.metadata import PluginInfo


def builtin() -> dict[str, str]:
    """Summaries of the verbs of the package itself, by name."""
    files = sorted(Path(__file__).parent.glob("[a-z]*.py"))
    return {file.stem: _summary(file) for file in files}


def verbs() -> dict[str, str]:
    """Summaries of all verbs by name, built-in first; imports none of them.

    A package cannot replace a built-in verb: the built-in one is listed, and
    ``tactileforge plugins list`` shows the conflict.
    """
    from tactileforge.plugins import registry  # imports numpy, which built-in verbs do without

    known = builtin()
    for plugin in registry.list_plugins():
        if plugin.kind == "verbs" and plugin.name not in known and "." not in plugin.name:
            known[plugin.name] = _line(plugin)
    return known


def is_taken(name: str) -> bool:
    """Whether the name of a package's verb or action is taken by a built-in one."""
    verb, _, action = name.partition(".")
    if verb not in builtin() or not action:
        return verb in builtin()
    # from the source, as an import of the verb would cost its libraries
    tree = ast.parse(Path(__file__).with_name(f"{verb}.py").read_text("utf-8"))
    made = [node for node in tree.body if isinstance(node, ast.Assign)]
    rows = [node.value for node in made if ast.unparse(node.targets[0]) == "COMMANDS"]
    keys = [key for row in rows if isinstance(row, ast.Dict) for key in row.keys]
    return action in {str(key.value) for key in keys if isinstance(key, ast.Constant)}


class Actions(Mapping[str, "Command"]):
    """Commands of a verb by action; commands of other packages are imported on first use.

    Args:
        verb: Name of the verb.
        own: Commands of its own module, which no package replaces.
    """

    def __init__(self, verb: str, own: Mapping[str, Command]) -> None:
        self.verb, self.own = verb, own

    @cached_property
    def added(self) -> dict[str, str]:
        """Summaries of the actions added by packages, by action."""
        from tactileforge.plugins import (
            registry,  # imports numpy, which most commands here do without
        )

        found = {}
        for plugin in registry.list_plugins():
            verb, _, action = plugin.name.partition(".")
            if plugin.kind == "verbs" and verb == self.verb and action and action not in self.own:
                found[action] = _line(plugin)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter([*self.own, *self.added])

    def __len__(self) -> int:
        return len(self.own) + len(self.added)

    def __contains__(self, action: object) -> bool:
        # key=value is not an action, and is told from one without listing the packages' actions
        is_word = isinstance(action, str) and action.isidentifier()
        return action in self.own or (is_word and action in self.added)

    def __getitem__(self, action: str) -> Command:
        if action in self.own or action not in self:
            return self.own[action]
        found = _of_package(f"{self.verb}.{action}")
        if list(found) != [""]:
            name = f"{self.verb}.{action}"
            raise PluginError(f"verb {name!r}: an action has one command, COMMANDS = {{'': ...}}")
        return found[""]

    def summaries(self) -> dict[str, str]:
        """One line for each action; imports no action of a package."""
        return {name: command.about for name, command in self.own.items()} | self.added


def commands(verb: str) -> Actions:
    """The commands of a verb, by action.

    Raises:
        ConfigError: The verb is unknown; names the nearest, or the package to install.
        PluginError: The verb comes with a package, and cannot be imported or is claimed twice.
    """
    return Actions(verb, own_commands(verb) if verb in builtin() else _of_package(verb))


def own_commands(verb: str) -> Mapping[str, Command]:
    """Commands of a built-in verb by action, without those added by packages."""
    found: Mapping[str, Command] = import_module(f"tactileforge.cli.{verb}").COMMANDS
    return found


def _of_package(verb: str) -> Mapping[str, Command]:
    from tactileforge.plugins import registry

    if verb not in registry.names("verbs"):
        if fix := how_to_get("verbs", verb):
            raise ConfigError(f"{verb} {fix}")
        fix = "tactileforge --help says what each does"
        raise ConfigError(unknown("verb", verb, verbs(), fix))
    module = registry.load("verbs", verb)
    found: Mapping[str, Command] = getattr(module, "COMMANDS", None) or {}
    if not isinstance(found, Mapping):
        raise PluginError(f"verb {verb!r} ({module.__name__}): COMMANDS is not a dict of commands")
    if not found:
        raise PluginError(f"verb {verb!r} ({module.__name__}): the module has no COMMANDS")
    return found


def _line(plugin: PluginInfo) -> str:
    """Line of a package's verb, or action, in ``--help``."""
    if plugin.status == "conflict":
        return "claimed by several packages: see tactileforge plugins list"
    return summary(plugin.target)


@cache
def summary(module: str) -> str:
    """First line of a module's docstring, from its source; "" without readable source.

    Only the top-level package is looked up, since `find_spec` of a submodule would import its
    parents.
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
    except (SyntaxError, ValueError, OSError):  # reported when the verb is used
        return ""
    return (doc or "").partition("\n")[0]
