"""Classes and functions of the user's own, by the name that is typed: ``my_module:Contrast``.

`resolve` imports, and is called for names that the user types alone: on the command line, in a YAML
of his own, in Python. A name in a file that was downloaded is looked up by `find`, which imports
nothing and knows what was typed or given in this process.
"""

from __future__ import annotations

import re
import shlex
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from tactileforge.errors import PluginError, home_path, nearest_name

_MODULE = r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*"
#: A name of the user's own: a module or a file, a colon, and a name in it.
_LOCAL = re.compile(rf"({_MODULE}|.*\.py):({_MODULE})", re.DOTALL)
#: What was meant as such a name, and has a slip in it.
_MEANT = re.compile(rf".*\.py(:.*)?|{_MODULE}:.*", re.DOTALL)

#: Modules of libraries that runs import anyway, and the base of their classes that a file may name.
_LIBRARIES = {"lightning.pytorch.callbacks": "Callback", "torch.optim": "Optimizer"}
#: Our own package, through which a class of the user's own is imported, built and called.
_OURS = Path(__file__).parents[1]
#: What was typed or given in this process, by its name.
_known: dict[str, Any] = {}
#: Modules that were read from files: what the file held, and the module.
_files: dict[Path, tuple[str, ModuleType]] = {}


def is_local(name: Any) -> bool:
    """Whether a value is the name of a user's own class or function, or was meant as one.

    Example:
        >>> [is_local(name) for name in ("my_module:Contrast", "./net.py:Tiny", "./net.py")]
        [True, True, True]
        >>> [is_local(name) for name in ("pixel", "hf://org/name", None)]
        [False, False, False]
    """
    return isinstance(name, str) and "://" not in name and bool(_MEANT.fullmatch(name))


def key_of(name: str) -> str:
    """Key of a local class in a configuration: the class in snake_case; other names as they are.

    Example:
        >>> key_of("my_module:ContrastLoss"), key_of("./net.py:CNNEncoder"), key_of("pixel")
        ('contrast_loss', 'cnn_encoder', 'pixel')
    """
    if not is_local(name):
        return name
    last = re.split(r"[:.]", name)[-1]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", last).lower()


def resolve(name: str, where: str = "") -> Any:
    """Imports what the user typed: ``module:NAME``, ``./file.py:NAME`` or ``path/to/file.py:NAME``.

    Modules are looked for in the working directory first. Never call it with a name that a
    downloaded file holds; see `find`.

    Args:
        name: Name as typed.
        where: Place of the name, for errors, such as ``encoder``; "" for none.

    Raises:
        PluginError: There is no such module, file or name in it, or it cannot be imported; one
            line with the place.
    """
    place = f"{where}={name}" if where else name
    known = _known.get(name)
    if known is not None and "<locals>" in getattr(known, "__qualname__", "<locals>"):
        return known  # a finished instance, or made in a function: no module has it
    match = _LOCAL.fullmatch(name)
    if not match:
        file = name.partition(".py")[0] + ".py" if ".py" in name else name.partition(":")[0]
        raise PluginError(f"{place}: name a class after a colon: {file}:MyClass")
    source, attribute = match.groups()
    module = _from_file(source, place) if source.endswith(".py") else _from_path(source, place)
    value: Any = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            own = [key for key, one in vars(value).items() if not _is_foreign(key, one, module)]
            known = f" Known: {', '.join(sorted(own)) or '(none)'}"
            near = nearest_name(part, own)
            raise PluginError(f"{place}: {source} has no {part!r}{near}{known}")
        value = getattr(value, part)
    _known[name] = value
    return value


def find(name: str) -> Any:
    """What was typed or given under a name in this process; imports nothing of others.

    Callbacks of Lightning and optimizers of torch, which are no more than their options, are found
    by their own names. A class that was given under another name serves too, if its own name is the
    same and no other class has it: the file may have moved since.

    Raises:
        KeyError: Nothing was.
    """
    if name in _known:
        return _known[name]
    if (found := of_library(name)) is not None:
        return found
    own = name.rpartition(":")[2]
    same = {id(value): value for key, value in _given() if key.rpartition(":")[2] == own}
    if len(same) != 1:
        raise KeyError(name)
    return next(iter(same.values()))


