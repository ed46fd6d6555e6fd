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
from tactileforge.data.batches.handover import Packing, Readers, received
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
    readers = Readers(workers)
    loader = DataLoader(
        Batches(),
        None,
        collate_fn=Packing(same),
        num_workers=workers,
        worker_init_fn=start,
        multiprocessing_context=readers.context,
    )
    return list(received(lambda: iter(loader), readers))


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


def refusing(batch):
    raise RuntimeError("in the words of any version of torch")


@pytest.mark.parametrize("free", [0, 4 * 32 - 1])
def test_small_shared_memory_is_said(monkeypatch, free):
    """Less than two readers have under way: two batches of 32 bytes each."""
    monkeypatch.setattr(handover, "ForkingPickler", SimpleNamespace(dumps=refusing))
    room = SimpleNamespace(total=64 << 20, free=free)
    monkeypatch.setattr(handover.shutil, "disk_usage", lambda _: room)
    said = r"^the shared memory of this machine \(/dev/shm, 64 MB\).*2 readers: docker run --shm"
    with pytest.raises(TactileForgeError, match=said):
        read(2)


def killed(_):
    os.kill(os.getpid(), signal.SIGKILL)


def without_room(_):
    os.kill(os.getpid(), signal.SIGBUS)


def ended(_):
    os._exit(3)


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (killed, r"^a process that reads batches was lost \(killed by SIGKILL\), as happens where"),
        (ended, r"^a process that reads batches was lost \(exit status 3\)"),
        (without_room, "^the shared memory of this machine"),
    ],
)
def test_a_reader_that_was_lost_is_said(end, said):
    with pytest.raises(TactileForgeError, match=said):
        read(1, end)


def test_a_reader_that_was_killed_while_others_start_is_said():
    readers = Readers(2)

    def start():
        process = readers.context.Process(target=killed, args=(0,))
        process.start()
        process.join()
        raise RuntimeError("in the words of any version of torch")

    with pytest.raises(TactileForgeError, match=r"was lost \(killed by SIGKILL\)"):
        received(start, readers)


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


def test_the_cause_of_an_error_of_torch_is_asked():
    def start():
        try:
            raise OSError(errno.EMFILE, "in any language")
        except OSError:
            raise RuntimeError("no communication") from None

    with pytest.raises(TactileForgeError, match=r"^too many open files"):
        received(start, Readers(0))
