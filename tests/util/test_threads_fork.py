"""Products of matrices in a process that was forked after some in its parent."""

import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing as mp
import torch
from tactileforge.util.threads import usable_after_fork

torch.set_num_threads(2)
if {usable}:
    usable_after_fork()
    usable_after_fork()
a = torch.ones(600, 600)
first = (a @ a)[0, 0].item()

def child(queue):
    queue.put(((a @ a)[0, 0].item(), torch.get_num_threads()))

queue = mp.get_context("fork").Queue()
process = mp.get_context("fork").Process(target=child, args=(queue,))
process.start()
try:
    print(first, *queue.get(timeout={seconds}))
except Exception:
    print("nothing")
process.kill()
print("parent", torch.get_num_threads())
"""


@pytest.mark.slow
def test_a_forked_child_computes_with_one_thread() -> None:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(usable=True, seconds=100)],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert run.stdout.splitlines() == ["600.0 600.0 1", "parent 2"], run.stderr
