"""Signals to end a run: as an event, as an interrupt, and in forked processes."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import signalled

from tactileforge import cli
from tactileforge.runs.folder import LAST
from tactileforge.util.signals import ENDING, interrupted_by_signals, stopped_by_signals


@pytest.mark.parametrize("number", ENDING)
def test_an_event_is_set_and_the_second_ends_at_once(number: signal.Signals) -> None:
    before = [signal.getsignal(one) for one in ENDING]
    with stopped_by_signals() as stop:
        os.kill(os.getpid(), number)
        assert stop.wait(60)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert [signal.getsignal(one) for one in ENDING] == before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_listens_to_nothing_says_what_stopped_it(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def dispatch(verb: str, rest: object) -> int:
        os.kill(os.getpid(), number)
        return 0

    monkeypatch.setattr(cli, "dispatch", dispatch)
    assert cli.run(["sim", "n=2"]) == 130
    said = capsys.readouterr().err
    assert said == f"stopped by {number.name}; go on with: the same command again\n"


@pytest.mark.parametrize("number", [errno.EACCES, errno.EROFS, errno.EPERM, errno.ENOSPC])
def test_an_output_that_cannot_be_written_is_a_line(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def dispatch(verb: str, rest: object) -> int:
        raise OSError(number, os.strerror(number), "/runs/a/.lock")

    monkeypatch.setattr(cli, "dispatch", dispatch)
    assert cli.run(["train", "hydra.run.dir=/runs/a"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: /runs/a/.lock: ")
    assert os.strerror(number) in line


def test_what_is_ignored_stays_so() -> None:
    """As `nohup` starts a command."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupted_by_signals(), stopped_by_signals() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_forked_process_ends_by_the_signal() -> None:
    with interrupted_by_signals():
        child = multiprocessing.get_context("fork").Process(target=time.sleep, args=(600,))
        child.start()
        child.terminate()
        child.join(60)
    assert child.exitcode == -signal.SIGTERM


@pytest.mark.parametrize("number", ENDING)
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.parametrize("how", ["main", "nested"])
def test_a_worker_ends_with_its_parent_and_by_no_signal(
    number: signal.Signals, method: str, how: str
) -> None:
    """A signal that is pending while it starts would hide one of the parent: it was never ended."""
    words = [sys.executable, signalled.__file__, how, method, str(int(number))]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    with pytest.raises(ProcessLookupError):
        os.kill(int(done.stdout), 0)


@pytest.mark.parametrize("kept", [False, True])
def test_train_says_what_was_saved(
    kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stopped while data is read, and after its checkpoint was written."""
    run = tmp_path / "my run"

    def stopped(config: object, folder: Path) -> None:
        if kept:
            (folder / LAST).parent.mkdir(parents=True)
            (folder / LAST).touch()
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr("tactileforge.api.train", stopped)
    assert cli.run(["train", "scale=demo", f"hydra.run.dir='{run}'"]) == 130
    said = capsys.readouterr().err.splitlines()[-1]
    again = f"tactileforge train 'resume={run}'" if kept else "the same command again"
    what = "" if kept else " before the first step; nothing was saved"
    assert said == f"stopped by SIGTERM{what}; go on with: {again}"


LEFT = """
import atexit, sys, time
from tactileforge import cli
from tactileforge.errors import SensorError
from tactileforge.sensors import opening

def dispatch(verb, rest):
    opening.within(0.1, "digit: open()", lambda: time.sleep(600))

atexit.register(print, "taken down")
cli.dispatch = dispatch
sys.argv = ["tactileforge", "record"]
cli.main()
"""


def test_a_driver_that_hangs_does_not_take_the_exit_status_with_it() -> None:
    """Its native code must not see the interpreter taken down."""
    done = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "error: digit: open() of its driver has not returned within 0.1 s" in done.stderr
    assert "taken down" not in done.stdout
