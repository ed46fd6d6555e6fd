"""The checks of every kind of plugin."""

from __future__ import annotations

import ast
import os
import re
import sys
import threading
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from importlib.util import find_spec, resolve_name
from inspect import Parameter, signature
from pathlib import Path
from types import FrameType
from typing import Any

from torch import nn

from tactileforge.contracts import Sensor
from tactileforge.errors import PluginError
from tactileforge.plugins import class_contracts, registry
from tactileforge.testing.batches import context_of
from tactileforge.testing.modules import small_context
from tactileforge.testing.results import Check, CheckSubject, Skip, Violation, require


def name_is_snake_case(subject: CheckSubject) -> None:
    """The name has lower case, digits and single underscores; an action is VERB.ACTION."""
    if not subject.name:
        raise Skip("the class is not installed as a plugin, so it has no name")
    word = r"[a-z][a-z0-9]*(_[a-z0-9]+)*"
    good = re.fullmatch(rf"{word}(\.{word})?" if subject.kind == "verbs" else word, subject.name)
    require(good is not None, f"{subject.name!r} is not snake_case")


def it_has_what_its_kind_needs(subject: CheckSubject) -> None:
    """It has the methods and attributes of its kind, and is not of another kind."""
    try:
        class_contracts.check_members(subject.kind, subject.plugin, "it")
    except PluginError as error:
        raise Violation(str(error)) from error


def parameters_are_explicit(subject: CheckSubject) -> None:
    """Every parameter has a name of its own, since parameters become keys of the configuration."""
    if subject.plugin.__init__ in (nn.Module.__init__, Sensor.__init__):  # an inherited one
        return
    for parameter in signature(subject.plugin).parameters.values():
        explicit = parameter.kind in (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
        require(explicit, f"constructor has {parameter}: name each parameter")


def option_names_are_free(subject: CheckSubject) -> None:
    """Names of options are not those of keys of the framework."""
    try:
        class_contracts.check_constructor(subject.kind, subject.plugin, "the constructor")
    except PluginError as error:
        raise Violation(str(error)) from error


def defaults_are_plain_data(subject: CheckSubject) -> None:
    """Defaults can be written in YAML."""
    for key, value in registry.parameters(subject.plugin).items():
        plain = value is Parameter.empty or _plain(value)
        require(plain, f"default of {key!r} is {value!r}: use None, numbers, strings, lists, dicts")


def _plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_plain, value))
    if isinstance(value, dict):
        return all(isinstance(key, str) and _plain(item) for key, item in value.items())
    return value is None or type(value) in (bool, int, float, str)


def constructing_does_no_io(subject: CheckSubject) -> None:
    """The constructor opens no file or device and starts no process or thread."""
    is_part = subject.kind in ("heads", "objectives")
    context = small_context() | context_of([subject.plugin]) if is_part else {}
    if subject.instance is not None:
        raise Skip("an instance was given; give the class and its options to check this")
    handles, threads = _handles(), threading.active_count()
    _listen()
    events: list[str] = []
    _local.events = events
    try:
        built = subject.build(**context)
    finally:
        _local.events = None
    require(not events, f"the constructor does I/O: {'; '.join(events[:3])}")
    require(_handles() <= handles, "the constructor leaves a file or device open")
    require(threading.active_count() <= threads, "the constructor leaves a thread running")
    del built  # kept until here: a handle dies with its owner


def _handles() -> int:
    folder = Path("/dev/fd")  # where there is none, as on Windows, nothing is counted
    return len(os.listdir(folder)) if folder.is_dir() else 0


#: Beginnings of the names of Python's audit events of files, sockets and processes.
_IO = (
    "open",
    "os.",
    "glob.",
    "shutil.",
    "tempfile.",
    "socket.",
    "subprocess.",
    "sqlite3.",
)
# a thread of its own, as other threads may open files meanwhile
_local = threading.local()


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    events: list[str] | None = getattr(_local, "events", None)
    if events is None or not event.startswith(_IO):
        return
    frame: FrameType | None = sys._getframe()
    while frame := frame.f_back if frame else None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return  # a lazy import may read files
    events.append(f"{event} {arguments[0]!r}" if arguments else event)


@cache
def _listen() -> None:
    sys.addaudithook(_hear)  # once, since Python cannot remove an audit hook


def module_imports_no_vendor_sdk(subject: CheckSubject) -> None:
    """Options can be listed and read without the vendor's software.

    At top level a sensor's package may import what the core's installation brings, and other
    packages of plugins, which are checked likewise; other kinds also what their own distribution
    requires.
    """
    if not subject.name:
        raise Skip("the class is not installed as a plugin")
    module = subject.plugin.__module__
    root = module.partition(".")[0]
    plugins = registry.list_plugins()
    allowed = _closure("tactileforge") | {_canonical(plugin.distribution) for plugin in plugins}
    if subject.kind != "sensors":
        for plugin in plugins:
            if (plugin.kind, plugin.name) == (subject.kind, subject.name):
                allowed = allowed | _closure(plugin.distribution)
    parts = module.split(".")
    seen: set[str] = set()
    imports = [_imports(".".join(parts[:i]), seen) for i in range(1, len(parts) + 1)]
    if not seen:
        raise Skip(f"no source of module {module!r} to read")
    owners = packages_distributions()
    for name in sorted(set().union(*imports) - sys.stdlib_module_names - {root, "tactileforge"}):
        fine = any(_canonical(owner) in allowed for owner in owners.get(name, ()))
        require(fine, f"{module} imports {name!r} at top level: import it where it is used")


def _imports(module: str, seen: set[str]) -> set[str]:
    """Packages imported at top level by a module and by the modules it imports of its package."""
    try:
        spec = None if module in seen else find_spec(module)
    except (ImportError, ValueError):
        spec = None
    if spec is None or not spec.origin or not spec.origin.endswith(".py"):
        return set()
    seen.add(module)
    root = module.partition(".")[0]
    names = set()
    tree = ast.parse(Path(spec.origin).read_text("utf-8"))
    for name in _top_level(tree.body, spec.parent or ""):
        top = name.partition(".")[0]
        names |= _imports(name, seen) if top == root else {top}
    return names


def _top_level(nodes: Iterable[ast.AST], package: str) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name("." * node.level + (node.module or ""), package)
            yield base
            # a name that is imported may be a module itself
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            # imports for type checking alone never run
            yield from _top_level(node.orelse, package)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from _top_level(ast.iter_child_nodes(node), package)


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()  # PEP 503


@cache
def _closure(distribution: str) -> frozenset[str]:
    """A distribution and all its requirements, extras left out."""
    seen: set[str] = set()
    todo = [distribution]
    while todo:
        name = _canonical(todo.pop())
        if name in seen:
            continue
        seen.add(name)
        try:
            lines = requires(name) or []
        except PackageNotFoundError:
            continue
        todo += [re.split(r"[^\w.-]", line)[0] for line in lines if "extra ==" not in line]
    return frozenset(seen)


CHECKS: list[Check] = [
    name_is_snake_case,
    it_has_what_its_kind_needs,
    parameters_are_explicit,
    option_names_are_free,
    defaults_are_plain_data,
    constructing_does_no_io,
    module_imports_no_vendor_sdk,
]
