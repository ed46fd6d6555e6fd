import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.sparsh_force import SparshForce

from tactileforge.errors import ConfigError, DataError

Make = Callable[..., Any]


def trajectory(first: int, count: int, extra: int = 0, sign: float = 1) -> dict[str, Any]:
    """Images ``first..`` with rising forces; with ``extra`` images beyond the forces."""
    force = np.linspace([0, 0, 0], [0.5, -0.5, 2.0 * sign], count)
    return {
        "indexes": np.arange(first, first + count + extra),
        "forces": force,
        "slip_label": (np.arange(count) >= count // 2).astype(int),
        "poses": np.zeros((count, 7)),
        "coef_friction": 0.4,
    }


@pytest.fixture
def batch(tmp_path: Path, encoded: Make) -> Make:
    """Writes a batch of 30 images in files of ten; the first three are in the air."""

    def make(name: str, sensor: str = "digit", sign: float = 1, **more: Any) -> Path:
        folder = tmp_path / name
        folder.mkdir(parents=True)
        for k in range(3):
            images = [encoded(i, **more) for i in range(10 * k, 10 * k + 10)]
            (folder / f"dataset_{sensor}_{k:02d}.pkl").write_bytes(pickle.dumps(images))
        (folder / f"org_dataset_{sensor}_00.pkl").write_bytes(b"the same once more")
        trajectories = {0: trajectory(5, 8, sign=sign), 1: trajectory(15, 6, 5, sign)}
        labels = {"in_contact": np.arange(30) >= 3, "trajectories": trajectories}
        (folder / "dataset_slip_forces.pkl").write_bytes(pickle.dumps(labels))
        return folder

    return make


def test_trajectories(tmp_path: Path, batch: Make, levels: Make) -> None:
    batch("sphere/batch_1")
    first, second = SparshForce(str(tmp_path), val=0).recordings("train")
    assert (first.key, first.object) == ("sparsh_force/sphere/batch_1/0", "sparsh_sphere")
    assert levels(first.frames) == list(range(5, 13)), "across the files"
    assert levels(first.no_contact) == [0], "the first image that is not in contact"
    assert first.force is not None
    assert first.force.dtype == np.float32
    np.testing.assert_allclose(first.force[-1], [0.5, -0.5, 2])
    np.testing.assert_allclose(first.times, np.arange(8) / 30)
    assert levels(second.frames) == list(range(15, 21)), "images without a force are left out"
    np.testing.assert_allclose(second.force[-1], [0.5, -0.5, 2])  # type: ignore[index]


def test_pressing_is_positive(tmp_path: Path, batch: Make) -> None:
    batch("sphere/batch_1", sign=-1)
    for recording in SparshForce(str(tmp_path), val=0).recordings("train"):
        assert recording.force is not None
        np.testing.assert_allclose(recording.force[-1], [0.5, -0.5, 2])


@pytest.mark.parametrize(
    ("sensor", "name", "is_rgb"),
    [
        ("digit", "sphere/batch_1", True),
        ("digit", "sphere2/batch_1", False),
        ("gelsight_mini", "sphere/batch_1", False),
        ("gelsight_mini", "sharp/batch_2", True),
    ],
)
def test_channels_and_orientation(
    tmp_path: Path, batch: Make, sensor: str, name: str, is_rgb: bool
) -> None:
    batch(name, sensor.split("_")[0], colour=(10, 20, 200))
    recording = next(iter(SparshForce(str(tmp_path), sensor, "all", val=0).recordings("train")))
    assert recording.sensor == sensor
    assert recording.frames.shape == ((32, 24) if sensor == "digit" else (24, 32)), (
        "DIGIT lies on a side"
    )
    want = [10, 20, 200] if is_rgb else [200, 20, 10]
    assert recording.frames.read([0])[0, 3, 3].tolist() == want
    assert recording.no_contact is not None
    assert recording.no_contact.read([0])[0, 3, 3].tolist() == want


def test_splits(tmp_path: Path, batch: Make) -> None:
    for name in (
        "sphere/batch_1",
        "sphere/batch_2",
        "sharp/batch_2",
        "flat/batch_1",
        "flat/batch_2",
    ):
        batch(name)
    found = {}
    for split in ("sparsh-official", "anytouch2-port"):
        data = SparshForce(str(tmp_path), split=split, val=0)
        for side in ("train", "test"):
            keys = [recording.key.split("/", 1)[1] for recording in data.recordings(side)]
            found[split, side] = {key.rpartition("/")[0] for key in keys}
    assert found == {
        ("sparsh-official", "train"): {"sphere/batch_1", "flat/batch_2"},
        ("sparsh-official", "test"): {"flat/batch_1"},
        ("anytouch2-port", "train"): {"sphere/batch_2", "sharp/batch_2"},
        ("anytouch2-port", "test"): {"flat/batch_1"},
    }
    with pytest.raises(ConfigError, match="unknown sensor 'gelsight'"):
        SparshForce(".", sensor="gelsight")


def test_a_batch_that_would_run_something_is_left_out(tmp_path: Path, batch: Make) -> None:
    batch("sphere/batch_1")
    bad = b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x04true\x85R."
    (batch("sharp/batch_1") / "dataset_slip_forces.pkl").write_bytes(bad)
    (batch("flat/batch_2") / "dataset_digit_01.pkl").write_bytes(bad)
    data = SparshForce(str(tmp_path), val=0)
    assert {recording.object for recording in data.recordings("train")} == {"sparsh_sphere"}
    assert len(data.skipped) == 2
    assert all("it asks for os.system" in line for line in data.skipped)


def test_damage_is_named(tmp_path: Path, batch: Make) -> None:
    (batch("sphere/batch_1") / "dataset_digit_02.pkl").unlink()
    labels = {
        "in_contact": np.ones(30),
        "trajectories": {
            0: trajectory(5, 8) | {"forces": np.full((8, 3), np.nan)},
            1: trajectory(5, 8) | {"indexes": np.array([7, 6, 5, 4, 3, 2, 1, 0])},
            2: {"forces": np.zeros((8, 3))},
            3: trajectory(4, 3),
        },
    }
    path = batch("sharp/batch_1") / "dataset_slip_forces.pkl"
    path.write_bytes(pickle.dumps(labels))
    data = SparshForce(str(tmp_path), val=0)
    by_key = {recording.key: recording for recording in data.recordings("train")}
    assert sorted(by_key) == ["sparsh_force/sharp/batch_1/3", "sparsh_force/sphere/batch_1/0"]
    assert by_key["sparsh_force/sharp/batch_1/3"].no_contact is None, "always in contact"
    assert len(data.skipped) == 4
    assert "20 images of digit, but dataset_slip_forces.pkl names image 20" in data.skipped[-1]
    path.write_bytes(pickle.dumps([1]))
    (tmp_path / "sphere/batch_1/dataset_slip_forces.pkl").unlink()
    with pytest.raises(DataError, match="no in_contact and trajectories"):
        list(SparshForce(str(tmp_path), val=0).recordings("train"))


def test_conformance(tmp_path: Path, batch: Make, conforms: Make) -> None:
    for name in ("sphere/batch_1", "sharp/batch_1"):
        batch(name)
    conforms(SparshForce, root=str(tmp_path), val=0.3)


def test_one_force_that_is_no_number_does_not_turn_the_others(tmp_path: Path, batch: Make) -> None:
    path = batch("sphere/batch_1", sign=-1) / "dataset_slip_forces.pkl"
    labels = pickle.loads(path.read_bytes())
    labels["trajectories"][1]["forces"][3, 2] = np.nan
    path.write_bytes(pickle.dumps(labels))
    (recording,) = SparshForce(str(tmp_path), val=0).recordings("train")
    np.testing.assert_allclose(recording.force[-1], [0.5, -0.5, 2])  # type: ignore[index]
