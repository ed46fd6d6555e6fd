"""A run's folder belongs to one run."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from warm import Warm

from tactileforge import cli
from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards.shards import Packed, describe_recording, encode_image, write_shard
from tactileforge.errors import ConfigError, DataError, TactileForgeError
from tactileforge.pages.curves import read_metrics
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import read_checkpoint, read_own, seal
from tactileforge.runs.folder import LAST
from tactileforge.training import checkpoints
from tactileforge.training.checkpoints import AtomicCheckpointIO
from tactileforge.training.module import TouchModule
from tactileforge.training.optim import build_optimizer
from tactileforge.training.run_length import change_run

SMALL = ["train", "scale=demo", "debug=steps", "encoder.image_size=32", "batch.workers=0"]
SMALL += ["objective=[pixel]", "batch.size=8", "data.scenes=3", "data.val=1", "data.size=32"]

#: Holds the lock of a folder until its input ends.
HOLD = """
import fcntl, sys
file = open(sys.argv[1], "w")
fcntl.lockf(file, fcntl.LOCK_EX)
print("123 on there", file=file, flush=True)
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_that_is_written_is_refused(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path / run_folder.LOCK)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        for resumes in (False, True):
            with (
                pytest.raises(ConfigError, match=r"another run .*process 123 on there"),
                run_folder.claimed(tmp_path, resumes),
            ):
                pass
        other.communicate()
    with run_folder.claimed(tmp_path, resumes=False):  # the lock went with its process
        pass


def test_a_start_that_is_refused_leaves_the_run_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also while the other still makes its data, and has written nothing."""
    lock = tmp_path / run_folder.LOCK
    command = [sys.executable, "-c", HOLD, str(lock)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        assert run_folder.is_claimed(tmp_path)
        for words in ((), ("optim.lr=none",)):
            assert cli.run([*SMALL, *words, f"hydra.run.dir={tmp_path}"]) == 1
            assert lock.is_file()
        assert "another run writes here" in capsys.readouterr().err
        other.communicate()
    assert not run_folder.is_claimed(tmp_path)


@pytest.mark.slow
def test_two_runs_of_one_second_have_two_folders(capsys: pytest.CaptureFixture[str]) -> None:
    folders = set()
    for _ in range(2):
        assert cli.run(["train", "--cfg", "hydra", "--resolve", "--package", "hydra.run"]) == 0
        folders.add(capsys.readouterr().out)
    assert len(folders) == 2


@pytest.mark.slow
def test_the_folder_of_a_run_is_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A second run is refused, and another run's checkpoint is not gone on with."""
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        assert cli.run([*SMALL, f"hydra.run.dir={folder}"]) == 0
    before = (one / LAST).read_bytes(), (one / "config.yaml").read_bytes()
    assert cli.run([*SMALL, "seed=1", f"hydra.run.dir={one}"]) == 1
    assert f"{one} holds a run: go on with it (resume={one})" in capsys.readouterr().err
    assert before == ((one / LAST).read_bytes(), (one / "config.yaml").read_bytes())

    assert read_checkpoint(one)["run"] == run_folder.read_config(one)["run"]
    (one / LAST).write_bytes((other / LAST).read_bytes())
    assert cli.run(["train", f"resume={one}"]) == 1
    said = capsys.readouterr().err
    assert (
        f"is a checkpoint of run {read_checkpoint(other)['run']}, but config.yaml beside it" in said
    )


def test_a_checkpoint_is_of_one_run(tmp_path: Path) -> None:
    AtomicCheckpointIO("a").save_checkpoint({"state_dict": {}}, tmp_path / LAST)
    assert read_own(tmp_path, "a")["run"] == "a"
    with pytest.raises(ConfigError, match=r"of run a, but config\.yaml beside it is of run b"):
        AtomicCheckpointIO("b").load_checkpoint(tmp_path / LAST)


def test_every_flipped_bit_of_a_checkpoint_is_found(tmp_path: Path) -> None:
    path = tmp_path / LAST
    AtomicCheckpointIO("a").save_checkpoint({"state_dict": {"w": torch.arange(64.0)}}, path)
    assert read_checkpoint(path)["state_dict"]["w"].tolist() == list(range(64))
    raw = path.read_bytes()
    for place in range(0, len(raw), 7):
        path.write_bytes(raw[:place] + bytes([raw[place] ^ 1 << place % 8]) + raw[place + 1 :])
        with pytest.raises(ConfigError, match="checksum"):
            read_checkpoint(path)


