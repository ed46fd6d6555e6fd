"""Pages of the gallery: each is made by its command in miniature and shown by a browser."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from PIL import Image

from gallery.entry import Entry

#: Size of the window, pixels: a page is cut off below.
WINDOW = (1000, 760)
COMMAND = [sys.executable, "-m", "tactileforge"]
#: Arguments of the commands to make a page, and the file of the page.
PAGES: dict[str, tuple[list[str], str]] = {
    "train": (
        [
            "train scale=finetune init=anytouch2.tiny data.randomise=none data.indenters=bench"
            " data.scenes=12 data.val=4 trainer.max_steps=60 trainer.val_check_interval=20"
            " data.processes=1 batch.workers=0 hydra.run.dir=run"
        ],
        "run/report.html",
    ),
    "inspect": (
        [
            "data inspect data=sim data.scenes=6 data.val=2 data.randomise=all"
            " data.processes=1 out=inspect.html"
        ],
        "inspect.html",
    ),
    "filter": (
        [
            "data filter data=sim data.scenes=4 data.val=1 data.processes=1"
            " pack.filter.laplacian=20 out=filter.html"
        ],
        "filter.html",
    ),
    "bench": (
        [
            "bench suite=sim model=[anytouch2.tiny,touch.tiny,pixels] task=[sim_force]"
            " sim_bench.data.scenes=12 sim_bench.data.val=4 sim_bench.data.size=64"
            " probe.epochs=4 seeds=2 out=bench"
        ],
        "bench/report.html",
    ),
    "calibration": (
        [
            "sim out=presses seconds=24 sensors=[gelsight_mini] size=64 motions=force_trial"
            " indenters=small_sphere action_seconds=0.3 val=0 processes=1",
            "calibrate data=shards data.root=presses out=mini.yaml axes=[z]",
        ],
        "mini.html",
    ),
    "rollout": (
        [
            "rollout task=chip policy=expert n=4 shown=4 out=rollouts processes=1",
        ],
        "rollouts/report.html",
    ),
}
#: Commands of the page that is served: a touch in a loop, as simulation may be slower than live.
TOUCH = (
    "sim out=touch seconds=5 sensors=[gelsight_mini] size=160 motions=force_trial"
    " indenters=pentagram randomise=none force=[6,8] val=0 processes=1"
)
LIVE = (
    "live model=anytouch2.tiny sensor=replay sensor.replay.path=touch/train-000000.tar"
    " sensor.replay.loop=true background.seconds=0.1 background.frames=2 seconds=300"
)
#: Time of readings before the live page is shown, s: its curves are of the last ten.
FILLS = 25.0


def browser() -> str | None:
    """Path of Chromium or Chrome; None without one."""
    return next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)


def shot(address: str, wait_ms: int = 3000) -> Image.Image:
    """Picture of the top of a page.

    Args:
        address: Address of the page.
        wait_ms: Time of its scripts after loading, ms.

    Raises:
        RuntimeError: No browser is installed.
    """
    if (program := browser()) is None:
        raise RuntimeError("no Chromium is installed: pictures of pages need one")
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder, "page.png")
        subprocess.run(
            [
                program, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                "--disable-background-networking", "--no-first-run", "--disable-sync",
                f"--user-data-dir={folder}/profile", f"--window-size={WINDOW[0]},{WINDOW[1]}",
                f"--virtual-time-budget={wait_ms}", f"--screenshot={picture}", address,
            ],
            check=True,
            capture_output=True,
            timeout=300,
        )  # fmt: skip
        return Image.open(picture).convert("RGB")


def make(name: str, folder: Path) -> Path:
    """Runs the commands of a page in a folder, and returns its file."""
    commands, file = PAGES[name]
    for words in commands:
        subprocess.run([*COMMAND, *words.split()], cwd=folder, check=True, capture_output=True)
    return folder / file


def draw(name: str) -> Image.Image:
    """Makes a page and takes its picture."""
    with tempfile.TemporaryDirectory() as folder:
        return shot(make(name, Path(folder)).as_uri())


def draw_live() -> Image.Image:
    """Serves the live page of a simulated touch and takes its picture."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*COMMAND, *TOUCH.split()], cwd=folder, check=True, capture_output=True)
        running = subprocess.Popen(
            [*COMMAND, *LIVE.split()], cwd=folder, stdout=subprocess.PIPE, text=True
        )
        with running:
            assert running.stdout is not None
            lines = (re.search(r"http://\S+", line) for line in running.stdout)
            address = next(found.group() for found in lines if found)
            time.sleep(FILLS)
            picture = shot(address)
            running.terminate()
    return picture


_PAGES = (
    (
        "train",
        "The report of a training: verdict, curves, rebuilt frames, forces, embedding, speed.",
        "Written as `report.html` at the end of every run, and by `tactileforge report RUN`.",
        "[First run](tutorials/first-run.md) · [configuration](configuration.md)",
    ),
    (
        "inspect",
        "What is in a data set: columns, sensors, sizes, labels, doubtful recordings, duplicates.",
        "`tactileforge data inspect data=NAME data.root=DIR out=page.html`",
        "[Look at a data set](inspect.md)",
    ),
    (
        "filter",
        "What a filter would keep: scores of frames by sensor, thresholds, frames on both sides.",
        "`tactileforge data filter data=NAME pack.filter.laplacian=20 out=filter.html`",
        "[Packing](packing.md)",
    ),
    (
        "bench",
        "Encoders beside random weights and pixels: tables with intervals, charts, failures.",
        '`tactileforge bench suite=sim "model=[anytouch2.tiny,pixels]" out=bench`',
        "[Compare encoders](bench.md) · [results](reports/index.md)",
    ),
    (
        "calibration",
        "The calibration of a unit: light, scale, and how well its forces fit.",
        "`tactileforge calibrate data=shards data.root=presses out=mini.yaml`",
        "[Calibrate](calibrate.md)",
    ),
    (
        "rollout",
        "Episodes of a policy: successes with their interval, reasons of failures, videos, forces.",
        "`tactileforge rollout task=chip policy=runs/policy n=100` (`tactileforge-policies`)",
        "[Policies](policies.md) · [four tasks](envs.md)",
    ),
)


def entries() -> list[Entry]:
    """Cards of all pages."""
    cards = [
        Entry(
            kind="report",
            name=name,
            lines=(first, second, third),
            alt=f"Top of the page of {name}",
            draw=partial(draw, name),
        )
        for name, first, second, third in _PAGES
    ]
    live = Entry(
        kind="report",
        name="live",
        lines=(
            "Sensors now: frames, their change, force arrow, curves, contact and slip.",
            "`tactileforge live model=anytouch2.tiny sensor=digit`",
            "[Live](live.md)",
        ),
        alt="Top of the live page of a simulated sensor",
        draw=draw_live,
    )
    return [*cards, live]
