from pathlib import Path

import pytest
from made_sets import MADE
from shared_fixtures import _cache, levels, realdata  # noqa: F401


@pytest.fixture
def make(tmp_path):
    """Writes a small data set of a form; its folder is named after it."""

    def write(name: str) -> Path:
        root = tmp_path / name
        root.mkdir()
        return MADE[name](root)

    return write
