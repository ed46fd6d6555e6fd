"""Classes of the user's own, without a package: ``my_module:Contrast`` and ``./net.py:Tiny``.

What the user types, or registers in Python, is imported. A name that a file has, such as a
configuration or the header of weights, is not: it is only looked up among those typed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from inspect import getdoc
from pathlib import Path
from types import ModuleType
from typing import Any

from tactileforge.errors import PluginError, unknown

#: ``module:Name``, ``package.module:Name`` or ``path/to/file.py:Name``; a name may be nested.
_LOCAL = re.compile(r"(?P<module>[^:\s]+):(?P<name>[A-Za-z_][\w.]*)")
#: Names, and modules or files, that were typed in this process.
_TYPED: set[str] = set()
#: Objects registered in Python: kind and name to the object.
_REGISTERED: dict[tuple[str, str], Any] = {}
#: Modules made of files, by their path: a file is run once.
_FILES: dict[Path, ModuleType] = {}


def is_local(name: str) -> bool:
    """Whether a name has the form of a local class.

    Example:
        >>> is_local("my_module:Contrast"), is_local("./net.py:Tiny"), is_local("pixel")
        (True, True, False)
    """
    return bool(_LOCAL.fullmatch(name))


def as_local(target: str) -> str:
    """``package.module.Name`` of Hydra's ``_target_`` as a local name.

    Example:
        >>> as_local("my_package.losses.Contrast")
        'my_package.losses:Contrast'
    """
    module, _, name = target.rpartition(".")
    return target if is_local(target) or not module else f"{module}:{name}"


def allow(name: str) -> str:
    """Marks a typed name, module or file as the user's own, so that it may be imported.

    Args:
        name: Local name, or the part before the colon for all names of a module or file.

    Returns:
        The name.
    """
    _TYPED.add(name)
    return name


def allow_typed(words: Sequence[str]) -> list[str]:
    """Marks all local names on a command line as typed; the words without those of ``code=``.

    ``code=./net.py`` and ``code=[my_module,./net.py:Tiny]`` say that names in a file, such as the
    configuration of a run to resume, are the user's own.
    """
    kept = []
    for word in words:
        key, _, value = word.removeprefix("--").partition("=")
        if key == "code":
            _TYPED.update(one.strip(" '\"") for one in value.strip(" []'\"").split(",") if one)
        else:
            kept.append(word)
            _TYPED.update(re.findall(r"[^\s\[\]{},='\"]+:[A-Za-z_][\w.]*", word))
    return kept


def is_allowed(name: str) -> bool:
    """Whether a local name, or its module or file, was typed."""
    return name in _TYPED or name.rpartition(":")[0] in _TYPED


def register(kind: str, name: str, plugin: Any) -> None:
    """Makes a class a plugin of this process, by a name.

    Args:
        kind: Kind of plugin, as in ``objectives``.
        name: Name to type, as that of an installed plugin; or a local name in a file of weights.
        plugin: The class.

    Raises:
        PluginError: The name is no word, or is taken by another class.
    """
    if not (re.fullmatch(r"[a-z_]\w*", name) or is_local(name)):
        raise PluginError(f"register({kind!r}, {name!r}): give a name in snake_case")
    if _REGISTERED.setdefault((kind, name), plugin) is not plugin:
        raise PluginError(f"{kind}: {name!r} is registered already, with another class")


def registered(kind: str) -> dict[str, Any]:
    """Objects registered for a kind, by name."""
    return {name: one for (of, name), one in _REGISTERED.items() if of == kind}


def key_of(name: str) -> str:
    """Key of a local class in a configuration: its name in snake_case.

    Example:
        >>> key_of("./losses.py:MyContrast")
        'my_contrast'
    """
    last = name.rpartition(":")[2].rpartition(".")[2]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", last).lower()


def resolve(name: str, what: str = "a plugin") -> Any:
    """Imports a typed local name.

    Args:
        name: Local name; relative files are below the current folder.
        what: What it is for, as in "the objective"; for errors.

    Raises:
        PluginError: It was not typed, or there is no such module, file or name, or its import
            fails; states the place and the fix.
    """
    match = _LOCAL.fullmatch(name)
    if not match:
        raise PluginError(f"{what} {name!r}: give module:Class, or ./file.py:Class")
    if not is_allowed(name):
        raise PluginError(
            f"{what} {name!r} is a class without a package, named by a file, and files import "
            f"nothing. If it is yours, add code={match['module']} on the command line, or call "
            f"tactileforge.allow({match['module']!r}) in Python"
        )
    module, found = _module(match["module"], name, what), None
    for part in match["name"].split("."):
        holder = module if found is None else found
        found = getattr(holder, part, None)
        if found is None:
            names = [one for one in vars(holder) if not one.startswith("_")]
            raise PluginError(unknown(f"name in {match['module']}", part, names))
    return found


def _module(place: str, name: str, what: str) -> ModuleType:
    is_file = place.endswith(".py") or "/" in place or "\\" in place
    try:
        return _of_file(Path(place).expanduser()) if is_file else _of_name(place)
    except FileNotFoundError as error:
        raise PluginError(f"{what} {name!r}: no such file: {error}") from error
    except ModuleNotFoundError as error:
        top = place.partition(".")[0]
        if (error.name or "").partition(".")[0] not in (top, place):
            raise PluginError(f"{what} {name!r} cannot be imported: {_last(error)}") from error
        hint = f"; for a file give ./{place}.py:..." if "." not in place else ""
        raise PluginError(
            f"{what} {name!r}: no module {place!r} here ({Path.cwd()}) or on Python's path{hint}"
        ) from error
    except (Exception, SystemExit) as error:
        raise PluginError(f"{what} {name!r} cannot be imported: {_last(error)}") from error


def _of_name(place: str) -> ModuleType:
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:  # a console script has no current folder
        sys.path.append(here)
    return import_module(place)


def _of_file(path: Path) -> ModuleType:
    path = path.resolve()
    if path in _FILES:
        return _FILES[path]
    if not path.is_file():
        raise FileNotFoundError(str(path))
    # by its own name where that is free, so that processes can find its classes again
    name = path.stem if path.stem not in sys.modules else f"{path.stem}_{abs(hash(path)):x}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(str(path))
    module = module_from_spec(spec)
    sys.modules[name] = module
    beside = str(path.parent)
    if beside not in sys.path:  # a file may import those beside it
        sys.path.append(beside)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    _FILES[path] = module
    return module


def _last(error: BaseException) -> str:
    """Error with its innermost place outside of the import system."""
    step, place = error.__traceback__, ""
    while step is not None:
        file = step.tb_frame.f_code.co_filename
        if not file.startswith("<frozen") and "tactileforge/plugins/local" not in file:
            place = f"{file}:{step.tb_lineno}: "
        step = step.tb_next
    if isinstance(error, SyntaxError) and error.filename:
        place = f"{error.filename}:{error.lineno}: "
    return f"{place}{type(error).__name__}: {error}"


def summary(plugin: Any) -> str:
    """First line of the docstring of a local class."""
    return (getdoc(plugin) or "").partition("\n")[0]
