"""A worker signalled during and after its start, in a module importable by its process."""

import multiprocessing
import os
import signal
import sys
import time
from multiprocessing.synchronize import Event

from tactileforge.util.signals import leave_to_parent, signals_held


def read(number: signal.Signals, ready: Event) -> None:
    os.kill(os.getpid(), number)
    leave_to_parent()
    os.kill(os.getpid(), number)
    ready.set()
    time.sleep(600)


def main(method: str, number: str) -> None:
    """Leave a worker behind: its number is printed once it has survived the signals."""
    context = multiprocessing.get_context(method)
    ready = context.Event()
    args = signal.Signals(int(number)), ready
    with signals_held():
        worker = context.Process(target=read, args=args, daemon=True)
        worker.start()
    ready.wait()
    print(worker.pid, flush=True)


def nested(*words: str) -> None:
    """The same in a process of its own, as a job of a sweep: it ends without `atexit`."""
    job = multiprocessing.get_context("spawn").Process(target=main, args=words)
    job.start()
    job.join()


if __name__ == "__main__":
    (main if sys.argv[1] == "main" else nested)(*sys.argv[2:])