def of_library(name: str) -> Any:
    """A callback of Lightning or an optimizer of torch; None for another name."""
    source, _, own = name.partition(":")
    if source not in _LIBRARIES:
        return None
    module = import_module(source)
    found = vars(module).get(own)
    base = getattr(module, _LIBRARIES[source])
    return found if isinstance(found, type) and issubclass(found, base) else None


def names_in(node: Any) -> list[str]:
    """Names of the user's own classes and functions in a configuration, each once."""
    if not isinstance(node, Mapping):
        return []
    inner = [name for value in node.values() for name in names_in(value)]
    own = [node[key] for key in ("name", "schedule", "curve") if is_local(node.get(key))]
    return list(dict.fromkeys([*own, *inner]))


def check_given(config: Mapping[str, Any], what: str) -> None:
    """Checks the user's own names in a file's configuration: all have to be typed or given.

    Args:
        config: The configuration.
        what: The file or run, for the error.

    Raises:
        PluginError: Something was not; names all that is missing, as words to type.
    """
    named = names_in(config)
    missing = [name for name in named if not is_given(name)]
    if missing:
        said = f"{what} was made with {' and '.join(missing)},"
        raise not_given(said, [name for name in named if not of_library(name)])


def not_given(what: str, names: Sequence[str]) -> PluginError:
    """Error on names of somebody's own in a file, with the words to give them.

    Args:
        what: Begin of a sentence about them.
        names: The names.
    """
    word = shlex.join(code_words(names))
    classes = ", ".join(f"{name!r}: {name.rpartition(':')[2]}" for name in names)
    return PluginError(
        f"{what} of somebody's own, and what a file names is never imported: give it, {word} on "
        f"the command line if it is yours, or in Python classes={{{classes}}}"
    )


def code_words(names: Sequence[str]) -> list[str]:
    """The word of a command to give classes of one's own; none without a name.

    Example:
        >>> code_words(["mine:Net"]), code_words(["mine:Net", "./b.py:Loss"])
        (['code=mine:Net'], ['code=[mine:Net,./b.py:Loss]'])
    """
    if len(names) > 1:
        return [f"code=[{','.join(names)}]"]
    return [f"code={name}" for name in names]


def is_given(name: str) -> bool:
    """Whether `find` knows a name: it was typed or given in this process."""
    try:
        find(name)
    except KeyError:
        return False
    return True


def _given() -> Iterator[tuple[str, Any]]:
    return ((key, value) for key, value in _known.items() if ":" in key)


def given() -> list[Any]:
    """Typed or given classes and functions of the user's own, in this process."""
    return [value for _, value in _given()]


def keep(name: str, value: Any) -> None:
    """Makes a class or function known in this process by a name; see `find`."""
    _known[name] = value


def name_of(value: Any) -> str:
    """Name for a class, function or finished instance, known by it from now on.

    Example:
        >>> from tactileforge.errors import ConfigError
        >>> name_of(ConfigError)
        'tactileforge.errors:ConfigError'
    """
    kind = value if hasattr(value, "__qualname__") else type(value)
    name = f"{kind.__module__}:{kind.__qualname__.replace('<locals>.', '')}"
    for key, one in _known.items():  # a class typed as ./net.py:Tiny keeps that name
        if one is value:
            return key
    _known[name] = value
    return name


def _is_foreign(key: str, value: Any, module: ModuleType) -> bool:
    """Whether a name of a module is private, or was imported into it."""
    return key.startswith("_") or getattr(value, "__module__", "") != module.__name__


