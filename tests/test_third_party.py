"""Packages of third parties for the contract, frozen: they install and work unchanged."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PACKAGES = Path(__file__).parent / "third_party"
NAMES = sorted(path.name for path in PACKAGES.iterdir() if path.is_dir())

pytestmark = pytest.mark.slow  # pip installs them


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("third_party")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
    sources = []
    for name in NAMES:
        for path in (PACKAGES / name).rglob("*"):
            if path.is_file() and path.suffix in (".py", ".toml"):
                target = folder / "sources" / path.relative_to(PACKAGES)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(path.read_bytes())
        sources.append(str(folder / "sources" / name))
    command = [*pip, "--target", str(folder / "site"), *sources]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


@pytest.fixture
def tactileforge(site, tmp_path, warm):
    def run(*words):
        path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")]))
        done = subprocess.run(
            [warm.bin / "tactileforge", *words],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture
def touches(tmp_path):
    """Ten presses: a disc brighter with the force."""
    folder = tmp_path / "touches"
    folder.mkdir()
    y, x = np.mgrid[:48, :36]
    disc = np.hypot(y - 24, x - 18) < 9
    for i in range(10):
        force = np.linspace([0, 0, 0], [0.1 * i, 0, 1 + i], 24)
        grey = 90 + 8 * force[:, 2, None, None, None] * disc[..., None]
        frames = np.broadcast_to(grey, (24, 48, 36, 3)).astype(np.uint8)
        np.savez(folder / f"{i}.npz", frames=frames, force=force)
    return folder


@pytest.mark.parametrize("words", [["gel_camera"], ["npz_touches"], ["push_goal"], ["npz_count"]])
def test_they_are_checked(tactileforge, words):
    assert " 0 failed, 0 expected" in tactileforge("plugins", "check", *words)


def test_the_data_set_is_read_by_checks_a_verb_and_packing(tactileforge, touches):
    said = tactileforge("plugins", "check", "npz_touches", f"root={touches}")
    assert "0 failed, 0 expected, 0 skipped" in said
    assert tactileforge("npz_count", str(touches)) == "8 touches\n"
    packed = tactileforge("data", "pack", "data=npz_touches", f"data.root={touches}", "out=shards")
    assert "8" in packed


def test_the_objective_trains_on_the_data_set(tactileforge, touches, tmp_path):
    words = ["data=npz_touches", f"data.root={touches}", "objective=[pixel,push_goal]"]
    words += ["scale=tiny", "debug=steps", "objective.push_goal.weight=0.5", "hydra.run.dir=run"]
    tactileforge("train", *words)
    header = (tmp_path / "run/metrics.csv").read_text().splitlines()[0]
    assert "train/push_goal/size" in header
