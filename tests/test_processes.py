"""Number of processes that work is spread over."""

import os
import subprocess
import sys

import pytest

from tactileforge.processes import process_count

PRINT = "from tactileforge.processes import cpus; print(cpus())"


def test_no_more_than_there_is_work_for_and_as_many_as_are_asked_for() -> None:
    assert process_count(3, asked=8) == 3
    assert process_count(8, asked=3) == 3
    assert process_count(1, asked=None) == 1


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
