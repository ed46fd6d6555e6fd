import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.touch_slide import TouchSlide

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, encoded: Make, make_image: Make) -> Path:
    for name in ("bread/dataset_0", "bread/dataset_1", "corn/dataset_0"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        frames = [encoded(i) for i in range(6)]
        (tmp_path / f"{name}.pkl").write_bytes(pickle.dumps(frames))
    make_image("bgs/bg_11.jpg", 30, (24, 32))
    return tmp_path


def test_recordings(root: Path, levels: Make) -> None:
    bread, _, corn = TouchSlide(str(root), val=0).recordings("train")
    assert (bread.key, bread.object) == ("touch_slide/bread/dataset_0", "bread")
    assert levels(bread.frames) == list(range(6))
    np.testing.assert_allclose(bread.times, np.arange(6) / 30)
    assert levels(bread.no_contact) == [30]
    assert levels(corn.no_contact) == list(range(6)), "bg_18.jpg is missing: the median"


def test_a_pickle_that_would_run_something_is_left_out(root: Path) -> None:
    (root / "bread/dataset_1.pkl").write_bytes(b"\x80\x02cos\nsystem\nX\x04\x00\x00\x00true\x85R.")
    (root / "corn/dataset_0.pkl").write_bytes(pickle.dumps({"frames": []}))
    data = TouchSlide(str(root), val=0)
    assert [recording.key for recording in data.recordings("train")] == [
        "touch_slide/bread/dataset_0"
    ]
    assert "dataset_1.pkl: not read: it asks for os.system" in data.skipped[0]
    assert "a dict, where a list of images belongs" in data.skipped[1]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TouchSlide, root=str(root), val=0.0)