def _from_path(name: str, place: str) -> ModuleType:
    """Imports a module by its name, from the working directory first."""
    here = Path.cwd()
    top = name.partition(".")[0]
    beside = PathFinder.find_spec(top, [str(here)])
    loaded = sys.modules.get(top)
    if beside and beside.origin and loaded is not None:
        other = getattr(loaded, "__file__", None) or "Python itself"
        if other != beside.origin:
            raise PluginError(
                f"{place}: another module {top!r} is in use ({other}); rename yours, or give its "
                f"file: ./{Path(beside.origin).relative_to(here)}:NAME"
            )
    with _first(here):
        try:
            return import_module(name)
        except ModuleNotFoundError as error:
            if not error.name or not f"{name}.".startswith(f"{error.name}."):
                raise PluginError(f"{place}: {place_of(error)}") from error
            folder = here.joinpath(*name.split(".")[:-1])
            files = [item.stem for item in folder.glob("*.py")] if folder.is_dir() else []
            head = "".join(f"{part}." for part in name.split(".")[:-1])
            near = nearest_name(name, [f"{head}{stem}" for stem in sorted(files)])
            raise PluginError(
                f"{place}: there is no module {error.name!r} in {here} nor among the installed "
                f"ones{near}"
            ) from error
        except (Exception, SystemExit) as error:
            raise PluginError(f"{place}: {place_of(error)}") from error


def _from_file(source: str, place: str) -> ModuleType:
    """Runs a file as a module, once for each content."""
    path = home_path(source).absolute()
    if not path.is_file():
        files = [item.name for item in path.parent.glob("*.py")] if path.parent.is_dir() else []
        near = nearest_name(path.name, files)
        raise PluginError(f"{place}: there is no file {source} in {Path.cwd()}{near}")
    path = path.resolve()
    content = path.read_bytes()
    held = sha256(content).hexdigest()
    if path in _files and _files[path][0] == held:
        return _files[path][1]
    name = _free_name(path)
    if name in sys.modules and path not in _files:  # imported by its name before
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    assert spec is not None  # of a .py file
    assert spec.loader is not None
    module = module_from_spec(spec)
    before = sys.modules.get(name)
    sys.modules[name] = module  # dataclasses and pickles look it up there
    with _first(path.parent):
        try:
            # compiled here: to the cache of Python a file of the same second and size is the same
            exec(compile(content, str(path), "exec"), module.__dict__)
        except (Exception, SystemExit) as error:
            del sys.modules[name]
            if before is not None:
                sys.modules[name] = before
            raise PluginError(f"{place}: {place_of(error)}") from error
    _files[path] = (held, module)
    return module


def _free_name(path: Path) -> str:
    """Name of the module of a file: its own, unless another module has it."""
    if path in _files:
        return _files[path][1].__name__
    stem = path.stem
    loaded = getattr(sys.modules.get(stem), "__file__", None)
    if stem in sys.modules and loaded and Path(loaded).resolve() == path:
        return stem
    taken = stem in sys.modules or PathFinder.find_spec(stem) is not None
    if stem.isidentifier() and not (taken and _origin(stem) != path):
        return stem
    return f"{re.sub(r'[^0-9A-Za-z_]', '_', stem)}_{sha256(str(path).encode()).hexdigest()[:8]}"


def _origin(name: str) -> Path | None:
    spec = None if name in sys.modules else PathFinder.find_spec(name)
    return Path(spec.origin).resolve() if spec and spec.origin else None


@contextmanager
def _first(folder: Path) -> Iterator[None]:
    """Looks for modules in a folder first, and after the context last.

    First, as for ``python script.py``; then last, so that it hides no module that is imported
    later. It stays, because processes that read data import by name what they are sent.
    """
    here = str(folder)
    was = here in sys.path
    sys.path.insert(0, here)
    try:
        yield
    finally:
        sys.path.remove(here)
        if not was:
            sys.path.append(here)


def place_of(error: BaseException) -> str:
    """An error with the innermost line of the user's own code: ``net.py:12: ValueError: ...``.

    Args:
        error: What was raised in it, or below it.
    """
    said = f"{type(error).__name__}: {error}"
    if isinstance(error, SyntaxError) and error.filename:
        return f"{Path(error.filename).name}:{error.lineno}: {type(error).__name__}: {error.msg}"
    mine = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and _OURS not in Path(frame.filename).parents
    ]
    # what the user wrote comes before what it calls in libraries
    own = [one for one in mine if not re.search(r"[/\\\\]lib[/\\\\]python3", one.filename)] or mine
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}: {said}" if own else said
