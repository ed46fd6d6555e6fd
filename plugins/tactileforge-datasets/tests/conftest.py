import os
from pathlib import Path

import pytest
from made_sets import MADE


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory):
    """Puts files of tests in a temporary cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def make(tmp_path):
    """Writes a small data set of a form; its folder is named after it."""

    def write(name: str) -> Path:
        root = tmp_path / name
        root.mkdir()
        return MADE[name](root)

    return write


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of public recordings; tests that ask for it are skipped where it is absent."""
    beside = Path(__file__).parents[3] / ".." / "shared" / "realdata"
    folder = Path(os.environ.get("TACTILEFORGE_REALDATA", beside)).resolve()
    if not folder.is_dir():
        pytest.skip("no real recordings here: set TACTILEFORGE_REALDATA")
    return folder


@pytest.fixture
def levels():
    """Reads frames and returns their numbers."""
    return lambda frames: [round(float(f.mean()) / 7) for f in frames.read(range(len(frames)))]
