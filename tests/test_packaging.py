"""The wheel holds the same as the checkout, and trains outside of it."""

import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from made_files import make_files

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
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    run = subprocess.run(
        [
            str(tmp_path / "venv/bin/python"),
            *("-c", "from tactileforge.cli import main; main()", "train", "scale=demo"),
            *("debug=steps", "encoder.image_size=32", "batch.size=4", "hydra.run.dir=run"),
            *("data=recordings", "data.root=touches", "objective=[pixel,diff,force]"),
        ],
        cwd=work,
        env=env,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stderr
    assert (work / "run/report.html").stat().st_size > 10_000
    assert str(ROOT) not in (work / "run/config.yaml").read_text()