@pytest.mark.parametrize("left", [0, 10, 900, -1])
def test_half_a_checkpoint_is_named(tmp_path: Path, left: int) -> None:
    path = tmp_path / LAST
    AtomicCheckpointIO("a").save_checkpoint({"state_dict": {"w": torch.zeros(64)}}, path)
    path.write_bytes(path.read_bytes()[:left])
    with pytest.raises(ConfigError, match="cut off, or of another program"):
        read_checkpoint(path)


def test_what_is_sealed_is_not_sealed_again(tmp_path: Path) -> None:
    AtomicCheckpointIO("a").save_checkpoint({"state_dict": {}}, tmp_path / LAST)
    with (tmp_path / LAST).open("r+b") as file, pytest.raises(ValueError, match="has a checksum"):
        seal(file)


@pytest.mark.slow
def test_a_configuration_that_has_changed_is_an_error(tmp_path: Path) -> None:
    plain = {"optim": {"lr": 0.001}, "data": {"root": "${oc.env:HOME}"}, "seed": 3}
    run_folder.write_config(tmp_path, plain)
    assert run_folder.read_config(tmp_path) == plain
    path = tmp_path / run_folder.CONFIG
    raw = path.read_bytes()
    for bit in range(8 * len(raw)):
        flipped = bytearray(raw)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        with pytest.raises(DataError, match="not the configuration of a run"):
            run_folder.read_config(tmp_path)
    path.write_bytes(raw.partition(b"\n")[2].replace(b"0.001", b"0.003"))  # by hand, on purpose
    assert run_folder.read_config(tmp_path)["optim"] == {"lr": 0.003}


Limited = Callable[..., subprocess.CompletedProcess[str]]
LIMITED = """
import resource, sys
from tactileforge.cli import run
limit = int(sys.argv[1])
# a compiled file that is cut would break later imports
sys.dont_write_bytecode = True
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.exit(run(sys.argv[2:]))
"""


@pytest.fixture
def limited(warm: Warm, tmp_path: Path) -> Limited:
    """A command with a limit on the bytes of its files, as on a full disk."""
    script = tmp_path / "limited.py"
    script.write_text(LIMITED)

    def run(limit: int, *words: str) -> subprocess.CompletedProcess[str]:
        command = [warm.bin / "warm-python", script, str(limit), *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=300)

    return run


