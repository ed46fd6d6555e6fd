"""Labels of touch as annotations of TLabel: read back to the bit, and by its own reader."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.tlabel_writer import write_tlabel

from tactileforge import cli
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import ArrayFrames
from tactileforge.errors import ConfigError, DataError
from tactileforge.testing import check

COUNT = 8
#: Row and column of the middle of what is pressed.
PLACE = (20, 9)


def recording(**given: Any) -> Recording:
    frames = np.full((COUNT, 32, 24, 3), 100, np.uint8)
    for row in range(2, COUNT):  # 7 x 7 pixels, darker with the force
        y, x = PLACE
        frames[row, y - 3 : y + 4, x - 3 : x + 4] = 80 - 5 * row
    shown = ArrayFrames(frames)
    force = np.random.default_rng(0).normal(0, 1, (COUNT, 3)).astype(np.float32)
    force[:, 2] = [0, 0.05, 0.2, 0.4, np.nan, 0.9, 1.1, 0.3]
    force[6, :2] = np.nan
    one = Recording(
        key="a/1",
        sensor="digit",
        frames=shown,
        times=np.arange(COUNT) / 30,
        no_contact=FrameSubset(shown, [0]),
        force=force,
        object="mug",
        text="touching a mug",
        licence="CC0-1.0",
    )
    return replace(one, **given)


def written(tmp_path: Path, one: Recording) -> dict[str, Any]:
    write_tlabel({"train": [one]}, tmp_path / "set", 0.1)
    found: dict[str, Any] = json.loads((tmp_path / "set/train/000000.json").read_text("utf-8"))
    return found


def test_every_value_is_that_of_the_recording(tmp_path: Path) -> None:
    one = recording()
    assert one.force is not None
    found = written(tmp_path, one)
    assert found["sensor"] == {"type": "digit", "resolution": "24x32"}
    assert (found["episode"]["id"], found["episode"]["object"]) == ("a/1", "mug")
    assert [frame["frame_idx"] for frame in found["frames"]] == [0, 1, 2, 3, 5, 6, 7]
    for frame in found["frames"]:
        row, values = frame["frame_idx"], frame["schema_v2"]
        assert frame["timestamp_s"] == one.times[row]
        assert values["force_magnitude"] == float(one.force[row, 2])
        assert values["contact"] == (row >= 2)
        vector = None if row == 6 else one.force[row].tolist()
        assert values["force_vector"] == vector
        assert values["compliance_level"] == ("L2" if row == 6 else "L3")
        place = [PLACE[1], PLACE[0]] if row >= 2 else None  # right, down
        assert values["contact_centroid"] == place
        assert values["slip_event"] is False
    told = {name for name, is_told in found["capabilities"].items() if is_told}
    assert told == {"contact", "contact_centroid", "force_magnitude", "force_vector", "confidence"}


def test_labels_by_hand_come_before_forces(tmp_path: Path) -> None:
    contact = np.array([0, 0, 0, 1, 1, np.nan, 1, 0], np.float32)
    slip = np.array([0, 0, 0, 0, 1, 0, 0, 0], np.float32)
    found = written(tmp_path, recording(tracks={"contact": contact, "slip": slip}))
    values = {one["frame_idx"]: one["schema_v2"] for one in found["frames"]}
    assert {row for row, one in values.items() if one["contact"]} == {3, 4, 6}
    assert {row for row, one in values.items() if one["slip_event"]} == {4}
    assert 5 not in values
    assert found["capabilities"]["slip_event"]
    assert values[4]["compliance_level"] == "L1"  # its force is not known


def test_its_own_reader_reads_and_validates_it(tmp_path: Path) -> None:
    tlabel = pytest.importorskip("tlabel")
    one = recording()
    assert one.force is not None
    write_tlabel({"train": [one]}, tmp_path / "set", 0.1)
    data = tlabel.load(str(tmp_path / "set/train/000000.json"))
    assert [frame.frame_idx for frame in data.frames] == [0, 1, 2, 3, 5, 6, 7]
    for frame in data.frames:
        assert frame.timestamp_s == one.times[frame.frame_idx]
        assert frame.schema_v2.force_magnitude == float(one.force[frame.frame_idx, 2])
        assert frame.schema_v2.validate() == (True, [])
    core = pytest.importorskip("tlabel.core.capabilities")
    assert core.validate_capabilities(data.capabilities) == []


def test_what_has_no_contact_to_tell_is_said(tmp_path: Path) -> None:
    lacking = [recording(force=None, key="b"), recording(no_contact=None, key="c")]
    counts, skipped = write_tlabel({"val": [*lacking, recording()]}, tmp_path / "set", 0.1)
    assert (counts["files"], counts["frames"], counts["left out"]) == (1, COUNT - 1, 1)
    assert skipped == [
        "b: left out, as it has no force and no track contact",
        "c: left out, as it has no background",
    ]
    with pytest.raises(ConfigError, match=r"set exists: give another out="):
        write_tlabel({"val": [recording()]}, tmp_path / "set", 0.1)
    with pytest.raises(DataError, match=r"no recordings to write; b: left out"):
        write_tlabel({"val": lacking}, tmp_path / "other", 0.1)
    assert not (tmp_path / "other").exists()


def test_the_verb_conforms() -> None:
    assert {one.status for one in check("verb", "data.tlabel")} == {"ran"}


@pytest.mark.slow
def test_the_command_writes_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["data", "tlabel", "data=sim", "data.scenes=2", "data.val=1", "data.size=32"]
    assert cli.run([*words, f"out={tmp_path / 'set'}"]) == 0
    assert " files, " in capsys.readouterr().out
    assert {path.parent.name for path in (tmp_path / "set").glob("*/*.json")} == {"train", "val"}
