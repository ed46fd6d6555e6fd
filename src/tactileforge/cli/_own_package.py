"""A package of a class of one's own: its file, entry points and a test (``plugins new from=``)."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import local, registry

#: Kinds of plugins that are one class, with the help of a head for objectives.
KINDS = ("sensor", "dataset", "encoder", "objective")

_PROJECT = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "{folder}"
version = "0.1.0"
description = "{title}, a plugin for tactileforge"
readme = "README.md"
requires-python = ">=3.11"
dependencies = [{needed}]

[project.optional-dependencies]
test = ["pytest>=8"]
{entries}
[tool.setuptools.packages.find]
where = ["src"]

[tool.pytest.ini_options]
testpaths = ["tests"]
addopts = ["--import-mode=importlib"]
"""

_README = """\
# {folder}

```bash
pip install -e '.[test]'
pytest
tactileforge plugins check {name}
```

{kind} `{name}`: `{title}` in `src/{package}/{kind_file}`. The entry points in
`pyproject.toml` make it known, and the test makes the same checks as `tactileforge plugins check`.
"""

_TEST = """\
import pytest

from tactileforge.testing import check


@pytest.mark.parametrize("kind", {kinds})
def test_conformance(kind):
    results = check(kind, "{name}")
    assert not [result for result in results if result.status == "failed"], results
"""


_PUBLISHING = """
## Publish it

{licence}

```bash
pip install build twine
python -m build
twine upload dist/*
```

`name` in `pyproject.toml` is what others type, `pip install {folder}`: it has to be free on the
index. A release has a `version` of its own, and can be uploaded once. `dependencies` say which
versions of tactileforge it was tested with: raise the upper end once its tests pass on the next.
"""
_NO_LICENCE = """\
It has no licence yet, and nobody else may use it without. Choose one, write it below
`requires-python` in `pyproject.toml` by its SPDX identifier, as `license = "MIT"`, and put its text
beside that file as `LICENSE`."""
_LICENCE = """\
Its licence is {licence}, by `pyproject.toml`: put the text of it beside that file as `LICENSE`."""


def publishing(folder: str, licence: str | None) -> str:
    """Section of a README on publishing.

    Args:
        folder: Name of the package.
        licence: SPDX identifier; None for none yet.
    """
    said = _LICENCE.format(licence=licence) if licence else _NO_LICENCE
    return _PUBLISHING.format(folder=folder, licence=said)


def package_of(kind: str, name: str, source: str) -> tuple[str, dict[str, str]]:
    """Files of a package with the class, its source unchanged.

    Args:
        kind: One of `KINDS`.
        name: Name of the plugin; "" for that of the class in snake_case.
        source: The class, ``my_module:Contrast`` or ``./file.py:Contrast``.

    Returns:
        The name, and the text of each file by its path.

    Raises:
        ConfigError: Another kind, a class without a file of its own, or a file that imports what
            lies beside it.
        PluginError: The class cannot be imported, or has another contract.
    """
    if kind not in KINDS:
        raise ConfigError(unknown("kind with from=", kind, KINDS))
    found = registry.adopt(f"{kind}s", source, "from")
    if not isinstance(found, type):
        raise ConfigError(f"from={source} is a {type(found).__name__}: give a class")
    name = name or local.key_of(source)
    classes = {f"{kind}s": found}
    if isinstance(head := getattr(found, "head", None), type):
        classes = {"heads": head, **classes}
    file = _file_of(source, *classes.values())
    text = file.read_text("utf-8")
    package, kind_file = f"tactileforge_{name}", f"{kind}.py"
    rows = [
        f'\n[project.entry-points."tactileforge.{group}"]\n'
        f'{name} = "{package}.{kind}:{cls.__qualname__}"\n'
        for group, cls in classes.items()
    ]
    needed = ["tactileforge>=0.1,<0.2", *sorted(_distributions(source, file, text))]
    words = {
        "folder": package.replace("_", "-"),
        "package": package,
        "name": name,
        "title": found.__name__,
        "kind": kind.capitalize(),
        "kind_file": kind_file,
        "needed": ", ".join(f'"{one}"' for one in needed),
        "entries": "".join(rows),
        "kinds": str([group.removesuffix("s") for group in classes]).replace("'", '"'),
    }
    return name, {
        "pyproject.toml": _PROJECT.format(**words),
        "README.md": _README.format(**words),
        f"src/{package}/__init__.py": f'"""{found.__name__}, a plugin for tactileforge."""\n',
        f"src/{package}/{kind_file}": text,
        f"tests/test_{kind}.py": _TEST.format(**words),
    }


def _file_of(source: str, *classes: type[Any]) -> Path:
    """The file with the classes.

    Raises:
        ConfigError: They have no file, or several.
    """
    files: dict[Path, type[Any]] = {}
    for cls in classes:
        try:
            files.setdefault(Path(inspect.getfile(cls)), cls)
        except (OSError, TypeError) as error:
            raise ConfigError(f"from={source}: {cls.__name__} has no file") from error
    if len(files) > 1:
        said = " and ".join(f"{cls.__name__} in {file.name}" for file, cls in files.items())
        raise ConfigError(f"from={source}: {said}: put both into one file")
    return next(iter(files))


def _distributions(source: str, file: Path, text: str) -> Iterator[str]:
    """Distributions of a file's imports, beside Python's own and ours.

    Raises:
        ConfigError: It imports a file that lies beside it, which the package would not have.
    """
    known = packages_distributions()
    tops: dict[str, int] = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.level:
            tops.setdefault("." * node.level + (node.module or ""), node.lineno)
        elif isinstance(node, ast.ImportFrom):
            tops.setdefault((node.module or "").partition(".")[0], node.lineno)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                tops.setdefault(alias.name.partition(".")[0], node.lineno)
    found = set()
    for top, line in tops.items():
        if top in sys.stdlib_module_names:
            continue
        if top.startswith(".") or PathFinder.find_spec(top, [str(file.parent)]):
            raise ConfigError(
                f"from={source}: line {line} of {file.name} imports {top}, which lies beside it: "
                "put what is needed into the one file"
            )
        found |= set(known.get(top, ()))
    yield from {one for one in found if not one.startswith("tactileforge")}
