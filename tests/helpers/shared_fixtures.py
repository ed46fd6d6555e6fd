"""Fixtures of several packages: a ``conftest.py`` imports those it offers."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from tactileforge import processes
from tactileforge.contracts import Frames


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Touches simulated by a test are kept for the other tests, and thrown away after them.

    Processes that test side by side have folders of their own in one folder, and share this one.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = tmp_path_factory.getbasetemp().parent / "cache"
    else:
        folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(folder))
        yield


@pytest.fixture(autouse=True, scope="session")
def _one_process() -> Iterator[None]:
    """Processes side by side start no others by themselves: all cores are busy."""
    with pytest.MonkeyPatch.context() as patch:
        if "PYTEST_XDIST_WORKER" in os.environ:
            patch.setattr(processes, "cpus", lambda: 1)
        yield


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def levels() -> Callable[[Frames | None], list[int]]:
    """Reads frames and returns the numbers in them."""

    def read(frames: Frames | None) -> list[int]:
        assert frames is not None
        return [round(float(frame.mean()) / 7) for frame in frames.read(range(len(frames)))]

    return read


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of public recordings; tests that ask for it are skipped where it is absent."""
    beside = Path(__file__).parents[2] / ".." / "shared" / "realdata"
    folder = Path(os.environ.get("TACTILEFORGE_REALDATA", beside)).resolve()
    if not folder.is_dir():
        pytest.skip("no real recordings here: set TACTILEFORGE_REALDATA")
    return folder
