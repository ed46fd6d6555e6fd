"""A killed and resumed run ends with the weights of an undisturbed one."""

import os
import signal
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
import torch
from tactileforge_sim.config import SimConfig
from tactileforge_sim.generate import write_seconds
from waiting import wait_until
from warm import Started, Warm

from tactileforge import cli
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError
from tactileforge.runs.checkpoint_file import find_checkpoint, initialise, read_checkpoint, seal
from tactileforge.training.balance import GradNorm
from tactileforge.training.checkpoints import AtomicCheckpointIO
from tactileforge.util.signals import ENDING

OPTIONS = ["scale=demo", "encoder.image_size=32", "encoder.depth=2", "batch.size=8"]
OPTIONS += ["batch.workers=1", "trainer.max_steps=10", "trainer.save_every=3"]
OPTIONS += ["trainer.val_check_interval=4", "trainer.limit_val_batches=2"]
OPTIONS += ["augment.jitter=0.1", "logger=csv"]
SMALL = ["data.scenes=3", "data.val=1", "data.size=32"]


def wait_for_checkpoint(folder: Path, process: Started) -> None:
    while not (folder / "checkpoints" / "last.ckpt").exists():
        assert process.poll() is None, "the run ended before it was to be stopped"
        time.sleep(0.02)


def same(a: object, b: object, where: str = "") -> None:
    """Everything in two checkpoints is equal to the bit."""
    if isinstance(a, torch.Tensor):
        assert isinstance(b, torch.Tensor), where
        assert torch.equal(a, b), where
    elif isinstance(a, dict):
        assert isinstance(b, dict), where
        assert a.keys() == b.keys(), where
        for key in a:
            same(a[key], b[key], f"{where}/{key}")
    elif isinstance(a, list | tuple):
        assert isinstance(b, list | tuple), where
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}/{i}")
    else:
        assert a == b, where


def options_of(data: str, folder: Path) -> list[str]:
    """One data set sampled as a whole, in bf16; or two, window by window, with balanced losses.

    `asleep` is saved before two of its objectives have had a gradient, by two processes (FSDP2).
    `dino` has a slow copy of the encoder, a centre and a temperature that change step by step; in
    `sharded`, two processes have a share of them each (FSDP2). `compiled` has a teacher, whose
    features are measured before the first step alone. `augmented` changes clips in every way.
    """
    if data == "whole":
        # products of bf16 are slow where a CPU has no instruction for them
        few = ["objective=[pixel,match,force]", "encoder.depth=1", "head.pixel.depth=1"]
        return [*OPTIONS, *SMALL, *few, "batch.size=4", "trainer.precision=bf16-mixed"]
    if data == "compiled":
        compiled = ["compile=true", "objective=[pixel,distill]", "trainer.limit_val_batches=0"]
        compiled += ["image_encoder=efficientnet_lite"]
        return [*OPTIONS, *SMALL, *compiled]
    if data == "augmented":
        ranges = {"rotate": 180, "shift": 0.1, "scale": 0.2, "blur": 1, "gain": 0.2, "colour": 0.1}
        changes = [f"augment.{name}={value}" for name, value in ranges.items()]
        changes += ["augment.noise=3", "augment.chance.noise=0.5"]
        return [*OPTIONS, *SMALL, *changes, "objective=[pixel,match,force,surface]"]
    if data == "dino":
        return ["recipe=dino", *OPTIONS, *SMALL]
    if data == "sharded":
        two = ["trainer.strategy=fsdp2", "trainer.devices=2", "trainer.accelerator=cpu"]
        # the sixth step starts after a validation and ends with a save
        two += ["trainer.val_check_interval=5"]
        return ["recipe=dino", *OPTIONS, *SMALL, *two]
    if data == "asleep":
        two = ["trainer.strategy=fsdp2", "trainer.devices=2", "trainer.accelerator=cpu"]
        two += ["trainer.val_check_interval=5"]
        rows = [f"curriculum.objective.{key}" for key in ("force", "match")]
        staged = [f"{row}.{edge}" for row in rows for edge in ("start=0.8", "end=1.0")]
        return [*OPTIONS, *SMALL, *two, *staged]
    for number in range(2):
        config = SimConfig(
            sensors=("digit", "gelsight_mini"),
            indenters="pretrain",
            motions="atomic",
            size=32,
            seconds=0.6,
            force=(0.5, 8.0),
            markers=None,
            viscosity=0.0,
            lag=0.0,
            seed=number,
        )
        write_seconds(config, folder / str(number), seconds=8, val=0.2)
    mixed = [f"+data@data.sources.{name}=shards" for name in "ab"]
    mixed += [f"data.sources.{name}.root={folder / str(i)}" for i, name in enumerate("ab")]
    windows = ["batch.window=2", "batch.workers=2", "batch.shares.force=0.25"]
    balance = ["balance=gradnorm", "balance.every=3", "objective.force.scaled=true"]
    return [*OPTIONS, "data=mixture", *mixed, *windows, *balance]


@pytest.mark.slow
@pytest.mark.parametrize(
    "data", ["whole", "windows", "dino", "sharded", "asleep", "compiled", "augmented"]
)
def test_a_killed_run_resumes_bit_identically(tmp_path: Path, data: str, warm: Warm) -> None:
    start = partial(warm.start, "train")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    options = options_of(data, tmp_path / "shards")
    assert start(*options, f"hydra.run.dir={whole}").wait(timeout=800) == 0
    run = start(*options, f"hydra.run.dir={killed}")
    wait_for_checkpoint(killed, run)
    os.killpg(run.pid, signal.SIGKILL)  # all its processes
    assert run.wait() == -signal.SIGKILL
    end = read_checkpoint(whole)["global_step"]
    assert end == 10
    assert 3 <= read_checkpoint(killed)["global_step"] < end
    machine = ["batch.workers=0"] if data == "whole" else []  # other readers, the same clips
    assert start(f"resume={killed}", *machine).wait(timeout=800) == 0
    ends = [read_checkpoint(folder) for folder in (whole, killed)]
    assert ends[1]["global_step"] == end
    for part in ("state_dict", "optimizer_states", "lr_schedulers"):
        same(ends[0][part], ends[1][part], part)
    assert (killed / "report.html").exists()


