"""Number of processes for spreading work."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_until

from tactileforge.errors import ConfigError
from tactileforge.util.processes import process_count, run_program, with_this_process

PRINT = "from tactileforge.util.processes import cpus; print(cpus())"


def test_no_more_than_there_is_work_for_and_as_many_as_are_asked_for() -> None:
    assert process_count(3, asked=8) == 3
    assert process_count(8, asked=3) == 3
    assert process_count(1, asked=None) == 1
    for asked in (0, -3):
        with pytest.raises(ConfigError, match=f"processes={asked}: give 1 or more, or null"):
            process_count(3, asked=asked)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system pins no process")
def test_a_scheduler_that_gives_one_core_is_asked_for_no_more() -> None:
    core = min(os.sched_getaffinity(0))
    said = subprocess.run(
        [sys.executable, "-c", f"import os; os.sched_setaffinity(0, [{core}]); {PRINT}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout == "1\n"


CHILD = (
    "import os, sys, time; from tactileforge.util.processes import end_with_parent\n"
    "end_with_parent()\n"
    "print(os.getpid(), flush=True)\n"
    "while True: time.sleep(1)"
)
PARENT = (
    "import subprocess, sys; from tactileforge.util.processes import with_this_process\n"
    f"subprocess.run([sys.executable, '-c', {CHILD!r}], env=with_this_process())"
)


def test_a_child_ends_with_its_parent_however_that_ends() -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert _runs(child)
        parent.send_signal(signal.SIGKILL)
        wait_until(lambda: not _runs(child), 60)


#: Two workers of a forkserver, as a training with several processes reads with.
WORKERS = """
import multiprocessing, os, time
from tactileforge.data.batches.loader import start_worker

def work(said):
    start_worker(0)
    said.put(os.getpid())
    while True: time.sleep(1)

if __name__ == "__main__":
    context = multiprocessing.get_context("forkserver")
    said = context.Queue()
    for _ in range(2):
        context.Process(target=work, args=(said,), daemon=True).start()
    print(said.get(), said.get(), flush=True)
    time.sleep(600)
"""


@pytest.mark.slow
def test_workers_of_a_forkserver_end_with_the_process_that_is_killed(tmp_path: Path) -> None:
    """And the forkserver after them."""
    (tmp_path / "main.py").write_text(WORKERS)
    with subprocess.Popen(
        [sys.executable, "main.py"], cwd=tmp_path, stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2
        left = [*workers, _parent(workers[0])]
        assert all(map(_runs, left))
        parent.send_signal(signal.SIGKILL)
        wait_until(lambda: not any(map(_runs, left)), 60)


def _parent(process: int) -> int:
    with open(f"/proc/{process}/stat") as file:
        return int(file.read().rpartition(")")[2].split()[1])


def _runs(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_program_is_shown_and_its_last_words_are_kept(capfd: pytest.CaptureFixture[str]) -> None:
    code = "import sys; print('out'); sys.exit('error: no')"
    assert run_program([sys.executable, "-c", code]) == (1, "error: no\n")
    assert "error: no" in capfd.readouterr().err
    assert with_this_process()["TACTILEFORGE_PARENT"] == str(os.getpid())
