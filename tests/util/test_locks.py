"""Locks held for the life of their process."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tactileforge.errors import ConfigError
from tactileforge.util.locks import is_locked, locked

HOLD = """
import os, sys, time
from pathlib import Path
from tactileforge.util.locks import locked
with locked(Path(sys.argv[1])):
    if not (child := os.fork()):
        time.sleep(600)  # a worker that outlives it
    print(child, flush=True)
    time.sleep(600)
"""


def test_one_that_is_killed_holds_nothing_though_its_worker_lives(tmp_path: Path) -> None:
    path = tmp_path / "a" / "lock"
    command = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        worker = int(holder.stdout.readline())
        assert is_locked(path)
        said = rf"held by {holder.pid} on {os.uname().nodename}; go"
        with pytest.raises(ConfigError, match=said), locked(path, "held by {holder}; go"):
            pass
        holder.kill()
    assert not is_locked(path)
    with locked(path, "held"):
        pass
    os.kill(worker, signal.SIGKILL)


def test_the_process_itself_cannot_hold_it_twice_and_looking_frees_nothing(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with locked(path, "held"):
        assert is_locked(path)
        with pytest.raises(ConfigError, match="held"), locked(path, "held"):
            pass
        look = "import sys; from pathlib import Path; "
        look += "from tactileforge.util.locks import is_locked; "
        look += "sys.exit(is_locked(Path(sys.argv[1])))"
        assert subprocess.run([sys.executable, "-c", look, str(path)]).returncode == 1
    assert not is_locked(path)


def test_without_words_it_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    hold = HOLD.replace("not (child := os.fork())", "not (child := 1)")
    wait = "import sys; from pathlib import Path; from tactileforge.util.locks import locked\n"
    wait += "with locked(Path(sys.argv[1])): print('mine')"
    first, then = ([sys.executable, "-c", code, str(path)] for code in (hold, wait))
    with subprocess.Popen(first, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with subprocess.Popen(then, stdout=subprocess.PIPE) as waiting:
            time.sleep(0.5)
            assert waiting.poll() is None
            holder.kill()
            assert waiting.communicate(timeout=60)[0] == b"mine\n"


def test_there_is_none_where_there_is_no_file(tmp_path: Path) -> None:
    assert not is_locked(tmp_path / "lock")
