"""The example package, installed for real: found, listed, checked, an option of every command."""

import csv
import json
import os
import shutil
import subprocess
import sys
import time
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tactileforge import load
from tactileforge.cli._compose import compose
from tactileforge.plugins import metadata, registry
from tactileforge.specs.published import spec
from tactileforge.testing import check

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow  # pip installs it


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the installed example, beside its sources."""
    work = tmp_path_factory.mktemp("example")
    source = shutil.copytree(ROOT / "plugins/tactileforge-example", work / "source")
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
    command += ["--target", str(work / "site"), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return work / "site"


@pytest.fixture
def example(site, monkeypatch):
    monkeypatch.syspath_prepend(site)
    metadata.entries.cache_clear()
    yield
    metadata.entries.cache_clear()


@pytest.fixture
def run(site, warm):
    def run(name, *words, cwd=None):
        path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")]))
        return subprocess.run(
            [warm.bin / name, *words],
            cwd=cwd,
            env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
        )

    return run


def test_it_is_listed_by_the_command_line(run):
    done = run("tactileforge", "plugins", "list", "--json")
    assert done.returncode == 0, done.stderr
    version = distribution("tactileforge").version
    rows = [row for row in json.loads(done.stdout) if row["distribution"] == "tactileforge-example"]
    assert {(row["kind"], row["name"], row["status"]) for row in rows} == {
        ("sensor", "dummy", "ok"),
        ("check", "worn_gel", "ok"),
        ("container", "npy_folder", "ok"),
        ("dataset", "dummy_presses", "ok"),
        ("encoder", "small_cnn", "ok"),
        ("optimizer", "muon", "ok"),
        ("schedule", "stable_decay", "ok"),
        ("verb", "brightness", "ok"),
        ("conf", "forces_at_a_glance", "ok"),
        ("head", "contact_area", "ok"),
        ("objective", "contact_area", "ok"),
    }
    assert {row["version"] for row in rows} == {version}


def test_it_is_checked_by_the_command_line(run):
    names = ("dummy", "dummy_presses", "contact_area")
    done = run("tactileforge", "plugins", "check", *names)
    assert done.returncode == 0, done.stdout
    summary = done.stdout.splitlines()[-1]
    assert ", 0 failed, 0 expected, " in summary
    assert int(summary.split()[0]) > 30


def test_its_own_tests_pass(site, run):
    done = run("pytest", "-q", "-p", "no:cacheprovider", cwd=site.parent / "source")
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


def test_every_check_of_the_sensor_is_made(example):
    assert {result.status for result in check("sensor", "dummy", gain=3)} == {"ran"}


def test_its_type_of_sensor_is_known_to_data_and_encoder(example):
    assert (spec("dummy").height, spec("dummy").width) == (120, 160)
    recording = next(registry.build("datasets", {"name": "dummy_presses"}).recordings("train"))
    assert recording.sensor == "dummy"
    assert recording.frames.shape == (120, 160)
    with_row = registry.build(
        "encoders",
        {"name": "tactile_vit", "size": "tiny", "image_size": 32, "sensors": {"dummy": 0}},
    )
    assert with_row.sensor_ids(["dummy"]).tolist() == [0]


def test_it_is_an_option_of_every_command(example):
    config = compose(
        overrides=[
            *("data=dummy_presses", "data.count=4"),
            *("objective=[pixel,contact_area]", "objective.contact_area.threshold=5"),
        ]
    )
    assert config.data == {
        "name": "dummy_presses",
        "sensor": "dummy",
        "count": 4,
        "frames": 40,
        "seed": 0,
        "max_bad": 0.01,  # of every data set
    }
    assert config.head.contact_area == {"name": "contact_area"}
    assert config.objective.contact_area.threshold == 5


def test_the_sensor_keeps_real_time(example):
    """Thirty frames a second, and unread frames are lost."""
    with registry.build("sensors", {"name": "dummy"}) as sensor:
        times = [sensor.read().time for _ in range(4)]
        assert times[-1] <= time.monotonic(), "no frame comes before it is due"
        time.sleep(0.2)
        late = sensor.read().time
        with pytest.raises(TimeoutError):
            sensor.read(timeout=0.0)
    frames = [(seconds - times[0]) * 30 for seconds in (*times, late)]
    assert frames == pytest.approx([round(frame) for frame in frames], abs=1e-3)
    assert late - times[-1] > 5 / 30


def test_it_is_not_left_behind():
    assert "dummy" not in registry.names("sensors")


def test_it_trains(run, tmp_path):
    """Data set, objective and head of the package; the sensor's row is in the configuration."""
    words = ["scale=demo", "data=dummy_presses", "objective=[contact_area]", "batch.workers=0"]
    words += ["trainer.max_steps=30", "encoder.image_size=32", "trainer.log_every_n_steps=1"]
    done = run("tactileforge", "train", *words, f"hydra.run.dir={tmp_path}")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "metrics.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    losses = [float(row["train/contact_area"]) for row in rows if row["train/contact_area"]]
    assert losses[-1] < 0.2 * losses[0]
    assert "dummy: 6" in (tmp_path / "config.yaml").read_text()
    assert (tmp_path / "report.html").exists()
    # its head is in the file, and the file loads where the package is and where it is not
    saved = str(tmp_path / "m.safetensors")
    made = "import sys, tactileforge as t\nm = t.load(sys.argv[1])\nprint([*m.heads])\n"
    (tmp_path / "heads.py").write_text(made)
    (tmp_path / "save.py").write_text(f"{made}m.save({saved!r}, licence='MIT')\n")
    with_save = run("warm-python", str(tmp_path / "save.py"), str(tmp_path))
    assert (with_save.returncode, with_save.stdout) == (0, "['contact_area']\n"), with_save.stderr
    assert run("warm-python", str(tmp_path / "heads.py"), saved).stdout == "['contact_area']\n"
    with pytest.warns(UserWarning, match="head contact_area is left out: .*not installed"):
        assert not load(saved).heads
