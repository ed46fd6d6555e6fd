"""Hand batches over from reading processes, or report a full machine in one line.

Queues of processes send what they are given in a thread of their own: an error there is printed,
the batch is lost, and the receiver waits for it for ever. So a batch is packed before it is queued,
where an error can be sent in its place.
"""

from __future__ import annotations

import os
import pickle
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
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
from tactileforge.util.files import NO_FILES
from tactileforge.util.signals import signals_held

_SHM = "/dev/shm"
#: Batches that a reading process has under way, torch's ``prefetch_factor``.
_AHEAD = 2
#: Exit status after a write to shared memory without room for it.
_BUS = -getattr(signal, "SIGBUS", 0)
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
        tensors = [value for value in batch.values() if isinstance(value, torch.Tensor)]
        if _has_few_files(len(tensors)):
            return PackedBatch(lost=_few_files())
        try:
            return PackedBatch(bytes(ForkingPickler.dumps(batch)))
        except (OSError, RuntimeError) as error:
            if _is_of_files(error):
                return PackedBatch(lost=_few_files())
            needed = _AHEAD * worker.num_workers * sum(tensor.nbytes for tensor in tensors)
            if not os.path.isdir(_SHM) or shutil.disk_usage(_SHM).free >= needed:
                raise
            return PackedBatch(lost=_small_memory(worker.num_workers))


def _has_few_files(tensors: int) -> bool:
    """Whether a reading process may run out of file descriptors while it hands batches over.

    A tensor in shared memory takes two while it is packed, and one until it is received; two
    batches wait. Without any left, the process could not even answer the one that receives.
    """
    if resource is None or not os.path.isdir(_OPEN):
        return False
    free = resource.getrlimit(resource.RLIMIT_NOFILE)[0] - len(os.listdir(_OPEN))
    return free < 4 * tensors + _SPARE


class Readers:
    """The reading processes of a loader, with their ends.

    Attributes:
        context: Context for the loader, which starts them; None where it starts none.
        started: Those it has started.

    Args:
        count: Number of reading processes.
        context: Context to start them by; None for the default.
    """

    def __init__(self, count: int, context: BaseContext | None = None) -> None:
        self.count = count
        self.started: list[BaseProcess] = []
        self.context = copy(context or get_context()) if count else None
        if self.context is not None:
            make: Callable[..., BaseProcess] = self.context.Process  # type: ignore[attr-defined]

            def noted(*given: Any, **named: Any) -> BaseProcess:
                self.started.append(make(*given, **named))
                return self.started[-1]

            self.context.Process = noted  # type: ignore[attr-defined]

    def ends(self) -> Sequence[int]:
        """Nonzero exit statuses; minus the signal number after a signal."""
        return [process.exitcode for process in self.started if process.exitcode]


def received(start: Callable[[], Iterator[Any]], readers: Readers) -> Iterator[Batch]:
    """Batches of a loader with `Packing`; its reading processes start now, with signals held.

    So a signal meanwhile ends none of them, and with it the run.

    Args:
        start: Starts the iterator of the loader.
        readers: Its reading processes.

    Raises:
        TactileForgeError: Shared memory, or file descriptors, do not suffice, or a reading process
            was killed; here, or by the iterator.
    """
    with signals_held(), _shortage_said(readers):
        batches = start()
    return _unpacked(batches, readers)


def _unpacked(batches: Iterator[Any], readers: Readers) -> Iterator[Batch]:
    while True:
        with _shortage_said(readers):
            batch = next(batches, None)
            batch = batch.unpacked() if isinstance(batch, PackedBatch) else batch
        if batch is None:
            return
        yield batch


@contextmanager
def _shortage_said(readers: Readers) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (why := _lacking(error, readers)):
            raise
        raise TactileForgeError(why) from error


def _lacking(error: Exception, readers: Readers) -> str:
    """The machine's shortage, with the fix; "" for any other error."""
    # multiprocessing has no error of its own for descriptors that did not arrive
    if _is_of_files(error) or (readers.count and _has_few_files(0)):
        return _few_files()
    if _BUS in (ends := readers.ends()):
        return _small_memory(readers.count)
    if not ends:
        return ""
    end = f"killed by {signal.Signals(-ends[0]).name}" if ends[0] < 0 else f"exit status {ends[0]}"
    return (
        f"a process that reads batches was lost ({end}), as happens where memory runs out: "
        "give a smaller batch.size= or fewer batch.workers="
    )


def _is_of_files(error: BaseException | None) -> bool:
    """Whether an error, or any in its chain of causes, reports too many open files."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in NO_FILES:
            return True
        error = error.__cause__ or error.__context__
    return False


def _few_files() -> str:
    return f"{too_many_files()}, or batch.workers=0 needs fewer"


def _small_memory(workers: int) -> str:
    readers = "1 reader" if workers == 1 else f"{workers} readers"
    try:
        size = f", {shutil.disk_usage(_SHM).total / 2**20:.0f} MB"
    except OSError:
        size = ""
    return (
        f"the shared memory of this machine ({_SHM}{size}) is too small for the batches of "
        f"{readers}: docker run --shm-size=8g, or batch.workers=0"
    )
