"""Public packages: their names, who uses them, and hints for packages made before a move."""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from textwrap import dedent

import pytest
import torch

import tactileforge
from tactileforge import plugin
from tactileforge.errors import PluginError
from tactileforge.objectives.force import Force
from tactileforge.plugins import moves, registry
from tactileforge.testing import check

ROOT = Path(__file__).parents[1]
#: Packages with names for everyone; below them, and in `tactileforge.util`, all is private.
PUBLIC = sorted(
    {path.parent.name for path in (ROOT / "src/tactileforge").glob("*/__init__.pyi")}
    | {"contracts", "testing"}
)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_there(name):
    package = import_module(f"tactileforge.{name}")
    assert package.__all__
    for one in package.__all__:
        assert getattr(package, one) is not None


@pytest.mark.parametrize("name", PUBLIC)
def test_no_public_name_hides_a_module(name):
    """`from tactileforge.X import NAME` is one thing, whatever was imported before."""
    folder = ROOT / "src/tactileforge" / name
    modules = {path.stem for path in folder.iterdir() if path.suffix == ".py" or path.is_dir()}
    stub = folder / "__init__.pyi"
    lines = re.findall(
        r"^from (\S+) import (\w+) as \w+$", stub.read_text() if stub.exists() else "", re.M
    )
    assert not [one for home, one in lines if one in modules and home != f"tactileforge.{name}"]


