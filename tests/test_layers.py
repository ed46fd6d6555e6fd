"""The map in docs/design.md has every package, with its actual imports."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
ROW = re.compile(r"^\| `([a-z_.]+)` \|.*\| ((?:`[a-z_.]+` ?)*)\|$", re.M)


@cache
def page() -> dict[str, frozenset[str]]:
    """Imports of each package allowed by the page, in its order."""
    text = (
        (ROOT / "docs" / "design.md").read_text().split("## Map")[1].split("Beside the package")[0]
    )
    return {name: frozenset(re.findall(r"`(.*?)`", cell)) for name, cell in ROW.findall(text)}


def package(module: str) -> str:
    """The package a module lies in, without ``tactileforge.``; modules beside them stand alone."""
    path = SOURCE.joinpath(*module.split("."))
    if not path.is_dir():
        parent = module.rpartition(".")[0]
        if not path.with_suffix(".py").is_file() or parent != "tactileforge":
            return package(parent)
    return module.removeprefix("tactileforge").removeprefix(".")


def imports(node: ast.AST) -> Iterator[str]:
    """Modules and names imported by a file, but for type checking alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ImportFrom) and child.module:
            yield from (f"{child.module}.{name.name}" for name in child.names)
        elif isinstance(child, ast.Import):
            yield from (name.name for name in child.names)
        elif isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        yield from imports(child)


@cache
def code() -> dict[str, frozenset[str]]:
    """Imports of each package."""
    found: dict[str, set[str]] = {}
    for path in (SOURCE / "tactileforge").rglob("*.py"):
        module = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        here = package(module.removesuffix(".__init__"))
        names = [
            name
            for name in imports(ast.parse(path.read_text()))
            if name.startswith("tactileforge.")
        ]
        found.setdefault(here, set()).update(package(name) for name in names)
    return {here: frozenset(names - {here, ""}) for here, names in found.items() if here}


@pytest.mark.slow
def test_every_package_is_on_the_map() -> None:
    assert set(page()) == set(code())


@pytest.mark.parametrize("name", page())
def test_a_package_imports_what_the_map_says(name: str) -> None:
    assert code()[name] == page()[name]


def test_the_map_goes_from_the_ground_up() -> None:
    """So there is no circle between packages."""
    places = list(page())
    for name, names in page().items():
        assert all(places.index(other) < places.index(name) for other in names), name


@cache
def imported() -> frozenset[str]:
    """Top-level packages imported anywhere in the files of the core."""
    found = set()
    for path in (SOURCE / "tactileforge").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module)
            elif isinstance(node, ast.Import):
                found |= {name.name for name in node.names}
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
                found |= {text for text in map(_text, node.args) if text}
    return frozenset(name.partition(".")[0] for name in found)


def _text(node: ast.expr) -> str:
    """A text, or how one with values in it begins."""
    first = node.values[0] if isinstance(node, ast.JoinedStr) and node.values else node
    return str(first.value) if isinstance(first, ast.Constant) else ""


#: Packages that belong to a package of plugins/: the core imports none of them, at any depth.
ABSENT = [
    "diffusers",
    "gymnasium",
    "h5py",
    "pyarrow",
    "rosbags",
    "tactileforge_arrays",
    "tactileforge_datasets",
    "tactileforge_episodes",
    "tactileforge_labels",
    "tactileforge_lerobot",
    "tactileforge_policies",
    "tactileforge_rosbags",
    "zarr",
]


@pytest.mark.parametrize("name", ABSENT)
def test_the_core_does_not_import(name: str) -> None:
    assert {"numpy", "av", "torch"} <= imported()  # what is imported is found
    assert name not in imported()
