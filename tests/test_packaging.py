"""The wheel holds the same as the checkout, and trains outside of it."""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
import yaml
from made_files import make_files
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    source = out / "source"  # a copy: building leaves files behind
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.split("\n")
    for name in filter(None, files):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", str(out)]
    subprocess.run([*command, str(source)], check=True, capture_output=True)
    return next(out.glob("*.whl"))


def test_every_package_folder_is_listed() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    source = ROOT / "src"
    folders = {
        ".".join(init.parent.relative_to(source).parts)
        for init in (source / "tactileforge").rglob("__init__.py")
    } | {"hydra_plugins", "hydra_plugins.tactileforge_searchpath"}
    assert folders <= set(listed)
    assert set(listed) - folders <= {
        "tactileforge.conf",
        "tactileforge.zoo",
        "tactileforge.example",
    }


def requirements() -> list[tuple[str, Requirement]]:
    """Needs of the core and of all packages, with the place of each: extras and dependencies."""
    found = []
    for path in [ROOT / "pyproject.toml", *sorted(ROOT.glob("plugins/*/pyproject.toml"))]:
        project = tomllib.loads(path.read_text("utf-8"))["project"]
        groups = {"": project["dependencies"], **project.get("optional-dependencies", {})}
        for extra, needs in groups.items():
            place = f"{project['name']}[{extra}]"
            found += [(place, Requirement(need)) for need in needs]
    return found


def test_every_extra_agrees_with_the_constraints() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    known = [Requirement(line) for line in lines if line and not line.startswith("#")]
    pins = {canonicalize_name(one.name): next(iter(one.specifier)).version for one in known}
    assert len(pins) == len(known) > 100
    wrong = [
        f"{place} needs {need}, pinned is {pins[name]}"
        for place, need in requirements()
        if (name := canonicalize_name(need.name)) in pins
        and not need.specifier.contains(pins[name], prereleases=True)
    ]
    assert not wrong
    # mlflow takes older ones alone than the others bring
    assert "importlib-metadata" not in pins


def test_the_workflow_installs_every_extra() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text("utf-8"))["jobs"]
    steps = " ".join(str(step.get("run")) for step in jobs["extras"]["steps"])
    assert "pip install -c constraints.txt ${{ matrix.install }}" in steps
    rows = " ".join(jobs["extras"]["strategy"]["matrix"]["install"])
    installed = {
        f"{folder.rpartition('/')[2].replace('.', 'tactileforge')}[{extra}]"
        for folder, extras in re.findall(r"(\S+)\[([\w,]+)\]", rows)
        for extra in extras.split(",")
    }
    # `test` is pytest; extras that name only packages of ours bring nothing from others
    wanted = {
        place
        for place, need in requirements()
        if not place.endswith(("[]", "[test]")) and not need.name.startswith("tactileforge")
    }
    assert installed == wanted


def test_an_extra_names_extras_that_exist() -> None:
    known = {place for place, _ in requirements()}
    named = [
        (place, f"{need.name}[{extra}]") for place, need in requirements() for extra in need.extras
    ]
    ours = [pair for pair in named if pair[1].startswith("tactileforge")]
    assert ours
    assert [pair for pair in ours if pair[1] not in known] == []


def test_constraints_and_the_sizes_of_wheels_come_with_them(tmp_path: Path) -> None:
    path = tmp_path / "a-1-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("a/weights.safetensors", bytes(2_000_000))
        made.writestr("a/__init__.py", "")
    spec = importlib.util.spec_from_file_location("wheels", ROOT / "scripts/wheels.py")
    assert spec is not None
    assert spec.loader is not None
    wheels = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(wheels)
    assert wheels.size(path) == "2.0 MB, of which 2.0 MB of weights unpacked"
    assert wheels.keep_constraints(tmp_path).read_text() == (ROOT / "constraints.txt").read_text()


@pytest.mark.slow
def test_the_wheel_has_every_configuration_and_card(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    for top in ("conf", "zoo"):
        for path in (ROOT / top).rglob("*"):
            if path.suffix in (".yaml", ".md"):
                assert f"tactileforge/{path.relative_to(ROOT)}" in held
    assert "tactileforge/py.typed" in held
    assert not [name for name in held if "__pycache__" in name or name.endswith(".pyc")]


@pytest.mark.slow
def test_the_wheel_trains_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    """A new environment sees this one's libraries, but neither this checkout nor its packages."""
    venv.create(tmp_path / "venv", with_pip=False)
    site = next((tmp_path / "venv").glob("lib/python*/site-packages"))
    zipfile.ZipFile(wheel).extractall(site)
    libraries = next(Path(p) for p in sys.path if p.endswith("site-packages"))
    for entry in libraries.iterdir():
        if "tactileforge" not in entry.name and not (site / entry.name).exists():
            (site / entry.name).symlink_to(entry)
    work = tmp_path / "work"
    work.mkdir()
    make_files("touches", work)
    hidden = ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONPYCACHEPREFIX")
    env = {k: v for k, v in os.environ.items() if k not in hidden}
    run = subprocess.run(
        [
            str(tmp_path / "venv/bin/python"),
            *("-c", "from tactileforge.cli import main; main()", "train", "scale=demo"),
            *("debug=steps", "encoder.image_size=32", "batch.size=4", "hydra.run.dir=run"),
            *("data=recordings", "data.root=touches", "objective=[pixel,diff,force]"),
        ],
        cwd=work,
        env=env | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stderr
    assert (work / "run/report.html").stat().st_size > 10_000
    assert str(ROOT) not in (work / "run/config.yaml").read_text()