@pytest.mark.slow
def test_a_full_disk_in_training_is_one_line_and_leaves_nothing_half(
    tmp_path: Path, limited: Limited
) -> None:
    words = [*SMALL, "trainer.max_steps=2", "trainer.save_every=2", "trainer.limit_val_batches=0"]
    assert cli.run([*words, f"hydra.run.dir={tmp_path / 'whole'}"]) == 0
    size = (tmp_path / "whole" / LAST).stat().st_size
    folder = tmp_path / "full"
    done = limited(size // 2, *words, f"hydra.run.dir={folder}")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if "error: " in line]
    assert line.startswith("error: "), "on a line of its own, behind the bar"
    assert "last.ckpt: the checkpoint cannot be written" in line
    assert "Make room, then go on" in line
    assert "Traceback" not in done.stderr
    assert not (folder / LAST).exists()
    assert not list(folder.rglob("*.part"))


@pytest.mark.slow
def test_a_full_disk_in_other_verbs_is_one_line(tmp_path: Path, limited: Limited) -> None:
    made = limited(5000, "sim", f"out={tmp_path / 'a'}", "seconds=0.5", "size=32")
    shown = limited(
        5000, "data", "inspect", "data=sim", "data.scenes=3", "data.size=32", f"out={tmp_path}/p"
    )
    for done in (made, shown):
        assert done.returncode == 1
        assert re.search(r"^error: .*File too large.*make room", done.stderr, re.M)
        assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.slow
def test_room_is_looked_for_before_the_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The step before a save is not computed in vain."""
    steps: list[int] = []
    sizes: list[int] = []

    def full(path: Path, size: int) -> None:
        sizes.append(size)
        if len(sizes) == 3:  # at the start, and before the second and the fourth step
            raise TactileForgeError("the disk is full")

    monkeypatch.setattr(checkpoints, "check_room", full)
    step = TouchModule.training_step

    def counted(self: TouchModule, *given: object) -> object:
        steps.append(1)
        return step(self, *given)

    monkeypatch.setattr(TouchModule, "training_step", counted)
    words = ["trainer.max_steps=8", "trainer.save_every=2", f"hydra.run.dir={tmp_path}"]
    assert cli.run([*SMALL, *words]) == 1
    assert len(steps) == 3
    assert read_checkpoint(tmp_path)["global_step"] == 2
    for size in sizes[::2]:  # of a run that has taken no step, it is what it will be
        assert size == pytest.approx((tmp_path / LAST).stat().st_size, rel=0.1)


def test_no_room_is_an_error_with_numbers(tmp_path: Path) -> None:
    with pytest.raises(TactileForgeError, match=r"MB are left, and a checkpoint takes 1,000,000,0"):
        checkpoints.check_room(tmp_path / LAST, 10**15)
    checkpoints.check_room(tmp_path / LAST, 10)
    with pytest.MonkeyPatch.context() as patch:
        left = SimpleNamespace(free=2_500_000)
        patch.setattr(checkpoints.shutil, "disk_usage", lambda path: left)
        with pytest.raises(TactileForgeError, match=r"2\.5 MB are left, .* takes 3\.0 MB"):
            checkpoints.check_room(tmp_path / LAST, 3_000_000)


@pytest.mark.slow
def test_a_finished_run_is_made_longer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rate is that of the new length, the curriculum that of the old one."""
    staged = ["curriculum=staged", "objective=[pixel,force]", "optim.warmup=0.25"]
    words = [*SMALL, *staged, "trainer.max_steps=8", "trainer.max_epochs=-1"]
    assert cli.run([*words, f"hydra.run.dir={tmp_path}"]) == 0
    before = read_metrics(tmp_path)
    capsys.readouterr()
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=20"]) == 0
    said = capsys.readouterr().out
    assert "from step 8 on with trainer.max_steps=20" in said
    assert "the curriculum stays as planned for 8 steps" in said

    after = read_metrics(tmp_path)
    assert after["lr"].steps.tolist() == list(range(20))
    assert after["lr"].values[:8].tolist() == before["lr"].values.tolist()
    # 5 of 20 steps are the warm-up; from then on 1e-3 (20 - step) / 16
    wanted = [1e-3 * (20 - step) / 16 for step in range(8, 20)]
    assert after["lr"].values[8:].tolist() == pytest.approx(wanted, rel=1e-5)
    assert after["weight/force"].values[:8].tolist() == before["weight/force"].values.tolist()
    assert set(after["weight/force"].values[8:]) == {before["weight/force"].values.max(), 1.0}
    assert read_checkpoint(tmp_path)["global_step"] == 20

    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=20"]) == 0  # nothing to do
    assert "the run has ended at step 20" in capsys.readouterr().out
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=12"]) == 1
    assert "is already at step 20" in capsys.readouterr().err
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_epochs=3"]) == 1
    assert "ends by trainer.max_steps=20: give another" in capsys.readouterr().err
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=30", "optim.lr=1"]) == 1
    assert "optim.lr=1 cannot be given with it, but for its length" in capsys.readouterr().err


@pytest.mark.slow
def test_steps_are_counted_on_where_a_validation_was_the_last(tmp_path: Path) -> None:
    words = [*SMALL, "trainer.max_epochs=-1", "trainer.val_check_interval=2"]
    words += ["trainer.log_every_n_steps=2"]
    assert cli.run([*words, "trainer.max_steps=4", f"hydra.run.dir={tmp_path}"]) == 0
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=8"]) == 0
    metrics = read_metrics(tmp_path)
    assert metrics["train/loss"].steps.tolist() == [1, 3, 5, 7]
    assert metrics["val/pixel"].steps.tolist() == [1, 3, 5, 7]


def run_by(key: str, **trainer: Any) -> dict[str, Any]:
    lengths = {"max_steps": -1, "max_epochs": -1, "devices": 1, "num_nodes": 1}
    lengths |= {key: 6, "accelerator": "cpu"}
    curriculum = {"unit": "epoch", "objective": {"force": {"start": 2}}}
    return {"trainer": lengths | trainer, "curriculum": curriculum}


def test_a_run_goes_on_with_other_processes() -> None:
    """With its full number of steps, also with epochs of another length."""
    state = {"global_step": 30, "total": 120, "epoch_steps": 20, "processes": 1}
    steps = {"start": 40.0, "end": 120.0}
    plain = run_by("max_steps", devices=2)
    assert change_run(plain, run_by("max_steps"), state)
    assert plain["trainer"] == run_by("max_steps", devices=2)["trainer"]
    assert plain["curriculum"]["objective"]["force"] == steps
    plain = run_by("max_epochs", devices=3)  # as many as there are, which were others before
    assert change_run(plain, run_by("max_epochs", devices=3), state)
    assert plain["trainer"]["max_steps"] == 120
    assert not change_run(run_by("max_epochs"), run_by("max_epochs"), state)
    plain = run_by("max_epochs", devices=2)
    assert change_run(plain, run_by("max_epochs"), state)
    assert plain["trainer"] == run_by("max_steps", devices=2, max_steps=120)["trainer"]
    assert plain["curriculum"]["objective"]["force"] == steps
    both = run_by("max_epochs", devices=2, max_epochs=9)
    with pytest.raises(ConfigError, match=r"another length: give trainer\.max_steps="):
        change_run(both, run_by("max_epochs"), state)
    moved = run_by("max_steps", precision="32", accelerator="auto")  # another kind of device
    assert change_run(moved, run_by("max_steps"), state)
    other = run_by("max_steps", strategy="fsdp2")
    with pytest.raises(ConfigError, match=r"length and machine of a run, not trainer\.strategy"):
        change_run(other, run_by("max_steps"), state)


def test_a_rate_is_never_below_0() -> None:
    config = {"lr": 1.0, "weight_decay": 0.0, "betas": (0.9, 0.95), "warmup": 0.1}
    made = build_optimizer([("a", torch.nn.Parameter(torch.zeros(2)))], config, 10, False)
    (_, factor) = made["lr_scheduler"]["scheduler"].lr_lambdas
    assert [factor(step) for step in (9, 10, 11, 50)] == [0.1, 0.0, 0.0, 0.0]


@pytest.mark.slow
def test_a_longer_run_goes_on_where_it_ended(tmp_path: Path) -> None:
    """At a constant rate, 5 and then 4 steps have the bits of 9 steps."""
    one, two = tmp_path / "one", tmp_path / "two"
    words = [*SMALL, "curriculum=constant", "trainer.precision=32", "trainer.max_epochs=-1"]
    words += ["optim.schedule=constant", "optim.warmup=0"]
    assert cli.run([*words, "trainer.max_steps=9", f"hydra.run.dir={one}"]) == 0
    assert cli.run([*words, "trainer.max_steps=5", f"hydra.run.dir={two}"]) == 0
    assert cli.run(["train", f"resume={two}", "trainer.max_steps=9"]) == 0
    states = [read_checkpoint(folder)["state_dict"] for folder in (one, two)]
    assert states[0].keys() == states[1].keys()
    assert all(torch.equal(states[0][key], states[1][key]) for key in states[0])


@pytest.mark.slow
def test_a_run_that_ends_by_its_epochs_gets_more_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*SMALL, "trainer.max_steps=-1", "trainer.max_epochs=1", "batch.size=4"]
    assert cli.run([*words, f"hydra.run.dir={tmp_path}"]) == 0
    epoch = read_checkpoint(tmp_path)["global_step"]
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=999"]) == 1
    assert "ends by trainer.max_epochs=1: give another" in capsys.readouterr().err
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_epochs=2"]) == 0
    end = read_checkpoint(tmp_path)
    assert (end["global_step"], end["total"], end["epoch_steps"]) == (2 * epoch, 2 * epoch, epoch)
    by_steps = [*SMALL, "trainer.max_steps=2", "trainer.max_epochs=-1", "batch.size=4"]
    assert cli.run([*by_steps, f"hydra.run.dir={tmp_path}/steps"]) == 0
    assert read_checkpoint(tmp_path / "steps")["epoch_steps"] == epoch


