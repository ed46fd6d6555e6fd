"""Imports and the first hour, without the modules of POSIX systems."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

#: Takes from a Linux what Windows does not have, once the libraries are imported: their builds for
#: Linux rely on it.
WITHOUT = """
import os, signal, sys
import cv2, h5py, hydra, lightning, matplotlib.pyplot, torch, torchmetrics, tqdm, webdataset
for name in ("fcntl", "resource", "termios", "pty", "tty", "pwd", "grp"):
    sys.modules[name] = None
for name in ("sched_getaffinity", "register_at_fork", "fork", "forkpty", "killpg", "setsid"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGHUP", "SIGUSR2", "SIGCHLD", "pthread_sigmask", "SIGALRM"):
    if hasattr(signal, name):
        delattr(signal, name)
"""

IMPORTS = """
import pkgutil, tactileforge
from importlib import import_module
names = [m.name for m in pkgutil.walk_packages(tactileforge.__path__, "tactileforge.")]
names = [n for n in names if n != "tactileforge.__main__" and ".example" not in n]
for name in names:
    import_module(name)
print("imported", len(names), flush=True)
"""

HOUR = """
import numpy as np
import tactileforge
from tactileforge.cli import run
model = tactileforge.load("anytouch2.tiny")
rest = np.full((240, 320, 3), 110, np.uint8)
assert model.encode(np.stack([rest] * 4), rest, "gelsight_mini").shape == (3840,)

def done(*words):
    assert run(list(words)) == 0, words

sim = ["data=sim", "data.scenes=3", "data.val=1", "data.size=32", "data.cache=cache"]
sim += ["data.sensors=[digit]"]
done("data", "pack", *sim, "out=packed", "pack.processes=1")
done("data", "inspect", "data=shards", "data.root=packed", "out=page.html")
shards = ["data=shards", "data.root=packed", "hydra.run.dir=run", "batch.workers=0"]
done("train", "scale=demo", "debug=steps", "objective=[pixel]", "encoder.image_size=32", *shards)
print("all done")
"""


@pytest.fixture(scope="module")
def first_hour(tmp_path_factory):
    """Answers of one process about both, and its folder."""
    folder = tmp_path_factory.mktemp("hour")
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT + IMPORTS + HOUR], cwd=folder, capture_output=True, text=True
    )
    return done, folder


@pytest.mark.slow
def test_every_module_is_imported(first_hour):
    done, _ = first_hour
    found = re.match(r"imported (\d+)\n", done.stdout)
    assert found, done.stderr[-3000:]
    assert int(found[1]) > 250


def test_make_on_windows_says_what_to_type_instead():
    root = Path(__file__).parents[1]
    # not as a part of the make that may run these tests, which would say where it enters
    own = {key: text for key, text in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    command = ["make", "--dry-run", "demo", "OS=Windows_NT"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, env=own)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "docs/install.md says what to type" in line
    page = (root / "docs/install.md").read_text("utf-8").partition("## On Windows")[2]
    typed = page.partition("```powershell\n")[2].partition("```")[0]
    other = {**own, "OS": ""}
    command = ["make", "--dry-run", "demo"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, env=other, check=True)
    train = next(line for line in done.stdout.splitlines() if "tactileforge train" in line)
    assert train.partition("/tactileforge ")[2] in typed


@pytest.mark.slow
def test_load_encode_pack_inspect_and_train(first_hour):
    done, folder = first_hour
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    assert "all done" in done.stdout
    assert (folder / "page.html").exists()
    assert (folder / "run/report.html").exists()
