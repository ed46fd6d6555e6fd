"""Imports of authors of plugins stay in one place, and older packages are told of moves."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import tactileforge
from tactileforge import plugin
from tactileforge.errors import PluginError
from tactileforge.objectives.force import Force
from tactileforge.plugins import moves, registry
from tactileforge.testing import check

ROOT = Path(__file__).parents[1]
PUBLIC = {"tactileforge", "tactileforge.plugin", "tactileforge.testing"}


def test_every_name_of_the_door_is_there():
    assert moves.public_names() == set(plugin.__all__)
    assert sorted(plugin.__all__) == sorted(set(plugin.__all__))
    for name in plugin.__all__:
        assert getattr(plugin, name) is not None


def test_the_door_costs_no_torch():
    code = (
        "import sys, tactileforge.plugin; sys.exit(bool({'torch', 'lightning'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def _imported(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactileforge"):
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (item.name for item in node.names if item.name.startswith("tactileforge"))


@pytest.mark.parametrize("page", sorted((ROOT / "docs/plugins").glob("*.md")), ids=lambda p: p.stem)
def test_the_docs_for_authors_import_from_the_door_alone(page):
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
    used = {module for block in blocks for module in _imported(block)}
    assert used <= PUBLIC


def _table(path):
    """Section of a package's README on private imports; "" for none."""
    package = path.relative_to(ROOT / "plugins").parts[0]
    readme = (ROOT / "plugins" / package / "README.md").read_text()
    return readme.partition("## What it imports beside `tactileforge.plugin`\n")[2]


@pytest.mark.parametrize(
    "path",
    sorted(
        path for path in (ROOT / "plugins").glob("tactileforge-*/src/**/*.py") if not _table(path)
    ),
    ids=lambda p: f"{p.parent.name}/{p.stem}",
)
def test_our_packages_import_what_a_third_party_could(path):
    used = {name for name in _imported(path.read_text()) if not name.startswith("tactileforge_")}
    assert used <= PUBLIC | _excused(path)


def _excused(path):
    """Private modules listed by the README of a package, with a reason each."""
    readme = ROOT / "plugins" / path.relative_to(ROOT / "plugins").parts[0] / "README.md"
    section = readme.read_text().partition("## Private imports\n")[2].partition("\n## ")[0]
    return set(re.findall(r"^\| `(tactileforge\.[\w.]+)` \| \w", section, re.M))


@pytest.mark.parametrize(
    "package",
    sorted(
        path.name
        for path in (ROOT / "plugins").glob("tactileforge-*")
        if _table(path / "README.md")
    ),
)
def test_a_readme_names_what_is_imported_beside_the_door(package):
    folder = ROOT / "plugins" / package
    rows = re.findall(r"^\| (`.*?) \|", _table(folder / "README.md"), re.M)
    named = {f"tactileforge.{name}" for row in rows for name in re.findall(r"`(.*?)`", row)}
    used = set()
    for path in (folder / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == "tactileforge":
                names = {name.name for name in node.names} - set(tactileforge.__all__)
                used |= {f"tactileforge.{name}" for name in names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                used.add(node.module)
    private = {name for name in used if name.startswith("tactileforge.")} - PUBLIC
    unnamed = {name for name in private if not any(_within(name, one) for one in named)}
    idle = {one for one in named if not any(_within(name, one) for name in private)}
    assert (unnamed, idle) == (set(), set())


def _within(name, package):
    return name == package or name.startswith(f"{package}.")


@pytest.mark.parametrize("package", ["arrays"])
def test_what_a_readme_excuses_is_used(package):
    files = [*(ROOT / f"plugins/tactileforge-{package}/src").rglob("*.py")]
    text = "\n".join(file.read_text() for file in files)
    names = {name.rpartition(".")[2] for name in _excused(files[0])}
    assert names
    assert not [
        name for name in names if f"{name} import" not in text and f"import {name}" not in text
    ]


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("from tactileforge.sensors.camera import Camera", "import Camera"),
        (
            "from tactileforge.data.frames import VideoFrames, ImageFrames",
            "ImageFrames, VideoFrames",
        ),
        ("import tactileforge.sensors.replay", "import Replay"),
        (
            "from tactileforge.live.local_page import LocalPage",
            "use: from tactileforge.plugin import LocalPage",
        ),
        ("from tactileforge.plugin import SerialArray", "use: from tactileforge_arrays import"),
        (
            "import tactileforge.bench.fit",
            "use: tactileforge_bench (pip install tactileforge-bench)",
        ),
        ("import tactileforge.datasets.octopi", "tactileforge-datasets now: pip install"),
        ("from tactileforge.no_such import thing", "the module is private"),
    ],
)
def test_an_import_that_moved_is_told_where(line, hint, installed):
    installed("older", "[tactileforge.datasets]\nolder = older_data:Older", {"older_data.py": line})
    with pytest.raises(PluginError, match=r"'older' \(older_data:Older, from older 1.0\)") as error:
        registry.get("datasets", "older")
    assert hint in str(error.value)
    told = ("use: ", "tactileforge.plugin", "pip install tactileforge-")
    assert any(words in str(error.value) for words in told)


def test_a_module_of_others_that_is_missing_is_left_to_its_own_words(installed):
    installed("sdk", "[tactileforge.sensors]\nsdk = sdk_x:X", {"sdk_x.py": "import no_such_sdk"})
    with pytest.raises(PluginError) as error:
        registry.get("sensors", "sdk")
    assert "tactileforge.plugin" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("tactileforge_sim", "pip install tactileforge-sim"),
        ("tactileforge_my_sensor.drver", ""),  # a slip inside a package of somebody's own
        ("tactileforge_my_sensor", ""),
        ("tactileforge.sim.optics.lighting", "use: tactileforge_depth.lighting"),
        ("tactileforge.sim.scene", "use: tactileforge_sim (pip install tactileforge-sim)"),
    ],
)
def test_what_is_missing_is_named_if_it_is_ours(name, hint):
    assert moves.import_hint(ModuleNotFoundError(f"No module named {name!r}", name=name)) == hint


OLDER = """
from torch import nn
class Older(nn.Module):
    head = "force"
    needs = frozenset({"force"})
    def forward(self, prediction, batch):
        valid = batch["force_valid"]  # it was (B,)
        return (prediction.mean((1, 2)) * valid).sum() / valid.sum(), {}
"""


@pytest.fixture
def older(installed):
    installed("older", "[tactileforge.objectives]\nolder = old:Older", {"old.py": OLDER})
    return registry.get("objectives", "older")


def test_a_field_that_changed_is_named_at_the_check(older):
    failed = [result.detail for result in check("objective", older) if result.status == "failed"]
    assert failed
    assert all("force_valid of a batch is (B, 3) since contract 2" in text for text in failed)


def test_a_field_that_changed_is_named_at_use(older):
    batch = {"force_valid": torch.ones(4, 3)}
    said = pytest.raises(PluginError, match=r"old\.Older: RuntimeError: .*\[:, 2\]")
    with said, moves.explained(older()):
        older()(torch.zeros(4, 2, 3), batch)


def test_a_fault_of_ours_keeps_its_traceback():
    with pytest.raises(RuntimeError, match="ours"), moves.explained(Force()):
        raise RuntimeError("ours")


def test_every_public_name_is_in_the_reference() -> None:
    page = (ROOT / "docs" / "reference.md").read_text()
    shown = {line.rpartition(".")[2] for line in page.splitlines() if line.startswith("::: ")}
    assert set(plugin.__all__) <= shown
    assert set(tactileforge.__all__) - {"__version__"} <= shown
