"""A worker signalled during and after its start, in a module importable by its process."""

import os
import signal
import time
from multiprocessing.synchronize import Event

from tactileforge.signals import leave_to_parent


def read(number: signal.Signals, ready: Event) -> None:
    os.kill(os.getpid(), number)
    leave_to_parent()
    os.kill(os.getpid(), number)
    ready.set()
    time.sleep(600)
