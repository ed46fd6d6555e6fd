from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError
from tactileforge.reading.splits import held_out, held_out_names, is_held_out, split_parts, take_of

MakeFile = Callable[..., Path]
LAYOUT = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}


def keys(root: Path, side: str, **more: Any) -> set[str]:
    data = Recordings(str(root), {"a": LAYOUT | more}, val=0.3)
    return {recording.key for recording in data.recordings(side)}


def test_the_share_is_held_out() -> None:
    held = [is_held_out(f"recording {i}", 0.2) for i in range(5000)]
    assert 0.18 < np.mean(held) < 0.22
    assert not any(is_held_out(f"{i}", 0) for i in range(100))


def test_of_few_recordings_one_is_held_out(tmp_path: Path, make_image: MakeFile) -> None:
    names = [f"a/{i}.png" for i in range(3)]
    assert not any(is_held_out(name, 0.05) for name in names)
    assert len(held_out_names(names, 0.05)) == 1
    assert held_out_names(names, 0) == held_out_names(names[:2], 0.05) == frozenset()
    for i in range(3):
        make_image(f"{i}.png")
    data = Recordings(str(tmp_path), {"a": LAYOUT}, val=0.05)
    sides = {side: {x.key for x in data.recordings(side)} for side in ("train", "val")}
    assert sides["val"] == held_out_names(names, 0.05)
    assert len(sides["train"]) == 2
    # none is drawn where the layout itself has some
    fixed = {"a": LAYOUT, "b": LAYOUT | {"images": "2.png", "hold_out": "all"}}
    data = Recordings(str(tmp_path), fixed, val=0.05)
    assert {x.key for x in data.recordings("val")} == {"b/2.png"}


def test_by_recording_others_change_nothing(tmp_path: Path, make_image: MakeFile) -> None:
    for i in range(40):
        make_image(f"{i}.png")
    train, val = keys(tmp_path, "train"), keys(tmp_path, "val")
    assert len(train) + len(val) == 40
    assert not train & val
    assert 4 < len(val) < 20
    for i in range(40, 60):
        make_image(f"{i}.png")
    assert val <= keys(tmp_path, "val")
    assert train <= keys(tmp_path, "train")


def test_by_object_all_of_an_object_is_on_one_side(
    tmp_path: Path, make_image: MakeFile, write: MakeFile
) -> None:
    rows = [(f"{i}.png", f"object_{i % 10}") for i in range(40)]
    for name, _ in rows:
        make_image(name)
    write("l.csv", "file,thing\n" + "".join(f"{name},{thing}\n" for name, thing in rows))
    more = {"labels": {"file": "l.csv"}, "object": "{thing}", "hold_out": "object"}
    thing = {f"a/{name}": thing for name, thing in rows}
    train = {thing[key] for key in keys(tmp_path, "train", **more)}
    val = {thing[key] for key in keys(tmp_path, "val", **more)}
    assert val
    assert not train & val
    assert len(train | val) == 10


def test_by_column(tmp_path: Path, make_image: MakeFile, write: MakeFile) -> None:
    for i in range(3):
        make_image(f"{i}.png")
    write("l.csv", "file,part\n0.png,train\n1.png,val\n2.png,\n")
    more: dict[str, Any] = {"labels": {"file": "l.csv"}, "hold_out": "{part}"}
    with pytest.raises(DataError, match=r"l\.csv, row 4: the split is '', .*words: \{part: \{\"\""):
        keys(tmp_path, "train", **more)
    more["words"] = {"part": {"": "val", "train": "train", "val": "val"}}
    assert keys(tmp_path, "train", **more) == {"a/0.png"}
    assert keys(tmp_path, "val", **more) == {"a/1.png", "a/2.png"}


def test_constant_splits(tmp_path: Path, make_image: MakeFile) -> None:
    make_image("0.png")
    assert keys(tmp_path, "val", hold_out="all") == {"a/0.png"}
    assert keys(tmp_path, "train", hold_out="all") == set()


def whole(count: int) -> Recording:
    frames = np.arange(count, dtype=np.uint8)[:, None, None, None] * np.ones((1, 2, 2, 3), np.uint8)
    return Recording(
        key="r",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(count) / 30,
        no_contact=None,
        action=np.arange(count),
    )


