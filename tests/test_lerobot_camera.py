"""The camera for LeRobot, against LeRobot's own base classes without its dependencies."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "plugins/lerobot_camera_tactileforge"
#: LeRobot, and what its base class of a camera imports beside what is installed here.
NEEDED = (
    "lerobot==0.6.1",
    "draccus==0.11.6",
    "pyyaml-include==2.2",
    "toml==0.10.2",
    "typing-inspect==0.9.0",
)
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--no-deps"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with LeRobot and the package; nothing of it is kept."""
    work = tmp_path_factory.mktemp("lerobot")
    source = shutil.copytree(PACKAGE, work / "source")
    target = ["--ignore-requires-python", "--target", str(work / "site")]
    theirs = subprocess.run([*PIP, *target, *NEEDED], capture_output=True, text=True)
    if theirs.returncode != 0:
        pytest.skip(f"LeRobot cannot be had here: {theirs.stderr.strip().splitlines()[-1]}")
    ours = [*PIP, *target, "--no-build-isolation", str(source)]
    subprocess.run(ours, check=True, capture_output=True)
    return work / "site"


def python(site: Path, *command: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        [sys.executable, *command],
        cwd=site.parent,
        env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )


def test_its_names_are_those_that_lerobot_looks_for() -> None:
    """LeRobot imports the name of the distribution, and strips ``Config`` from the class."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    assert project["name"] == PACKAGE.name
    assert PACKAGE.name.startswith("lerobot_camera_")
    assert (PACKAGE / "src" / PACKAGE.name / "__init__.py").is_file()
    readme = (PACKAGE / "README.md").read_text()
    assert "type: tactileforge" in readme


@pytest.mark.slow
def test_lerobot_finds_it_by_itself(site: Path) -> None:
    script = """
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot.cameras.configs import CameraConfig
register_third_party_plugins()
print(CameraConfig.get_choice_class("tactileforge").__name__)
"""
    done = python(site, "-c", script)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["TactileForgeCameraConfig"]


@pytest.mark.slow
def test_its_own_tests_pass(site: Path) -> None:
    source = site.parent / "source"
    options = ["-q", "-p", "no:cacheprovider", "-c", str(source / "pyproject.toml")]
    done = python(site, "-m", "pytest", *options, str(source / "tests"))
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout
