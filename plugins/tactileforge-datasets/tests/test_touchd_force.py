import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.touchd_force import TouchdForce

from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError, DataError

Make = Callable[..., Any]
FORCES = [[i, 0.1 * i, 0.2 * i, -0.5 * i, "press"] for i in range(2, 12)]


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    index = {}
    for indenter in (6, 18, 30):
        session = f"obj{indenter:03d}_speed1"
        index[session] = {"digit": FORCES, "gelsight": FORCES[::-1], "biotip": FORCES}
        for sensor in ("digit", "gelsight"):
            make_images(f"{session}/{sensor}/image_{{}}.png", range(1, 12))
    write("all_data_direction.json", json.dumps(index))
    return tmp_path


def test_sessions(root: Path, levels: Make) -> None:
    by_key = {
        recording.key: recording
        for recording in TouchdForce(str(root), "all", val=0).recordings("train")
    }
    assert len(by_key) == 6, "biotip is not an image, and the others have no labels"
    recording = by_key["touchd_force/obj006_speed1/digit"]
    assert levels(recording.frames) == list(range(2, 12))
    assert levels(recording.no_contact) == [1]
    np.testing.assert_allclose(recording.times, np.arange(10) / 30)
    assert (recording.object, recording.labels["indenter"], recording.tier) == (
        "touchd_indenter_6",
        6,
        1,
    )
    mini = by_key["touchd_force/obj006_speed1/gelsight"]
    assert (mini.sensor, mini.object) == ("gelsight_mini", recording.object)
    assert levels(mini.frames) == list(range(2, 12)), "in order, also where the index is not"
    np.testing.assert_allclose(np.diff(mini.times), 1 / 18)


def test_axes(root: Path) -> None:
    """Pressing is positive; x and y are those that the public videos show."""
    i = np.arange(2, 12)[:, None]
    cases = {
        ("digit", "image"): [-0.1, 0.2, 0.5],
        ("gelsight", "image"): [0.2, 0.1, 0.5],
        ("digit", "source"): [0.1, 0.2, 0.5],
        ("gelsight", "source"): [0.1, 0.2, 0.5],
    }
    for (sensor, axes), want in cases.items():
        data = TouchdForce(str(root), "all", val=0, axes=axes)
        recording = next(
            recording for recording in data.recordings("train") if recording.key.endswith(sensor)
        )
        assert recording.force is not None
        np.testing.assert_allclose(recording.force, i * want, rtol=1e-6)
        assert (recording.action is None) == (axes == "source") == ("action" not in data.provides)
    data = TouchdForce(str(root), "all", val=0)
    pressed = next(iter(data.recordings("train"))).action
    assert pressed is not None
    assert ACTIONS.index("press") in pressed, "the force rises from the first frame to the last"
    with pytest.raises(ConfigError, match="unknown axes 'world'"):
        TouchdForce(".", axes="world")


@pytest.mark.parametrize(
    ("split", "train", "test"),
    [("anytouch2-official", {6}, {18}), ("anytouch2-pretrain", {30}, {6, 18})],
)
def test_named_splits(root: Path, split: str, train: set[int], test: set[int]) -> None:
    data = TouchdForce(str(root), split, val=0)
    by_split = {
        side: {recording.labels["indenter"] for recording in data.recordings(side)}
        for side in ("train", "test")
    }
    assert by_split == {"train": train, "test": test}


def test_defects(root: Path, levels: Make) -> None:
    (root / "obj006_speed1/digit/image_1.png").unlink()
    (root / "obj018_speed1").rename(root / "other")
    (root / "obj018_speed1").mkdir()
    (root / "other").rename(root / "obj018_speed1/obj018_speed1")
    (root / "obj030_speed1/digit/image_5.png").unlink()
    data = TouchdForce(str(root), "all", val=0)
    by_key = {recording.key.split("/", 1)[1]: recording for recording in data.recordings("train")}
    assert by_key["obj006_speed1/digit"].no_contact is None, "the background is missing"
    assert levels(by_key["obj018_speed1/digit"].no_contact) == [1], "unzipped one folder deeper"
    assert "obj030_speed1/digit" not in by_key
    (line,) = data.skipped
    assert "obj030_speed1/digit/image_5.png: no such file" in line


def test_bad_forces_are_named(root: Path, write: Make) -> None:
    bad = {"obj006_speed1": {"digit": [[2, 0.1, None, 0.2]], "gelsight": [[2, 1, 1]]}, "x": {}}
    write("all_data_direction.json", json.dumps(bad))
    data = TouchdForce(str(root), "all")
    with pytest.raises(DataError, match="no recording of touchd_force for train"):
        list(data.recordings("train"))
    assert [any(word in line for line in data.skipped) for word in ("'x'", "digit")] == [True] * 2
    write("all_data_direction.json", "[]")
    with pytest.raises(DataError, match=r"all_data_direction\.json: not an index"):
        list(TouchdForce(str(root), "all").recordings("train"))


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TouchdForce, root=str(root), split="all", val=0.3)
