"""Batches of reading processes: whole, or an error in one line, never a wait for ever."""

import errno
import os
import resource
import signal
from types import SimpleNamespace

import pytest
import torch
from torch.utils.data import DataLoader

from tactileforge.data.batches import handover
from tactileforge.data.batches.handover import Packing, received
from tactileforge.errors import DataError, TactileForgeError
from tactileforge.util.files import disk_errors_named, unwritable


class Batches(torch.utils.data.Dataset):
    """Batches of two tensors and names."""

    def __len__(self):
        return 4

    def __getitem__(self, number):
        return {"clip": torch.full((2, 3), number), "row": torch.ones(2), "key": ["a", "b"]}


def same(batch):
    return batch


def read(workers, start=None):
    loader = DataLoader(
        Batches(), None, collate_fn=Packing(same), num_workers=workers, worker_init_fn=start
    )
    return list(received(lambda: iter(loader), workers))


@pytest.mark.parametrize("workers", [0, 2])
def test_batches_come_whole_and_in_order(workers):
    found = read(workers)
    assert [batch["clip"].tolist() for batch in found] == [[[n] * 3] * 2 for n in range(4)]
    assert {tuple(batch["key"]) for batch in found} == {("a", "b")}
    assert all(batch["clip"].is_shared() for batch in found) == (workers > 0)


def few_files(_):
    """A few more open files than there are now."""
    most = len(os.listdir("/dev/fd")) + 9
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def test_too_many_open_files_are_said():
    with pytest.raises(TactileForgeError, match=r"^too many open files .*ulimit -n 4096 first, or"):
        read(1, few_files)


def test_small_shared_memory_is_said(monkeypatch):
    def full(batch):
        raise RuntimeError(
            "unable to allocate shared memory(shm) for file </torch_1_2_0>: No space left on device"
        )

    monkeypatch.setattr(handover, "ForkingPickler", SimpleNamespace(dumps=full))
    said = r"^the shared memory of this machine \(/dev/shm.*2 readers: docker run --shm-size=8g"
    with pytest.raises(TactileForgeError, match=said):
        read(2)


def killed(_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_reader_that_was_killed_is_said():
    said = r"^a process that reads batches was lost \((killed by signal: Killed|exited unexpec)"
    with pytest.raises(TactileForgeError, match=said):
        read(1, killed)


def test_a_reader_that_was_killed_while_others_start_is_said():
    def start():
        raise RuntimeError("DataLoader worker (pid 7) is killed by signal: Killed.")

    with pytest.raises(TactileForgeError, match=r"^a process that reads batches was lost \(killed"):
        received(start, 2)


def test_other_errors_stay_as_they_are(monkeypatch):
    def broken(batch):
        raise RuntimeError("not of the machine")

    monkeypatch.setattr(handover, "ForkingPickler", SimpleNamespace(dumps=broken))
    with pytest.raises(RuntimeError, match="not of the machine"):
        read(1)


def test_files_that_cannot_be_opened_are_no_full_disk(tmp_path):
    error = OSError(errno.EMFILE, "Too many open files", "a.tar")
    assert unwritable(error).startswith("too many open files (")
    with (
        pytest.raises(DataError, match="too many open files") as caught,
        disk_errors_named(tmp_path),
    ):
        raise error
    assert "make room" not in str(caught.value)
