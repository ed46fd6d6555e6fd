from pathlib import Path

import pytest
from dataset_fixtures import conforms, make_image, make_images, make_video, write  # noqa: F401
from made_sets import MADE
from shared_fixtures import *  # noqa: F403


@pytest.fixture
def make(tmp_path):
    """Writes a small data set of a form; its folder is named after it."""

    def write_set(name: str) -> Path:
        root = tmp_path / name
        root.mkdir()
        return MADE[name](root)

    return write_set
