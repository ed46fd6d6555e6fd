"""Errors of packing processes."""

import pickle

import pytest

from tactileforge.errors import TactileForgeError
from tactileforge.packing import executors


class OddError(Exception):
    """It cannot be unpickled, so it breaks a pool."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__(f"{file}, line {line}")


def test_an_error_that_cannot_be_unpickled_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(job: bytes, tick: object) -> None:
        raise OddError("a.tar", 3)

    monkeypatch.setattr(executors, "run_packed", fails)
    monkeypatch.setattr(executors, "_done", [0])
    with pytest.raises(TactileForgeError, match=r"OddError: a\.tar, line 3") as caught:
        executors._work(b"")
    assert pickle.loads(pickle.dumps(caught.value)).args == caught.value.args
