"""The map in docs/design.md has every package, with its actual imports."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from tactileforge_sim.dataset import Sim

from tactileforge.packing import PackOptions, pack

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


#: Modules beside the packages of the core; a newcomer sees them first.
LOOSE = {"__init__.py", "__main__.py", "api.py", "errors.py", "plugin.py", "verbs.py"}


def test_few_modules_stand_beside_the_packages() -> None:
    assert {path.name for path in (SOURCE / "tactileforge").glob("*.py")} == LOOSE


#: The core and our packages, each a folder of rooms.
HOUSES = [
    init.parent
    for init in (
        SOURCE / "tactileforge/__init__.py",
        *(ROOT / "plugins").glob("*/src/*/__init__.py"),
    )
]


@pytest.mark.parametrize("folder", HOUSES, ids=lambda path: path.name)
def test_rooms_make_no_circle_not_even_by_types(folder: Path) -> None:
    found: dict[str, set[str]] = {}
    for path in folder.rglob("*.py"):
        here = path.relative_to(folder).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text())):
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            if isinstance(node, ast.ImportFrom) and module.partition(".")[0] == folder.name:
                names = [f"{module}.{name.name}".split(".")[1] for name in node.names]
                found.setdefault(here, set()).update(name for name in names if name != here)
    assert folder.name != "tactileforge" or "training" in found["api"]
    TopologicalSorter(found).prepare()  # raises a CycleError


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
    "tactileforge_depth",
    "tactileforge_published",
    "tactileforge_export",
    "tactileforge_inspect",
    "tactileforge_live",
    "tactileforge_sim",
    "tactileforge_bench",
    "tactileforge_episodes",
    "tactileforge_labels",
    "tactileforge_lerobot",
    "tactileforge_markers",
    "tactileforge_policies",
    "tactileforge_rosbags",
    "zarr",
]


@pytest.mark.parametrize("name", ABSENT)
def test_the_core_does_not_import(name: str) -> None:
    assert {"numpy", "av", "torch"} <= imported()  # what is imported is found
    assert name not in imported()


#: Rooms that training on shards walks past.
CLOSED = {"packing", "testing"}
_WALK = """
import sys
from tactileforge import cli
assert cli.run(sys.argv[1:]) == 0
assert "tactileforge_sim" not in sys.modules
loaded = [sys.modules[name].__file__ for name in sys.modules if name.startswith("tactileforge.")]
print(*(file for file in loaded if file and file.endswith(".py")), sep="\\n")
"""


@pytest.mark.slow
def test_training_on_shards_reads_three_fifths_of_the_core(tmp_path: Path) -> None:
    """As the page says of a training: the rooms of other products stay closed."""
    pack(Sim(scenes=3, val=1, size=32), "sim", tmp_path / "packed", PackOptions(processes=1))
    words = ["train", "scale=demo", "debug=steps", "objective=[pixel]", "encoder.image_size=32"]
    words += [
        "data=shards",
        f"data.root={tmp_path / 'packed'}",
        f"hydra.run.dir={tmp_path / 'run'}",
    ]
    done = subprocess.run(
        [sys.executable, "-c", _WALK, *words], capture_output=True, text=True, check=True
    )
    core = SOURCE / "tactileforge"
    files = {Path(line) for line in done.stdout.splitlines() if line.startswith(str(core))}
    read = sum(len(path.read_text().splitlines()) for path in files)
    whole = sum(len(path.read_text().splitlines()) for path in core.rglob("*.py"))
    rooms = {path.relative_to(core).parts[0] for path in files}
    assert "api.py" in rooms
    assert not rooms & CLOSED
    assert read < 0.6 * whole


def test_the_parts_of_the_command_line_are_counted():
    """The table of docs/design.md has every part, with its lines to a tenth."""
    text = (ROOT / "docs/design.md").read_text("utf-8").split("part by part\n")[1].split("\n\n")[1]
    counted = {}
    for line in text.splitlines()[2:]:
        _, parts, lines, *_ = line.split("|")
        counted[frozenset(re.findall(r"`(\w+)`", parts))] = int(lines)
    folder = ROOT / "src/tactileforge/cli"
    found = {path.stem for path in folder.glob("_[a-z]*.py")}
    assert set().union(*counted) == found
    for parts, lines in counted.items():
        now = sum(len((folder / f"{part}.py").read_text("utf-8").splitlines()) for part in parts)
        assert now == pytest.approx(lines, rel=0.1), parts
