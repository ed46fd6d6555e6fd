"""Hand batches over from reading processes, or report a full machine in one line.

Queues of processes send what they are given in a thread of their own: an error there is printed,
the batch is lost, and the receiver waits for it for ever. So a batch is packed before it is queued,
where an error can be sent in its place.
"""

from __future__ import annotations

import os
import pickle
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.reduction import ForkingPickler
from typing import Any

try:
    import resource
except ImportError:  # no POSIX system
    resource = None  # type: ignore[assignment]

import torch
import torch.multiprocessing  # tells ForkingPickler to put tensors into shared memory
from torch.utils.data import get_worker_info

from tactileforge.contracts import Batch
from tactileforge.errors import TactileForgeError, too_many_files
from tactileforge.util.signals import signals_held

#: What an error says where file descriptors, shared memory or a reading process are lacking.
_FILES = re.compile(r"Too many open files|ancdata")
_SHARED = re.compile(r"No space left on device|shared memory|Bus error")
_KILLED = re.compile(r"DataLoader worker .*(killed by signal: \w+|exited unexpectedly)")
_SHM = "/dev/shm"
#: Open files of this process, and descriptors for connections and whatever is read meanwhile.
_OPEN, _SPARE = "/dev/fd", 8


@dataclass(frozen=True)
class PackedBatch:
    """A batch on its way between processes.

    Attributes:
        content: The batch, pickled; its tensors lie in shared memory.
        lost: Why it could not be packed; "" for a batch.
    """

    content: bytes = b""
    lost: str = ""

    def unpacked(self) -> Batch:
        """The batch; it is to be unpacked once.

        Raises:
            TactileForgeError: It could not be packed.
            OSError: There are no file descriptors left.
        """
        if self.lost:
            raise TactileForgeError(self.lost)
        batch: Batch = pickle.loads(self.content)  # of a process of this run
        return batch

    def pin_memory(self) -> Any:
        """The batch with its tensors in pinned memory; called by torch's thread."""
        if self.lost:
            return self
        return {
            key: value.pin_memory() if isinstance(value, torch.Tensor) else value
            for key, value in self.unpacked().items()
        }


class Packing:
    """A function for batches, packing them in reading processes.

    Args:
        collate: Function of rows, that makes a batch.
    """

    def __init__(self, collate: Callable[[Any], Batch]) -> None:
        self.collate = collate

    def __call__(self, rows: Any) -> Batch | PackedBatch:
        """The batch of rows."""
        batch, worker = self.collate(rows), get_worker_info()
        if worker is None:
            return batch
        if _has_few_files(sum(isinstance(value, torch.Tensor) for value in batch.values())):
            return PackedBatch(lost=_lacking(OSError("Too many open files"), worker.num_workers))
        try:
            return PackedBatch(bytes(ForkingPickler.dumps(batch)))
        except (OSError, RuntimeError) as error:
            if not (why := _lacking(error, worker.num_workers)):
                raise
            return PackedBatch(lost=why)


def _has_few_files(tensors: int) -> bool:
    """Whether a reading process may run out of file descriptors while it hands batches over.

    A tensor in shared memory takes two while it is packed, and one until it is received; two
    batches wait. Without any left, the process could not even answer the one that receives.
    """
    if resource is None or not os.path.isdir(_OPEN):
        return False
    free = resource.getrlimit(resource.RLIMIT_NOFILE)[0] - len(os.listdir(_OPEN))
    return free < 4 * tensors + _SPARE


def received(start: Callable[[], Iterator[Any]], workers: int) -> Iterator[Batch]:
    """Batches of a loader with `Packing`; its reading processes start now, with signals held.

    So a signal meanwhile ends none of them, and with it the run.

    Args:
        start: Starts the iterator of the loader.
        workers: Number of reading processes.

    Raises:
        TactileForgeError: Shared memory, or file descriptors, do not suffice, or a reading process
            was killed; here, or by the iterator.
    """
    with signals_held(), _shortage_said(workers):
        batches = start()
    return _unpacked(batches, workers)


def _unpacked(batches: Iterator[Any], workers: int) -> Iterator[Batch]:
    while True:
        with _shortage_said(workers):
            batch = next(batches, None)
            batch = batch.unpacked() if isinstance(batch, PackedBatch) else batch
        if batch is None:
            return
        yield batch


@contextmanager
def _shortage_said(workers: int) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (why := _lacking(error, workers)):
            raise
        raise TactileForgeError(why) from error


def _lacking(error: Exception, workers: int) -> str:
    """The machine's shortage, with the fix; "" for any other error."""
    said = str(error)
    readers = "1 reader" if workers == 1 else f"{workers} readers"
    if _FILES.search(said):
        return f"{too_many_files()}, or batch.workers=0 needs fewer"
    if _SHARED.search(said):
        try:
            size = f", {shutil.disk_usage(_SHM).total / 2**20:.0f} MB"
        except OSError:
            size = ""
        return (
            f"the shared memory of this machine ({_SHM}{size}) is too small for the batches of "
            f"{readers}: docker run --shm-size=8g, or batch.workers=0"
        )
    if killed := _KILLED.search(said):
        return (
            f"a process that reads batches was lost ({killed[1]}), as happens where memory runs "
            "out: give a smaller batch.size= or fewer batch.workers="
        )
    return ""
