"""Two processes do the same as one with the joint batch."""

import csv
import os
import socket
import subprocess
from pathlib import Path

import pytest
import torch
from warm import Warm

from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import read_config

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).with_name("ddp_gradients.py")


#: Float32 rounds 24 bits; sums in another order were up to 5e-6 of a tensor's largest value apart.
RELATIVE, ABSOLUTE = 5e-5, 1e-7


def gradients(warm: Warm, out: Path, processes: int, *words: str) -> dict[str, torch.Tensor]:
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
        command = [warm.bin / "warm-python", SCRIPT, out, *words]
        running.append(subprocess.Popen(command, env=env))
    assert [process.wait(timeout=300) for process in running] == [0] * processes
    return torch.load(out, weights_only=True)


def differing(tensors: dict[str, torch.Tensor], right: dict[str, torch.Tensor]) -> list[str]:
    """Tensors with an error beyond rounding, relative to the tensor's largest value."""
    return [
        key
        for key, value in right.items()
        if (tensors[key] - value).abs().max() > RELATIVE * value.abs().max() + ABSOLUTE
    ]


@pytest.fixture(scope="module")
def joint(warm: Warm, tmp_path_factory: pytest.TempPathFactory) -> dict[str, torch.Tensor]:
    return gradients(warm, tmp_path_factory.mktemp("joint") / "1.pt", 1)


def test_first_step_gradients_are_those_of_the_joint_batch(
    tmp_path: Path, warm: Warm, joint: dict[str, torch.Tensor]
) -> None:
    """Ranks hold different numbers of labelled clips; align gathers features across them."""
    shared = gradients(warm, tmp_path / "2.pt", 2)
    assert joint.keys() == shared.keys()
    for name in ("pixel", "diff", "align", "force", "jepa", "dino", "classify"):
        keys = [key for key in joint if key.startswith(f"heads.{name}.")]
        assert max(joint[key].abs().max().item() for key in keys) > 1e-3  # not vacuous
    assert differing(shared, joint) == []


def test_a_wrong_gradient_is_seen(
    tmp_path: Path, warm: Warm, joint: dict[str, torch.Tensor]
) -> None:
    """Ranks dividing by their own count of labels; and any tensor off by 1e-3."""
    local = gradients(warm, tmp_path / "2.pt", 2, "local")
    wrong = differing(local, joint)
    assert {key for key in joint if key.startswith("heads.force.")} - set(wrong) == set()
    assert not [key for key in wrong if key.startswith("heads.") and "force" not in key]
    visible = [key for key, value in joint.items() if value.abs().max() > 1e-3]
    assert len(visible) > 100
    assert set(visible) <= set(differing({k: 1.001 * v for k, v in joint.items()}, joint))


def test_balanced_gradients_are_those_of_the_joint_batch(tmp_path: Path, warm: Warm) -> None:
    """Norms are of the joint batch, not of a rank's rows, and so are the factors."""
    alone, shared = (gradients(warm, tmp_path / f"{n}.pt", n, "gradnorm") for n in (1, 2))
    factor = alone["balance.factor"]
    assert (factor.max() / factor.min()).item() > 2
    assert (alone["balance.norm"] > 0).all()
    assert differing(shared, alone) == []


def trained(warm: Warm, folder: Path, *words: str) -> list[dict[str, float]]:
    """Losses of a run of two processes, step by step; force starts in the fifth of six."""
    command = ["train", "scale=demo", "debug=steps"]
    command += ["data.scenes=6", "data.val=2", "data.size=32"]
    command += ["trainer.devices=2", "trainer.accelerator=cpu", "trainer.max_steps=6"]
    command += ["encoder.image_size=32", "batch.size=8", f"hydra.run.dir={folder}"]
    command += ["data.scenes=3", "data.val=1", "data.size=32", "batch.workers=0"]
    command += ["curriculum.objective.force.start=0.5", "curriculum.objective.force.end=1.0"]
    assert warm.start(*command, *words).wait(timeout=900) == 0
    text = (folder / "metrics.csv").read_text()
    rows = [row for row in csv.DictReader(text.splitlines()) if row["train/loss"]]
    return [{k: float(v) for k, v in row.items() if k.startswith("train/") and v} for row in rows]


def weights(folder: Path) -> dict[str, torch.Tensor]:
    state: dict[str, torch.Tensor] = read_checkpoint(folder)["state_dict"]
    return state


@pytest.fixture(scope="module")
def searched(
    warm: Warm, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[dict[str, float]]]:
    """A run with a search for unused parameters in every step, and its losses."""
    folder = tmp_path_factory.mktemp("searched")
    return folder, trained(warm, folder, "trainer.strategy=ddp_find_unused_parameters_true")


def test_two_processes_train_across_the_start_of_an_objective(
    tmp_path: Path, warm: Warm, searched: tuple[Path, list[dict[str, float]]]
) -> None:
    """A static graph a phase gives, to the bit, the weights of a search in every step."""
    rows = trained(warm, tmp_path)
    assert ["train/force" in row for row in rows] == [False] * 4 + [True] * 2
    assert rows == searched[1]
    state, right = weights(tmp_path), weights(searched[0])
    assert [key for key, value in right.items() if not torch.equal(state[key], value)] == []


def test_shared_weights_train_as_whole_ones(
    tmp_path: Path, warm: Warm, searched: tuple[Path, list[dict[str, float]]]
) -> None:
    """FSDP2: losses of every step to rounding; the checkpoint and the report are whole.

    Weights would not do: AdamW makes steps of one size out of the rounding of the biases of keys,
    whose gradient is 0.
    """
    rows = trained(warm, tmp_path, "trainer.strategy=fsdp2")
    for row, right in zip(rows, searched[1], strict=True):
        assert row == pytest.approx(right, rel=1e-4)
    shapes = {key: value.shape for key, value in weights(searched[0]).items()}
    assert {key: value.shape for key, value in weights(tmp_path).items()} == shapes
    assert (tmp_path / "report.html").exists()


def test_gradients_of_several_batches_make_a_step(tmp_path: Path, warm: Warm) -> None:
    trained(warm, tmp_path, "trainer.accumulate_grad_batches=2", "trainer.max_steps=3")
    assert read_checkpoint(tmp_path)["global_step"] == 3


def test_validation_is_that_of_one_process(tmp_path: Path, warm: Warm) -> None:
    """Every process has all held-out clips, and none is the other's negative."""
    found = []
    for devices in (1, 2):
        folder = tmp_path / str(devices)
        more = [f"trainer.devices={devices}", "optim.lr=0", "trainer.max_steps=1"]
        more += ["trainer.val_check_interval=1", "objective=[pixel,align,match]"]
        trained(warm, folder, *more)
        rows = list(csv.DictReader((folder / "metrics.csv").read_text().splitlines()))
        (row,) = [row for row in rows if row["val/pixel"]]
        found.append({k: float(v) for k, v in row.items() if k.startswith("val/") and v})
    assert "val/align" in found[0]
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_a_run_goes_on_with_two_processes(tmp_path: Path, warm: Warm) -> None:
    more = ["trainer.devices=1", "trainer.max_steps=4", "objective=[pixel]"]
    trained(warm, tmp_path, *more)
    words = [f"resume={tmp_path}", "trainer.devices=2", "trainer.max_steps=6"]
    assert warm.start("train", *words).wait(timeout=300) == 0
    assert read_checkpoint(tmp_path)["global_step"] == 6
    assert read_config(tmp_path)["trainer"]["devices"] == 2
