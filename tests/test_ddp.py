"""Two processes do what one does with the joint batch."""

import csv
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import torch

SCRIPT = Path(__file__).with_name("ddp_gradients.py")


def gradients(out: Path, processes: int) -> dict[str, torch.Tensor]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    running = []
    for rank in range(processes):
        env = os.environ | {
            "RANK": str(rank),
            "WORLD_SIZE": str(processes),
            "MASTER_ADDR": "127.0.0.1",
            "MASTER_PORT": str(port),
            "OMP_NUM_THREADS": "1",
        }
        running.append(subprocess.Popen([sys.executable, str(SCRIPT), str(out)], env=env))
    assert [process.wait(timeout=300) for process in running] == [0] * processes
    return torch.load(out, weights_only=True)


def test_first_step_gradients_are_those_of_the_joint_batch(tmp_path: Path) -> None:
    """Ranks hold different numbers of labelled clips; align gathers features across them."""
    joint, shared = (gradients(tmp_path / f"{n}.pt", n) for n in (1, 2))
    assert joint.keys() == shared.keys()
    parts = ("pixel", "diff", "align", "force", "jepa", "dino", "classify")
    for part in ("encoder.", *(f"heads.{name}." for name in parts)):
        keys = [key for key in joint if key.startswith(part)]
        assert max(joint[key].abs().max().item() for key in keys) > 1e-3  # not vacuous
        for key in keys:
            torch.testing.assert_close(shared[key], joint[key], atol=1e-5, rtol=0, msg=key)


@pytest.mark.slow
def test_two_processes_train_across_the_start_of_an_objective(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tactileforge", "train", "scale=demo", "debug=steps"]
    command += ["trainer.devices=2", "trainer.accelerator=cpu", "trainer.max_steps=6"]
    command += ["encoder.image_size=32", "batch.size=8", f"hydra.run.dir={tmp_path}"]
    command += ["curriculum.objective.force.start=0.5", "curriculum.objective.force.end=1.0"]
    subprocess.run(command, check=True, timeout=900, env=os.environ | {"OMP_NUM_THREADS": "1"})
    text = (tmp_path / "metrics/version_0/metrics.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    force = {int(r["step"]): r["train/force"] for r in rows if r["train/pixel"]}
    assert sorted(force) == list(range(6))
    assert [bool(force[step]) for step in range(6)] == [False] * 4 + [True] * 2
