"""The container against the contract, and read as a data set."""

from pathlib import Path

import numpy as np
import pytest
from tactileforge_example.container import NpyFolder

from tactileforge.errors import DataError
from tactileforge.testing import check_container

FRAMES = np.arange(9, dtype=np.uint8)[:, None, None, None] + np.zeros((1, 32, 24, 3), np.uint8)


@pytest.fixture
def take(tmp_path: Path) -> Path:
    """A folder of the format: touch, its times, and forces."""
    folder = tmp_path / "take.npy_folder"
    (folder / "left").mkdir(parents=True)
    np.save(folder / "left/tactile.npy", FRAMES)
    np.save(folder / "left/tactile.times.npy", 5 + np.arange(9) / 25)
    np.save(folder / "force.npy", np.arange(27, dtype=np.float32).reshape(9, 3))
    return folder


def test_conformance(take: Path) -> None:
    results = check_container(NpyFolder(str(take)))
    assert {result.status for result in results} == {"ran"}, results


def test_what_is_read_is_what_was_written(take: Path) -> None:
    container = NpyFolder(str(take))
    assert container.keys() == ["force", "left/tactile", "left/tactile.times"]
    np.testing.assert_array_equal(container.array("left/tactile").rows([7, 2]), FRAMES[[7, 2]])
    np.testing.assert_array_equal(container.frames("left/tactile").read([3]), FRAMES[[3]])
    np.testing.assert_array_equal(container.times("left/tactile"), 5 + np.arange(9) / 25)
    assert container.times("force") is None
    assert container.frames("force") is None


def test_damage_is_named(take: Path) -> None:
    (take / "force.npy").write_bytes(b"no array")
    with pytest.raises(DataError, match=r"force\.npy: cannot be read"):
        NpyFolder(str(take)).array("force")
