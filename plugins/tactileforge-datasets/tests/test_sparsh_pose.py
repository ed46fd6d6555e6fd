import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.sparsh_pose import SparshPose

from tactileforge.errors import ConfigError

Make = Callable[..., Any]


def bag(path: Path, images: list[bytes], poses: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"digit_ring": images, "object_ring_rel_pose_n5": poses, "joints": np.zeros((3, 16))}
    path.write_bytes(pickle.dumps(content, protocol=5))


@pytest.fixture
def root(tmp_path: Path, encoded: Make, make_image: Make) -> Path:
    images = [encoded(i, colour=(10 + i, 20, 200)) for i in range(9)]
    poses = [np.eye(4) * (i + 1) for i in range(7)]
    for name in ("train/sugar/bag_00", "train/pringles/bag_37", "test/sugar/bag_00"):
        bag(tmp_path / f"{name}.pkl", images, poses)
    make_image("bgs/digit_ring.png", 30, (24, 32))
    return tmp_path


def test_bags(root: Path, levels: Make) -> None:
    _, recording = SparshPose(str(root), val=0).recordings("train")
    assert (recording.key, recording.object) == ("sparsh_pose/train/sugar/bag_00", "sugar")
    assert len(recording.frames) == 7, "two images have no pose"
    assert recording.frames.read([3])[0, 0, 0].tolist() == [200, 20, 13], "stored blue first"
    assert levels(recording.no_contact) == [30]
    np.testing.assert_array_equal(recording.tracks["relative_pose"][4], 5 * np.eye(4))
    (test,) = SparshPose(str(root)).recordings("test")
    assert test.key == "sparsh_pose/test/sugar/bag_00"


def test_another_finger_and_damage(root: Path, encoded: Make) -> None:
    bag(root / "train/sugar/bag_01.pkl", [encoded(0)], np.zeros((1, 3, 3)))
    data = SparshPose(str(root), val=0)
    assert len(list(data.recordings("train"))) == 2
    assert "bag_01.pkl: no images and 4x4 poses under digit_ring" in data.skipped[0]
    other = SparshPose(str(root), finger="index", split="all", val=0)
    with pytest.raises(Exception, match="under digit_index and object_index_rel_pose_n5"):
        list(other.recordings("train"))
    with pytest.raises(ConfigError, match="unknown finger 'thumb'"):
        SparshPose(".", finger="thumb")


def test_without_backgrounds(root: Path) -> None:
    (root / "bgs/digit_ring.png").unlink()
    assert all(
        recording.no_contact is None
        for recording in SparshPose(str(root), val=0).recordings("train")
    )


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(SparshPose, root=str(root), val=0.0)
