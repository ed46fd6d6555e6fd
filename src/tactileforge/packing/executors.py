"""Executors: this process, several on this machine, or a Ray cluster.

Each gives the same bytes. A process that dies loses one shard, and the shard is tried once more.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any, TypeAlias

import cv2

from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.packing.work import ShardJob, ShardNote, make_shard, packed_job, run_packed
from tactileforge.util.origin import install_extra
from tactileforge.util.processes import end_worker_with_main, process_count
from tactileforge.util.signals import leave_to_parent, signals_held

#: Callback with the number of a job and the number of its finished frames.
Tick: TypeAlias = Callable[[int, int], None]
#: Jobs with the notes of their shards.
Made: TypeAlias = Generator[tuple[ShardJob, ShardNote], None, None]
#: Seconds between updates of the progress.
_LOOK = 0.2


def execute(jobs: Sequence[ShardJob], executor: str, processes: int | None, tick: Tick) -> Made:
    """Make shards; yields each when it is whole.

    Closing the iterator stops the work.

    Args:
        jobs: Shards to make.
        executor: Name of the executor, one of `options.EXECUTORS`.
        processes: Number of processes; None for one per core.
        tick: Callback for the progress.

    Raises:
        OSError: A shard cannot be written.
        TactileForgeError: A process died twice while making one shard.
        ConfigError: Ray is not installed.
    """
    count = process_count(len(jobs), processes)
    if executor == "ray" and jobs:
        return _on_ray(jobs, processes, tick)
    # one process is this one: a data set that cannot be pickled is packed all the same
    return (
        _local(jobs, count, tick) if count > 1 else ((job, make_shard(job, tick)) for job in jobs)
    )


def _local(jobs: Sequence[ShardJob], count: int, tick: Tick) -> Made:
    """Make shards in pools of one process each.

    ``ProcessPoolExecutor`` breaks as a whole when a process dies, and does not say which of its
    jobs that process had. With one process a pool, it is known.
    """
    context = multiprocessing.get_context("spawn")  # a fork would copy the threads' locks
    done = context.RawArray("q", 1 + max(job.number for job in jobs))

    def pool() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, context, _prepare, (done,))

    others = set(multiprocessing.active_children())
    waiting, died = deque(jobs), set()
    idle = [pool() for _ in range(count)]
    busy: dict[Future[ShardNote], tuple[ProcessPoolExecutor, ShardJob]] = {}
    try:
        while waiting or busy:
            while waiting and idle:
                # pickled here, before a process is taken: an error names the shard
                content = packed_job(waiting[0])
                worker, job = idle.pop(), waiting.popleft()
                # the first job of a pool starts its process, and a signal meanwhile would end it
                with signals_held():
                    busy[worker.submit(_work, content)] = worker, job
            for future in wait(busy, _LOOK, FIRST_COMPLETED).done:
                worker, job = busy.pop(future)
                try:
                    note = future.result()
                except BrokenProcessPool as error:
                    worker.shutdown()
                    # once may be bad luck (memory taken by others), twice is this shard
                    if job.number in died:
                        raise _dead(job) from error
                    died.add(job.number)
                    waiting.appendleft(job)
                    idle.append(pool())
                else:
                    idle.append(worker)
                    yield job, note
            for _, job in busy.values():
                tick(job.number, done[job.number])
    finally:
        if busy:  # shutdown would wait for jobs nobody needs any more
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.shutdown()


def _dead(job: ShardJob) -> TactileForgeError:
    return TactileForgeError(
        f"{job.path}: the process that made it was killed, twice (out of memory? what it said is "
        f"above). It holds {job.recordings[0].key} and {len(job.recordings) - 1} more. The other "
        "shards are kept: run the same command again with fewer pack.processes"
    )


_done: Any = None


def _prepare(done: Any) -> None:
    """Prepare a process: it ends with its parent, and leaves Ctrl-C to it."""
    global _done
    _done = done
    leave_to_parent()
    cv2.setNumThreads(1)  # there is a process for each core already
    end_worker_with_main()


def _work(job: bytes) -> ShardNote:
    try:
        return run_packed(job, _done.__setitem__)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # the pool would break, and wait for ever for this living process
            raise TactileForgeError(f"{type(error).__name__}: {error}") from None
        raise


def _on_ray(jobs: Sequence[ShardJob], processes: int | None, tick: Tick) -> Made:
    try:
        ray: Any = import_module("ray")
    except ImportError as error:
        raise ConfigError(f"pack.executor=ray needs Ray: {install_extra('ray')}") from error
    is_ours = not ray.is_initialized()
    if is_ours:
        # Ray reports its use over the network unless it is told not to (docs of Ray, usage stats)
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        here = {} if "RAY_ADDRESS" in os.environ else {"num_cpus": processes}
        ray.init(include_dashboard=False, log_to_driver=False, logging_level="error", **here)
    # one retry, as for processes of this machine; Ray's default is 3
    task = ray.remote(max_retries=1)(_task)
    # a few jobs ahead of the processors, not all: each carries its recordings through Ray's store
    ahead = 2 * int(ray.cluster_resources().get("CPU", 1))
    waiting = deque(jobs)
    busy: dict[Any, ShardJob] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < ahead:
                job = waiting.popleft()
                busy[task.remote(job)] = job
            for reference in ray.wait(list(busy))[0]:
                job = busy.pop(reference)
                try:
                    note = ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from error
                except ray.exceptions.RayError as error:
                    raise _dead(job) from error
                yield job, note
    finally:
        for reference in busy:
            ray.cancel(reference, force=True)
        if is_ours:
            ray.shutdown()


def _task(job: ShardJob) -> ShardNote:
    cv2.setNumThreads(1)  # Ray starts a process for each core
    return make_shard(job)
