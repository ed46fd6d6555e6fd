import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.sparsh_slip import SparshSlip

from tactileforge.errors import DataNotFoundError

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, encoded: Make) -> Path:
    for i in (1, 2, 5, 6):
        folder = tmp_path / f"sphere/batch_{i}"
        folder.mkdir(parents=True)
        images = [encoded(k) for k in range(10)]
        (folder / "dataset_gelsight_00.pkl").write_bytes(pickle.dumps(images))
        trajectory = {
            "indexes": np.arange(2, 10),
            "forces": np.ones((8, 3)),
            "slip_label": np.array([0, 0, 0, 1, 1, 1, 0, 0]),
        }
        labels = {"in_contact": [0, 0] + [1] * 8, "trajectories": {0: trajectory}}
        (folder / "dataset_slip_forces.pkl").write_bytes(pickle.dumps(labels))
    return tmp_path


def test_slip_is_kept_per_frame(root: Path, levels: Make) -> None:
    recording = next(iter(SparshSlip(str(root), "gelsight_mini", val=0).recordings("train")))
    assert recording.tracks["slip"].tolist() == [0, 0, 0, 1, 1, 1, 0, 0]
    part = recording.part(2, 5)
    assert part.tracks["slip"].tolist() == [0, 1, 1]
    assert levels(part.frames) == [4, 5, 6]
    assert part.part(1, 2).tracks["slip"].tolist() == [1]
    assert pickle.loads(pickle.dumps(part)).tracks["image"].tolist() == [4, 5, 6]


def test_splits(root: Path) -> None:
    def batches(split: str, side: str) -> list[str]:
        data = SparshSlip(str(root), "gelsight_mini", split, val=0)
        return [recording.key.split("/")[2] for recording in data.recordings(side)]

    assert batches("sparsh-official", "train") == ["batch_1", "batch_5", "batch_6"]
    assert batches("anytouch2-port", "train") == ["batch_1", "batch_5"]
    assert batches("anytouch2-port", "test") == ["batch_6"]
    with pytest.raises(DataNotFoundError, match="its test batch is not on Hugging Face"):
        batches("sparsh-official", "test")


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(SparshSlip, root=str(root), sensor="gelsight_mini", val=0.0)
