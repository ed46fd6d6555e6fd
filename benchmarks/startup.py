"""Time from the command to the first training step of `scale=demo` on cached data; and `--help`.

CPU seconds of a process of its own, the median of three, excluding other programs. Workers are not
included. Wall seconds are reported beside them, for the machine's load at the time. Modules are
compiled before, as they are from the second start on.

Run: python startup.py [ROUNDS [starts]]; with ``starts`` without the training.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

ROUNDS = 3
TRAIN = ("train", "scale=demo", "debug=none")
WHAT = "CPU and wall seconds of a process from start to end, medians; and CPU over import torch"
#: Code of the measured process: takes marks, and ends after the first step.
CHILD = """
import json, os, sys, time
import tactileforge.cli as cli
marks = {"command line": time.process_time()}
import tactileforge.api as train
marks["imports"] = time.process_time()
def marked(owner, name, mark, ends=False):
    call = getattr(owner, name)
    def wrapped(*args, **options):
        out = call(*args, **options)
        marks[mark] = time.process_time()
        if ends:
            print(json.dumps(marks), flush=True)
            os.killpg(0, 9)
        return out
    setattr(owner, name, wrapped)
marked(train, "build_data", "configuration and data")
marked(train.precision, "choose_precision", "model, and bf16 tried")
marked(train.TouchModule, "optimizer_step", "trainer, readers, first step", ends=True)
cli.run(sys.argv[1:])
"""


def compiled() -> dict[str, str]:
    """Environment of processes with a folder of their own for compiled modules."""
    kept = {key: text for key, text in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    folder = os.path.join(tempfile.gettempdir(), "startup_bytecode")
    return {**kept, "PYTHONPYCACHEPREFIX": folder}


def train_once(folder: str) -> dict[str, float]:
    """CPU seconds at each mark, and wall seconds."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *TRAIN, f"hydra.run.dir={folder}"],
        capture_output=True,
        text=True,
        start_new_session=True,
        env=compiled(),
    )
    marks: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return marks | {"wall": time.perf_counter() - start}


#: Processes that start and end; each is divided by the import of torch.
STARTS = {
    "import torch": ["-c", "import torch"],
    "import tactileforge": ["-c", "import tactileforge"],
    "--help": ["-m", "tactileforge", "--help"],
    "train --help": ["-m", "tactileforge", "train", "--help"],
    "train --cfg job": ["-m", "tactileforge", "train", "--cfg", "job"],
    "import torch, load": [
        "-c",
        "import torch, tactileforge; tactileforge.load('anytouch2.tiny')",
    ],
}


def start_once(words: list[str]) -> dict[str, float]:
    """CPU and wall seconds of a process of its own."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=compiled())
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu": cpu, "wall": time.perf_counter() - start}


def medians(rows: list[dict[str, float]]) -> dict[str, float]:
    """Median of each key."""
    return {key: round(statistics.median(row[key] for row in rows), 3) for key in rows[0]}


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    for words in STARTS.values():  # compiles
        start_once(words)
    # in turns, so that all of them meet the same load
    turns = [{name: start_once(words) for name, words in STARTS.items()} for _ in range(rounds)]
    starts = {name: medians([turn[name] for turn in turns]) for name in STARTS}
    unit = starts["import torch"]["cpu"]
    ratios = {name: round(row["cpu"] / unit, 3) for name, row in starts.items()}
    if "starts" in sys.argv:
        from common import save

        save("startup_ratios", {"what": WHAT, "starts": starts, "to import torch": ratios})
        return
    with tempfile.TemporaryDirectory() as folder:
        rows = [train_once(f"{folder}/{n}") for n in range(rounds + 1)][1:]  # the first makes data
    total = medians(rows)
    wall, marks = total.pop("wall"), list(total.items())
    parts = {
        name: round(value - (marks[i - 1][1] if i else 0), 3)
        for i, (name, value) in enumerate(marks)
    }
    result: dict[str, Any] = {
        "what": "CPU seconds from the command to the end of the first step, scale=demo",
        "starts": starts,
        "to import torch": ratios,
        "first step, cpu s": marks[-1][1],
        "first step, wall s": wall,
        "load": os.getloadavg()[0],
        "parts, cpu s": parts,
    }
    from common import save

    save("startup", result)


if __name__ == "__main__":
    main()
