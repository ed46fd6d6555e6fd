"""Loader of batches in processes of their own; resumed at any step."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from hashlib import sha256
from itertools import count
from multiprocessing import (
    current_process,
    get_all_start_methods,
    get_context,
    get_start_method,
    set_start_method,
)
from multiprocessing.context import BaseContext
from typing import Any, TypeVar

import cv2
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader

from tactileforge.contracts import Batch
from tactileforge.data.batches.handover import Packing, Readers, received
from tactileforge.data.batches.stream import BatchIndexSampler, Stream
from tactileforge.errors import ConfigError
from tactileforge.util.distributed import world
from tactileforge.util.processes import end_worker_with_main
from tactileforge.util.signals import leave_to_parent

log = logging.getLogger(__name__)

T = TypeVar("T")

#: Keys that may differ on another machine.
_MACHINE = ("workers", "processes")


class Loader(DataLoader[Batch]):
    """Data loader, resumable at any step.

    Its position is that of the run (see `stream.BatchIndexSampler`). Its state holds the numbers
    that decide the batches, so that a resumed run can check them.

    Attributes:
        waited: Seconds spent waiting for batches so far.
        prepare: Function of a batch and its number in the pass, for a loop without a trainer,
            whose data module prepares batches itself; None with one.
        readers: The reading processes.
    """

    waited = 0.0
    prepare: Callable[[Batch, int], Batch] | None = None
    readers = Readers(0)

    @classmethod
    def of(cls, stream: Stream, numbers: BatchIndexSampler, workers: int) -> Loader:
        """Build a loader of the batches of a stream.

        Args:
            stream: Batches by number.
            numbers: Sampler of the numbers.
            workers: Reading processes; 0 reads in this one, as does a daemon process.
        """
        if workers and current_process().daemon:
            log.warning("batch.workers=%d: this process may start no others, so it reads", workers)
            workers = 0
        readers = Readers(workers, _context(workers))
        loader = cls(
            stream,
            batch_size=None,
            sampler=numbers,
            collate_fn=Packing(_identity),
            num_workers=workers,
            multiprocessing_context=readers.context,
            persistent_workers=workers > 0,
            pin_memory=torch.cuda.is_available(),
            worker_init_fn=start_worker,
        )
        loader.readers = readers
        return loader

    def __iter__(self) -> Iterator[Batch]:  # type: ignore[override]
        """Batches, in order.

        Raises:
            TactileForgeError: See `handover.received`.
        """
        return self._timed(received(super().__iter__, self.readers))

    def _timed(self, batches: Iterator[Batch]) -> Iterator[Batch]:
        for number in count():
            start = time.perf_counter()
            batch = next(batches, None)
            self.waited += time.perf_counter() - start
            if batch is None:
                return
            yield batch if self.prepare is None else self.prepare(batch, number)

    def state_dict(self) -> dict[str, Any]:
        """State of the batches: clips, seed, processes and workers, as plain data."""
        stream = self.dataset
        assert isinstance(stream, Stream)
        state = {
            "clips": [round(track.size) for track in stream.tracks],
            "clips of a batch": [2 * stream.n_pairs, *(track.count for track in stream.tracks)],
            "seed": stream.seed,
            "processes": stream.reader.world,
        }
        if any(track.windowed for track in stream.tracks):
            state["workers"] = stream.reader.workers
        else:
            state["recordings"], state["labels"] = self._digests
        return state

    @cached_property  # the recordings stay, and a checkpoint asks for it each time
    def _digests(self) -> tuple[str, str]:
        assert isinstance(self.dataset, Stream)
        return _digests(self.dataset)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Compare with the state of an earlier run; warns of other labels, workers and processes.

        Raises:
            ConfigError: Anything else has changed; the message has both values.
        """
        for key, now in self.state_dict().items():
            if (before := state.get(key)) == now:
                continue
            if key == "recordings":
                raise ConfigError(
                    "resume: the recordings are not those of the run (their names, lengths or "
                    "order have changed), so the run cannot go on with them; give the folder of "
                    "the same data (data.root=), or start a new run from its weights (init=)"
                )
            if key == "labels":
                if before is not None:  # older runs have none
                    log.warning(
                        "resume: the labels of the recordings (forces, times, actions, objects, "
                        "texts or tracks) are not those of the run: it goes on with the new ones, "
                        "and not to the bit as it would have; with the old ones if you put back "
                        "their files"
                    )
                continue
            if key in _MACHINE:
                log.warning(
                    "resume: %s were %s and are %s: the run goes on with other batches of the same "
                    "data, and not to the bit as it would have",
                    key,
                    before,
                    now,
                )
                continue
            raise ConfigError(
                f"resume: {key} was {before} and is {now}; a resumed run goes on with the same "
                "data and batches (init= starts a new run from its weights)"
            )


def _context(workers: int) -> BaseContext | None:
    """Start method of workers: no fork beside the threads of other libraries.

    Gloo, NCCL and Ray have threads. A fork copies their locks in whatever state they are (the
    documentation of ``torch.nn.parallel.DistributedDataParallel`` warns of it), and some runs would
    hang. Processes of joblib have a start method of their own, unknown to their children.
    """
    if not workers:
        return None
    known = get_start_method() in get_all_start_methods()
    # a job of joblib (a sweep) names its start method "loky", which multiprocessing refuses in a
    # child; removable once loky registers it there
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"  # on Windows
    if not known:
        set_start_method(method, force=True)
    ray = sys.modules.get("ray")
    if known and world()[1] == 1 and not (ray and ray.is_initialized()):
        return None
    context = get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([__name__])
    return context


def _digests(stream: Stream) -> tuple[str, str]:
    """Digests of the recordings of the clips: names and lengths, and labels."""
    known, labels = sha256(), sha256()
    for track in stream.tracks:
        for one in getattr(track, "clips").recordings:  # noqa: B009
            known.update(f"{one.key} {len(one.frames)}\n".encode())
            words = (one.sensor, one.object, one.text, sorted(one.labels.items()), [*one.tracks])
            labels.update(repr(words).encode("utf-8", "surrogatepass"))
            for array in (one.times, one.force, one.action, one.image_times, *one.tracks.values()):
                labels.update(b"-" if array is None else _bytes(array))
    return known.hexdigest()[:16], labels.hexdigest()[:16]


def _bytes(array: NDArray[Any]) -> bytes:
    plain = array if array.dtype.hasobject is False else array.astype(str)
    return plain.tobytes()


def _identity(batch: T) -> T:
    return batch


def start_worker(_: int) -> None:
    """Leave signals to the main process, as they reach all of a terminal, and end with it."""
    leave_to_parent()
    end_worker_with_main()
    # every worker would else start a thread a core for each resize
    cv2.setNumThreads(0)
