"""A model in a process forked after its first run, as the workers of a data loader are."""

import multiprocessing as mp
import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing as mp
import numpy as np
import torch
import tactileforge

torch.set_num_threads(2)
model, touch = tactileforge.load("anytouch2.tiny"), tactileforge.sample_touch()
clip = touch.frames.read(range(18, 22))
still = touch.background()
vector = model.encode(clip, still, touch.sensor)

def child(queue):
    queue.put((model.encode(clip, still, touch.sensor).numpy(), torch.get_num_threads()))

queue = mp.get_context("fork").Queue()
process = mp.get_context("fork").Process(target=child, args=(queue,))
process.start()
try:
    found, threads = queue.get(timeout=100)
    print(found.shape, threads, np.allclose(found, vector, rtol=1e-3, atol=1e-4))
except Exception as error:
    print("nothing", repr(error))
process.kill()
"""


@pytest.mark.slow
@pytest.mark.skipif("fork" not in mp.get_all_start_methods(), reason="forks no processes")
def test_a_forked_worker_encodes_after_its_parent() -> None:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=300, check=True
    )
    assert run.stdout.splitlines() == ["(3840,) 1 True"], run.stderr