@pytest.mark.slow
def test_a_sharded_run_goes_on_with_another_number_of_processes(tmp_path: Path, warm: Warm) -> None:
    """Two, one, two; saved while no gradient has reached the heads that wake late."""
    first = ["trainer.max_steps=2", "trainer.save_every=2"]
    options = [*options_of("asleep", tmp_path), *first, "trainer.val_check_interval=100"]
    assert warm.start("train", *options, f"hydra.run.dir={tmp_path}").wait(timeout=800) == 0
    for devices, steps in ((1, 4), (2, 6)):
        more = [f"trainer.devices={devices}", f"trainer.max_steps={steps}"]
        assert warm.start("train", f"resume={tmp_path}", *more).wait(timeout=800) == 0
        assert read_checkpoint(tmp_path)["global_step"] == steps
    state = read_checkpoint(tmp_path)["optimizer_states"][0]["state"]
    assert {int(one["step"]) for one in state.values()} <= {4, 5, 6}


@pytest.mark.slow
@pytest.mark.parametrize("number", ENDING)
def test_a_signal_to_all_leaves_a_checkpoint_that_resumes(
    tmp_path: Path, warm: Warm, number: signal.Signals
) -> None:
    options = [*OPTIONS, *SMALL, "trainer.max_steps=100000", f"hydra.run.dir={tmp_path}"]
    run = warm.start("train", *options)
    wait_for_checkpoint(tmp_path, run)
    before = read_checkpoint(tmp_path)["global_step"]
    time.sleep(0.5)
    os.killpg(run.pid, number)  # as a terminal and Slurm do: the run and its readers
    assert run.wait(timeout=600) == 130
    assert read_checkpoint(tmp_path)["global_step"] >= before


def of_session(leader: int) -> set[int]:
    """Running processes of a session, without the dead ones nobody waited for."""
    found = set()
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            # behind the name, which may hold blanks: state, parent, group, session
            state, _, _, session = entry.read_text().rpartition(")")[2].split()[:4]
            if int(session) == leader and state not in "ZX":
                found.add(int(entry.parent.name))
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's list of processes")
def test_a_killed_parent_leaves_no_process_of_its_run(tmp_path: Path, warm: Warm) -> None:
    """The second process, and the readers of both with their servers."""
    two = ["trainer.devices=2", "trainer.accelerator=cpu", "objective=[pixel]"]
    two += ["trainer.save_every=1", "trainer.limit_val_batches=0"]
    words = [*OPTIONS, *SMALL, *two, "trainer.max_steps=100000", f"hydra.run.dir={tmp_path}"]
    run = warm.start("train", *words)
    try:
        wait_for_checkpoint(tmp_path, run)
        others = of_session(run.pid) - {run.pid}
        assert len(others) >= 3
        os.kill(run.pid, signal.SIGKILL)  # the parent only
        assert run.wait(timeout=60) == -signal.SIGKILL
        wait_until(lambda: not of_session(run.pid), 120, "processes are left")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)


def test_nothing_may_change_on_resume(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["train", f"resume={tmp_path}", "optim.lr=1"]) == 1
    assert "optim.lr=1 cannot be given with it" in capsys.readouterr().err


def test_a_checkpoint_is_written_beside_and_renamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x" / "last.ckpt"
    AtomicCheckpointIO().save_checkpoint({"state_dict": {"a": torch.ones(2)}}, path)

    def crash(checkpoint: object, file: object) -> None:
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(torch, "save", crash)
    with pytest.raises(TactileForgeError, match=r"disk full.*the one before it stays"):
        AtomicCheckpointIO().save_checkpoint({"state_dict": {"a": torch.zeros(2)}}, path)
    assert read_checkpoint(path)["state_dict"]["a"].tolist() == [1, 1]
    assert not list(path.parent.glob("*.part"))


class Evil:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("executed",)


def test_nothing_in_a_checkpoint_is_executed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with (tmp_path / "evil.ckpt").open("w+b") as file:
        torch.save({"state_dict": Evil()}, file)
        seal(file)
    with pytest.raises(ConfigError, match=r"evil\.ckpt is not a checkpoint"):
        read_checkpoint(tmp_path / "evil.ckpt")
    assert not (tmp_path / "executed").exists()


def test_a_missing_checkpoint_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        find_checkpoint(tmp_path)


def test_init_takes_what_fits_and_refuses_another_encoder() -> None:
    module = torch.nn.ModuleDict({"encoder": torch.nn.Linear(2, 3), "heads": torch.nn.Linear(3, 1)})
    state = {"encoder.weight": torch.ones(3, 2), "encoder.bias": torch.ones(3)}
    line = initialise(module, state | {"heads.weight": torch.ones(1, 5), "old.bias": torch.ones(1)})
    assert (module["encoder"].weight == 1).all()
    assert "2 tensors taken; new: heads; not used: heads, old" in line
    module["balance"] = GradNorm(["a"])
    initialise(module, state | {"balance.factor": torch.full((1,), 5.0)})
    assert module["balance"].factor.tolist() == [1.0]  # of that run
    with pytest.raises(ConfigError, match=r"encoder\.bias \(missing in the checkpoint"):
        initialise(module, {"encoder.weight": torch.ones(3, 2)})