@pytest.mark.slow
def test_an_epoch_of_the_curriculum_is_one_of_the_data(tmp_path: Path) -> None:
    """Also of a run with fewer steps than its epochs."""
    words = [
        *SMALL,
        "trainer.max_steps=3",
        "trainer.max_epochs=10",
    ]
    words += ["trainer.limit_train_batches=4", "trainer.accumulate_grad_batches=2"]
    assert cli.run([*words, f"hydra.run.dir={tmp_path}"]) == 0
    end = read_checkpoint(tmp_path)
    assert (end["global_step"], end["total"], end["epoch_steps"]) == (3, 3, 2)


@pytest.mark.slow
def test_epochs_that_are_limited_are_all_as_long(tmp_path: Path) -> None:
    words = [*SMALL, "batch.size=4", "trainer.max_steps=-1", "trainer.max_epochs=3"]
    words += ["trainer.limit_train_batches=5", "trainer.val_check_interval=1.0"]
    words += ["trainer.check_val_every_n_epoch=1", "trainer.log_every_n_steps=1"]
    assert cli.run([*words, f"hydra.run.dir={tmp_path}"]) == 0
    metrics = read_metrics(tmp_path)
    assert metrics["train/loss"].steps.tolist() == list(range(15))
    assert metrics["val/pixel"].steps.tolist() == [4, 9, 14]


