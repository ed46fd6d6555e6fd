import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.cloth import Cloth

from tactileforge.errors import DataError, DataNotFoundError

Make = Callable[..., Any]


def entries(*places: tuple[int, int]) -> str:
    return json.dumps(
        {
            str(i): {"status": "ok", "cloth_index": cloth, "trial_index": trial, "count": 6}
            for i, (cloth, trial) in enumerate(places)
        }
    )


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    for place in ("7/0", "7/1", "008/0", "9/0"):
        make_images(f"Data/{place}/gelsight_frame/{{:04d}}.png", range(1, 7))
    write("cloth_metadata.json", json.dumps({"7": [*range(10), 13], "8": [0] * 10 + [4]}))
    write("train_data.json", entries((7, 0), (7, 1)))
    write("test_data.json", entries((8, 0)))
    write("train_data_new.json", entries((8, 0)))
    write("test_data_new.json", entries((7, 0)))
    return tmp_path


def test_grasps(root: Path, levels: Make) -> None:
    first, other = Cloth(str(root), val=0).recordings("train")
    assert (first.key, other.key, first.object) == ("cloth/7/0", "cloth/7/1", "cloth_7")
    assert (levels(first.frames), levels(first.no_contact)) == ([1, 2, 3, 4, 5, 6], [1])
    assert (first.labels["class"], first.labels["attribute_3"]) == (13, 3)


@pytest.mark.parametrize(
    ("split", "side", "want"),
    [
        ("cloth-official", "test", ["cloth/008/0"]),
        ("anytouch2-official", "train", ["cloth/008/0"]),
        ("anytouch2-official", "test", ["cloth/7/0"]),
        ("all", "train", ["cloth/008/0", "cloth/7/0", "cloth/7/1", "cloth/9/0"]),
    ],
)
def test_splits(root: Path, split: str, side: str, want: list[str]) -> None:
    assert [recording.key for recording in Cloth(str(root), split, val=0).recordings(side)] == want


def test_defects(root: Path, write: Make) -> None:
    (root / "Data/9/0/gelsight_frame/0003.png").write_bytes(b"")
    data = Cloth(str(root), "all", val=0)
    assert len(list(data.recordings("train"))) == 3
    assert "9/0/gelsight_frame/0003.png" in data.skipped[0]
    (root / "test_data_new.json").unlink()
    with pytest.raises(DataNotFoundError, match=r"no file .*test_data_new\.json"):
        list(Cloth(str(root), "anytouch2-official").recordings("train"))
    write("train_data.json", json.dumps({"0": {"cloth_index": 7}}))
    with pytest.raises(DataError, match=r"train_data\.json: .* has no cloth_index and trial"):
        list(Cloth(str(root)).recordings("train"))


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(Cloth, root=str(root), val=0.0)