def test_public_packages_cost_no_torch():
    imports = ", ".join(f"tactileforge.{name}" for name in PUBLIC if name != "testing")
    code = f"import sys, {imports}; sys.exit(bool({{'torch', 'lightning'}} & {{*sys.modules}}))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_sensors_of_packages_cost_no_torch():
    code = (
        "import sys; from tactileforge.sensors import Camera, StreamSensor; "
        "from tactileforge.data import ArrayFrames; "
        "sys.exit(bool({'torch', 'lightning'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_an_unknown_name_of_a_package_is_an_error():
    with pytest.raises(ImportError, match="no_such_name"):
        exec("from tactileforge.data import no_such_name")


def test_the_former_home_hands_on_every_name():
    for name in ("Frame", "Camera", "Clips", "locked", "ConfigError", "EMA"):
        assert getattr(plugin, name) is getattr(import_module(moves.home_of(name)), name)
    with pytest.raises(AttributeError, match="no_such_name"):
        plugin.no_such_name  # noqa: B018


def _imports(text):
    """Imports of tactileforge by a text: module and name, "" for a whole module."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "tactileforge":
            yield from ((node.module, item.name) for item in node.names)
        elif isinstance(node, ast.Import):
            for item in node.names:
                if item.name.split(".")[0] == "tactileforge":
                    yield item.name, ""


def _private(text):
    """Imports that are not of a public name."""
    for module, name in _imports(text):
        package = module.removeprefix("tactileforge").removeprefix(".")
        if module == "tactileforge" and name in {*tactileforge.__all__, "errors", *PUBLIC, ""}:
            continue
        if package == "errors" or package.startswith("testing"):
            continue
        if package not in PUBLIC or name not in {*import_module(module).__all__, ""}:
            yield f"{module}.{name}"


PACKAGE_FILES = sorted((ROOT / "plugins").glob("*/src/**/*.py"))
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "plugins").glob("*/README.md")),
    *sorted((ROOT / "zoo").rglob("*.md")),
]


@pytest.mark.slow
def test_our_packages_import_what_a_third_party_could():
    """The number of private imports in packages of `plugins/`: 0."""
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in PACKAGE_FILES
        for name in _private(path.read_text())
    ]
    assert len(PACKAGE_FILES) > 300
    assert found == []


def test_examples_of_the_pages_import_public_names():
    found, count = [], 0
    for page in PAGES:
        for block in re.findall(r"^([ ]*)```python\n(.*?)^\1```", page.read_text(), re.M | re.S):
            text = dedent(block[1])
            count += len(list(_imports(text)))
            found += [f"{page.relative_to(ROOT)}: {name}" for name in _private(text)]
    assert count > 30
    assert found == []


def test_a_private_import_is_found():
    """The two counts above can fail."""
    text = (
        "from tactileforge.util.files import new_part\nfrom tactileforge.data import Clips, nothing"
    )
    assert list(_private(text)) == ["tactileforge.util.files.new_part", "tactileforge.data.nothing"]


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
            "use: from tactileforge.pages import LocalPage",
        ),
        ("from tactileforge.plugin import SerialArray", "use: from tactileforge_arrays import"),
        (
            "import tactileforge.bench.fit",
            "use: tactileforge_bench (pip install ./plugins/tactileforge-bench)",
        ),
        ("import tactileforge.datasets.octopi", "it comes with tactileforge-datasets: pip install"),
        ("from tactileforge.no_such import thing", "the module is private"),
    ],
)
def test_an_import_that_moved_is_told_where(line, hint, installed):
    installed("older", "[tactileforge.datasets]\nolder = older_data:Older", {"older_data.py": line})
    with pytest.raises(PluginError, match=r"'older' \(older_data:Older, from older 1.0\)") as error:
        registry.get("datasets", "older")
    assert hint in str(error.value)
    told = ("use: ", "docs/reference.md", "pip install ")
    assert any(words in str(error.value) for words in told)


def test_a_module_of_others_that_is_missing_is_left_to_its_own_words(installed):
    installed("sdk", "[tactileforge.sensors]\nsdk = sdk_x:X", {"sdk_x.py": "import no_such_sdk"})
    with pytest.raises(PluginError) as error:
        registry.get("sensors", "sdk")
    assert "use: " not in str(error.value)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("tactileforge_sim", "pip install ./plugins/tactileforge-sim"),
        ("tactileforge_my_sensor.drver", ""),  # a slip inside a package of somebody's own
        ("tactileforge_my_sensor", ""),
        (
            "tactileforge.depth.lighting",
            "use: tactileforge_depth (pip install ./plugins/tactileforge-depth)",
        ),
        (
            "tactileforge.sim.scene",
            "use: tactileforge_sim (pip install ./plugins/tactileforge-sim)",
        ),
    ],
)
def test_what_is_missing_is_named_if_it_is_ours(name, hint):
    assert moves.import_hint(ModuleNotFoundError(f"No module named {name!r}", name=name)) == hint


def test_a_compiled_file_that_was_cut_is_named():
    """As by a full disk, whatever was imported when it was."""
    hint = moves.import_hint(EOFError("marshal data too short"))
    assert hint.endswith("delete those folders")
    assert not moves.import_hint(EOFError("ran out of input"))


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


@pytest.mark.slow
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


REFERENCE = ROOT / "docs/reference.md"
#: Beginning of the page, and of its sections; the names below come from the packages.
HEAD = """\
# Python API

Public packages keep their names: import from them, one level deep, as in
`from tactileforge.data import Clips`. Modules below them and `tactileforge.util` are private and
may change with any release. A public name is removed one minor version after the release whose
changelog says so; before 1.0, in the next one.
"""


def _sections():
    """Titles, first lines and names (with their homes) of the sections of the reference."""
    for name in ["", *PUBLIC]:
        title = f"tactileforge.{name}".rstrip(".")
        package = import_module(title)
        stub = ROOT / "src" / title.replace(".", "/") / "__init__.pyi"
        homes = {one: title for one in package.__all__}
        if stub.exists():
            lines = re.findall(r"^from (\S+) import (\w+) as \w+$", stub.read_text(), re.M)
            homes = {one: home for home, one in lines}
        yield title, (package.__doc__ or "").partition("\n")[0], homes


def reference():
    """The page docs/reference.md."""
    parts = [HEAD]
    for title, first, homes in _sections():
        entries = [f"::: {homes[one]}.{one}\n" for one in sorted(homes, key=str.lower)]
        parts += [f"## {title}\n", f"{first}\n", *entries]
        if title == "tactileforge":
            shown = "{members: true, inherited_members: true}"
            parts += ["### A model\n", f"::: tactileforge.hub.model.Model\n    options: {shown}\n"]
            parts += ["### Errors\n", "::: tactileforge.errors\n    options: {members: true}\n"]
        if title == "tactileforge.testing":
            parts += ["::: tactileforge.testing.emulators\n"]
    return "\n".join(parts)


def _is_there(name: str) -> bool:
    """Whether a dotted name is a module, or a name or annotated field in one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if part in inspect.get_annotations(found if inspect.isclass(found) else type(found)):
                return True
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.slow
def test_names_of_the_glossary_are_there():
    lines = (ROOT / "docs/glossary.md").read_text("utf-8").splitlines()
    cells = [line.split("|")[3] for line in lines if line.count("|") > 4]
    names = [name for cell in cells for name in re.findall(r"`([a-zA-Z_0-9]+(?:\.\w+)+)`", cell)]
    assert len(names) > 40
    missing = [name for name in names if not (_is_there(f"tactileforge.{name}") or _is_there(name))]
    assert missing == []


def test_every_public_name_is_in_the_reference():
    """Written anew by `python tests/test_public.py`."""
    assert REFERENCE.read_text() == reference()


if __name__ == "__main__":
    REFERENCE.write_text(reference())