@pytest.mark.parametrize("limit", ["0", "1.5", "all"])
def test_a_limit_that_is_none_is_named(limit: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([*SMALL, f"trainer.limit_train_batches={limit}"]) == 1
    assert "limit_train_batches" in capsys.readouterr().err


def test_an_epoch_of_half_a_step_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    words = [*SMALL, "trainer.limit_train_batches=5", "trainer.accumulate_grad_batches=2"]
    assert cli.run(words) == 1
    assert "give a multiple of 2" in capsys.readouterr().err


def noise(sensor: str, number: int) -> Packed:
    """A blank recording of a second."""
    frames = np.random.default_rng(number).integers(0, 255, (12, 32, 32, 3)).astype(np.uint8)
    recording = Recording(
        key=f"{sensor}-{number}",
        sensor=sensor,
        frames=ArrayFrames(frames),
        times=np.arange(12) / 12,
        no_contact=None,
    )
    pictures = [encode_image(one, "png") for one in frames]
    return Packed(describe_recording(recording), "png", pictures, [], [])


@pytest.mark.slow
def test_sensors_keep_their_rows_in_a_run_that_starts_from_another(tmp_path: Path) -> None:
    """The second run has a sensor with a name before the first run's."""
    words = ["scale=demo", "encoder.depth=1", "encoder.image_size=32", "objective=[pixel]"]
    words += ["data=shards", "batch.size=4", "batch.workers=0", "trainer.max_steps=1"]
    words += ["trainer.limit_val_batches=0"]
    runs = []
    for name, sensors in (("a", ["serial_array"]), ("b", ["serial_array", "camera"])):
        root = tmp_path / f"shards_{name}"
        write_shard(root / "train-000000.tar", [noise(one, n) for one in sensors for n in range(6)])
        init = [f"init={runs[0]}"] if runs else []
        runs.append(tmp_path / name)
        train(compose("anytouch2", [*words, f"data.root={root}", *init]), runs[-1])
    before, after = (run_folder.read_config(run)["encoder"]["sensors"] for run in runs)
    assert before == {key: after[key] for key in before}
    assert set(after) - set(before) == {"camera"}


def test_the_folders_of_data_are_found_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    sources = {"x": {"name": "shards", "root": "a"}, "y": {"root": "hf://b/c"}}
    found = run_folder.anywhere({"root": None, "cache": "nowhere", "sources": sources})
    assert found["sources"]["x"] == {"name": "shards", "root": str(tmp_path / "a")}
    assert found["sources"]["y"] == {"root": "hf://b/c"}
    assert found["cache"] == "nowhere"


@pytest.mark.slow
def test_a_run_keeps_the_place_that_its_data_moved_to(tmp_path: Path) -> None:
    """Also where nothing else changes, so that the next command finds the data."""
    old, new, run = tmp_path / "old", tmp_path / "new", tmp_path / "run"
    write_shard(old / "train-000000.tar", [noise("digit", n) for n in range(6)])
    words = [word for word in SMALL[1:] if not word.startswith("data.")]
    train(compose("anytouch2", [*words, "data=shards", f"data.root={old}"]), run)
    old.rename(new)
    assert cli.run(["train", f"resume={run}", f"data.root={new}"]) == 0
    assert run_folder.read_config(run)["data"]["root"] == str(new)
    assert cli.run(["train", f"resume={run}"]) == 0


def test_a_folder_of_runs_and_a_slip_of_best_are_named(tmp_path: Path) -> None:
    for name in ("0", "1"):
        run_folder.write_config(tmp_path / "sweep" / name, {"run": name})
    sweep = tmp_path / "sweep"
    with pytest.raises(DataError, match=f"such as {sweep / '0'} .2 in {sweep}"):
        run_folder.read_config(sweep)
    with pytest.raises(DataError, match=f"@bset names no weights of {sweep / '1'}: @best does"):
        run_folder.read_config(sweep / "1@bset")
    for nowhere in (tmp_path / "no", tmp_path / "no@best", tmp_path / "@best"):
        with pytest.raises(DataError, match=r"there; give the folder of a run$"):
            run_folder.read_config(nowhere)
