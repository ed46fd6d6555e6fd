"""Changes of the contract with plugins, for packages built for an older one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dis import get_instructions
from functools import cache
from importlib.resources import files
from inspect import getsource
from types import CodeType
from typing import Any

from tactileforge import errors
from tactileforge.errors import PluginError, TactileForgeError
from tactileforge.plugins.distributions import how_to_get, install_command, is_ours

#: Changes so far that authors of plugins have to follow; public packages are the contract.
VERSION = 4

#: Names with a new meaning in the same place: the name in older packages, and the fix.
CHANGES = {
    "force_valid": "force_valid of a batch is (B, 3) since contract 2, a value for each axis: "
    'batch["force_valid"][:, 2] says whether normal force is known',
}


#: Names that were public here and are now in a package: the new import, and what to install.
PACKAGES = {"SerialArray": "from tactileforge_arrays import SerialArray"}


#: Rooms of the core that are now packages, by their former module.
MODULES = {
    "tactileforge.bench": "tactileforge_bench",
    "tactileforge.datasets.samples": "tactileforge_datasets.samples",
    "tactileforge.encoders.published": "tactileforge_published",
    "tactileforge.encoders.resnet": "tactileforge_published.resnet",
    "tactileforge.encoders.vqgan": "tactileforge_published.vqgan",
    "tactileforge.heads.published": "tactileforge_published.heads",
    "tactileforge.export": "tactileforge_export",
    "tactileforge.inspection": "tactileforge_inspect",
    "tactileforge.live": "tactileforge_live",
    "tactileforge.record": "tactileforge_live.record",
    "tactileforge.sim": "tactileforge_sim",
    "tactileforge.depth": "tactileforge_depth",
    "tactileforge.markers": "tactileforge_markers",
}


@cache
def homes() -> dict[str, str]:
    """Public package of each public name, read from stubs: an import here would be circular."""
    found: dict[str, str] = {}
    for package in sorted(files("tactileforge").iterdir(), key=lambda item: item.name):
        stub = package / "__init__.pyi"
        text = stub.read_text("utf-8") if package.is_dir() and stub.is_file() else ""
        for name in re.findall(r"^from .* import \w+ as (\w+)$", text, re.M):
            found.setdefault(name, f"tactileforge.{package.name}")
    from tactileforge import contracts  # imports numpy

    found |= dict.fromkeys(contracts.__all__, "tactileforge.contracts")
    public = [
        name
        for name in vars(errors)
        if getattr(vars(errors)[name], "__module__", "") == errors.__name__
    ]
    return found | dict.fromkeys(public, "tactileforge.errors")


def home_of(name: str) -> str:
    """Public package with a name; "" for none.

    Example:
        >>> home_of("Frame"), home_of("Camera"), home_of("no_such_name")
        ('tactileforge.contracts', 'tactileforge.sensors', '')
    """
    return homes().get(name, "")


def import_hint(error: BaseException) -> str:
    """Hint after a failed import: a new place, a package of ours, a cut file; "" for none.

    Args:
        error: Error raised by the import of a plugin.

    Example:
        >>> import_hint(ModuleNotFoundError("No module named 'x'", name="x"))
        ''
    """
    if isinstance(error, ModuleNotFoundError) and is_ours(top := str(error.name).replace("_", "-")):
        return install_command(top)
    if isinstance(error, EOFError) and "marshal" in str(error):
        return "a file in a __pycache__ folder was cut, as by a full disk: delete those folders"
    if not isinstance(error, ImportError) or not (error.name or "").startswith("tactileforge."):
        return ""
    wanted = _wanted(error)
    if moved := [said for name, said in PACKAGES.items() if name in wanted]:
        return f"use: {moved[0]}"
    found = sorted(homes().keys() & set(wanted))
    for old in sorted(MODULES, key=len, reverse=True) if not found else ():  # a public name first
        if f"{error.name}.".startswith(f"{old}."):
            package = MODULES[old].partition(".")[0].replace("_", "-")
            install = "" if package == "tactileforge" else f" ({install_command(package)})"
            return f"use: {MODULES[old]}{install}"
    last = (error.name or "").rpartition(".")[2]
    if f".datasets.{last}" in str(error.name) and (fix := how_to_get("datasets", last)):
        return f"it {fix}"
    last = last.replace("_", "")
    found = found or [name for name in homes() if name.lower() == last]
    if not found:
        return "the module is private: public packages and their names are in docs/reference.md"
    by_package: dict[str, list[str]] = {}
    for name in found:
        by_package.setdefault(home_of(name), []).append(name)
    lines = (f"from {package} import {', '.join(by_package[package])}" for package in by_package)
    return f"use: {'; '.join(lines)}"


def _wanted(error: BaseException) -> tuple[str, ...]:
    """Names in the failed ``from ... import`` statement, from its bytecode."""
    step = error.__traceback__
    names: tuple[str, ...] = ()
    while step is not None:
        code = step.tb_frame.f_code
        if not code.co_filename.startswith("<frozen"):
            names = _imported(code, step.tb_lasti)
        step = step.tb_next
    return names


def _imported(code: CodeType, place: int) -> tuple[str, ...]:
    """Names of the import at an offset of a code object; () for any other statement."""
    done = [one for one in get_instructions(code) if one.offset <= place]
    done = [one for one in done if one.opname != "EXTENDED_ARG"]
    while done and done[-1].opname in ("IMPORT_FROM", "STORE_NAME", "STORE_FAST", "STORE_GLOBAL"):
        done.pop()
    if len(done) < 2 or done[-1].opname != "IMPORT_NAME":
        return ()
    names = done[-2].argval
    return names if isinstance(names, tuple) else ()


def change_hints(plugin: Any) -> list[str]:
    """Changes of meaning relevant to a plugin of another package, by the names in its source.

    Args:
        plugin: Instance or class of the plugin.

    Returns:
        One sentence for each change; [] for the plugins of tactileforge itself.
    """
    cls = plugin if isinstance(plugin, type) else type(plugin)
    if cls.__module__.partition(".")[0] == "tactileforge":
        return []
    try:
        source = getsource(cls)
    except (OSError, TypeError):
        return []
    return [said for name, said in CHANGES.items() if re.search(rf"\b{name}\b", source)]


@contextmanager
def explained(*plugins: Any) -> Iterator[None]:
    """Adds changes of the contract to the errors of plugins from other packages.

    Args:
        plugins: Plugins that run inside the context.

    Raises:
        PluginError: A plugin failed, and its source has a name whose meaning changed; states the
            fix.
    """
    try:
        yield
    except TactileForgeError:
        raise
    except Exception as error:
        hints = {hint: type(plugin) for plugin in plugins for hint in change_hints(plugin)}
        if not hints:
            raise
        cls = next(iter(hints.values()))
        raise PluginError(
            f"{cls.__module__}.{cls.__qualname__}: {type(error).__name__}: {error}. Its package "
            f"was made for an older contract: {'; '.join(hints)}"
        ) from error