def frames_of(recordings: list[Recording]) -> list[int]:
    return [
        int(i)
        for recording in recordings
        for i in recording.frames.read(range(len(recording.frames)))[:, 0, 0, 0]
    ]


@pytest.mark.parametrize("count", [1, 4, 60, 250])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_by_time_no_frame_is_shared_or_lost(count: int, share: float) -> None:
    train = list(split_parts(whole(count), share, "train"))
    val = list(split_parts(whole(count), share, "val"))
    assert sorted(frames_of(train) + frames_of(val)) == list(range(count))
    np.testing.assert_allclose(len(frames_of(val)), share * count, atol=1 + 0.02 * count)
    assert len({recording.key for recording in train + val}) == len(train + val)
    for recording in train + val:
        assert recording.action is not None
        assert frames_of([recording]) == recording.action.tolist()
        np.testing.assert_allclose(recording.times, recording.action / 30)


def test_by_time_blocks_are_spread_evenly() -> None:
    val = list(split_parts(whole(250), 0.3, "val"))
    starts = [float(recording.times[0]) for recording in val]
    assert len(val) == 5
    assert np.ptp(np.diff(starts)) < 0.04
    assert {len(recording.frames) for recording in val} == {15}
    assert starts[0] > 10 / 30, "training has the beginning too"


def test_by_time_of_a_video(tmp_path: Path, make_video: MakeFile) -> None:
    make_video("a.avi", count=60)
    layout = {"videos": "*.avi", "sensor": "digit", "background": {"first": 3}, "hold_out": "time"}
    data = Recordings(str(tmp_path), {"a": layout}, val=0.2)
    train, val = list(data.recordings("train")), list(data.recordings("val"))
    assert [recording.key for recording in train] == ["a/a.avi[0:24]", "a/a.avi[36:60]"]
    assert [recording.key for recording in val] == ["a/a.avi[24:36]"]
    assert val[0].no_contact is not None
    assert len(val[0].no_contact) == 3, "parts keep the background of the whole"


def recorded(take: int, device: str, name: str | None) -> Recording:
    frames = ArrayFrames(np.zeros((60, 4, 4, 3), np.uint8))
    return Recording(
        key=f"takes/{take:06d}/{device}/0000",
        sensor="digit",
        frames=frames,
        times=np.arange(60) / 30,
        no_contact=None,
        object=name,
        labels={"take": take, "device": device},
    )


def test_takes_are_held_out_with_all_their_sensors() -> None:
    sides: dict[int, set[bool]] = {}
    for take in range(100):
        for device in ("left", "right"):
            one = recorded(take, device, "cup")
            in_train = list(held_out([one], 0.3, "take", "train"))
            in_val = list(held_out([one], 0.3, "take", "val"))
            assert len(in_train) + len(in_val) == 1
            sides.setdefault(take, set()).add(bool(in_val))
    assert all(len(of) == 1 for of in sides.values())
    assert 20 <= sum(True in of for of in sides.values()) <= 40


def test_one_of_few_takes_is_held_out_with_its_sensors() -> None:
    few = [recorded(take, side, "cup") for take in range(3) for side in ("left", "right")]
    assert not any(is_held_out(take_of(one), 0.01) for one in few)
    val, train = ([*held_out(few, 0.01, "take", side)] for side in ("val", "train"))
    assert len(val) == 2 == len({one.labels["device"] for one in val})
    assert len({take_of(one) for one in val}) == 1
    assert len(train) == 4
    assert not [*held_out(few, 0, "take", "val")]


def test_objects_and_times_are_held_out() -> None:
    takes = [recorded(take, "left", f"object_{take % 10}") for take in range(40)]
    val = [*held_out(takes, 0.3, "object", "val")]
    train = [*held_out(takes, 0.3, "object", "train")]
    assert len(val) + len(train) == 40
    assert val
    assert not {one.object for one in val} & {one.object for one in train}
    parts = list(held_out(takes[:1], 0.2, "time", "val"))
    assert sum(len(part.frames) for part in parts) == 12
    tile = replace(takes[0], key="a/b.mp4#left[0:12]", labels={})
    assert take_of(tile) == "a/b.mp4"
