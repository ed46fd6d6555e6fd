"""Folders as cameras and clusters leave them: dropped frames, two sensors, links, pointers."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError

Write = Callable[[str, str], Path]
FIRST = {"sensor": "digit", "background": {"first": 1}}
SEQUENCE = FIRST | {"images": "*/*.png", "each": "sequence", "fps": 30}
BY_FRAME = {"file": "{stem}/f.csv", "frame": "frame", "columns": [None, None, "fz"]}


def read(root: Path, **layout: Any) -> tuple[list[Recording], list[str]]:
    """The recordings of one layout, none held out, and the notes."""
    data = Recordings(str(root), {"a": layout}, val=0)
    return list(data.recordings("train")), data.notes


def _forces(rows: range | list[int]) -> str:
    """A table with the numbers of the frames as newtons."""
    return "frame,fz\n" + "".join(f"{n},{n}\n" for n in rows)


HOLES = [n for n in range(12) if n not in (3, 4)]


@pytest.mark.parametrize(
    ("names", "rows", "by_name", "is_noted"),
    [
        (HOLES, range(5, 9), True, True),  # of the contact alone: fits either way
        (HOLES, range(12), True, False),  # rows of dropped frames have no image
        (HOLES, range(10), False, False),  # a row per image, as the label page writes
        ([0, 2, 4, 6, 8, 10], [4, 6, 8], True, False),  # every second frame was kept
        (range(1, 9), range(1, 9), True, False),  # as ffmpeg counts
        (range(1, 9), range(8), False, False),
        (range(1, 9), range(3, 6), True, True),
        (range(100, 108), range(2, 5), False, False),
        (range(100, 108), range(102, 105), True, False),
    ],
)
def test_a_frame_of_a_table_is_the_number_in_the_name(
    tmp_path: Path,
    make_images: Callable[..., None],
    write: Write,
    names: list[int],
    rows: list[int],
    by_name: bool,
    is_noted: bool,
) -> None:
    make_images("press/frame_{:05d}.png", names)
    write("press/f.csv", _forces(rows))
    (one,), notes = read(tmp_path, **SEQUENCE, force=BY_FRAME, action="none")
    assert one.force is not None
    want = [n if n in rows else np.nan for n in (names if by_name else range(len(one.frames)))]
    np.testing.assert_array_equal(one.force[:, 2], want)
    assert any("'frame' is taken for the numbers in names" in line for line in notes) == is_noted
    even = SEQUENCE | {"times": "even", "force": BY_FRAME, "action": "none"}
    if max(rows) < len(one.frames):
        (one,), _ = read(tmp_path, **even)
        assert one.force is not None
        assert np.flatnonzero(np.isfinite(one.force[:, 2])).tolist() == list(rows), "it counts"


def test_actions_and_tracks_follow_the_names_too(
    tmp_path: Path, make_images: Callable[..., None], write: Write
) -> None:
    make_images("press/{}.png", HOLES)
    write("press/f.csv", "frame,what,contact\n10,press,1\n11,leave,0\n")
    action = {"file": "{stem}/f.csv", "frame": "frame", "column": "what"}
    tracks = {"file": "{stem}/f.csv", "frame": "frame", "columns": ["contact"]}
    (one,), _ = read(tmp_path, **SEQUENCE, action=action, tracks=tracks)
    assert one.action is not None
    assert np.flatnonzero(one.action >= 0).tolist() == [8, 9]
    np.testing.assert_array_equal(one.tracks["contact"][8:], [1, 0])


def test_a_frame_beyond_the_names_is_named(
    tmp_path: Path, make_images: Callable[..., None], write: Write
) -> None:
    make_images("press/{}.png", HOLES)
    write("press/f.csv", _forces(range(5, 14)))
    with pytest.raises(DataError, match=r"row 9: frame 12 does not exist, names .* have 0 to 11"):
        read(tmp_path, **SEQUENCE, force=BY_FRAME)


@pytest.mark.parametrize(
    ("patterns", "series"),
    [
        (("left_{:04d}", "right_{:04d}"), ["left", "right"]),
        (("{:04d}_left", "{:04d}_right"), ["left", "right"]),
        (("cam0_{:04d}", "cam1_{:04d}"), ["cam0", "cam1"]),
        (("gel-1 {}", "gel-2 {}"), ["gel1", "gel2"]),
        (("tactile_{:03d}", "{:03d}"), ["images", "tactile"]),
        (("L{}", "R{}"), ["l", "r"]),
        (("left_1763000000{}00", "right_1763000000{}50"), ["left", "right"]),
    ],
)
def test_two_sensors_in_one_folder_are_two_recordings(
    tmp_path: Path, make_image: Callable[..., Path], patterns: tuple[str, str], series: list[str]
) -> None:
    for side, pattern in enumerate(patterns):
        for i in range(5):
            make_image(f"take/{pattern.format(i + 1)}.png", 10 * side + i)
    found, notes = read(tmp_path, **SEQUENCE | {"times": "even"})
    assert sorted(one.key for one in found) == [f"a/take/{name}" for name in series]
    shown = [[round(float(p.mean()) / 7) for p in one.frames.read(range(5))] for one in found]
    assert sorted(shown) == [list(range(5)), list(range(10, 15))], "neither mixed nor out of order"
    assert [len(one.times) for one in found] == [5, 5]
    assert len(notes) == 1
    assert "2 series of images in one folder" in notes[0]


@pytest.mark.parametrize(
    "names",
    [
        [f"slide_{'left' if i < 5 else 'right'}_{i}" for i in range(10)],  # phases of one take
        [f"{i:02d}_{'contact' if i in (3, 4) else 'free'}" for i in range(10)],
        [f"{1763000000 + i // 5}_{i % 5 * 200:03d}" for i in range(10)],  # seconds, milliseconds
        [f"20261105_12300{i // 5}_{i % 5}" for i in range(10)],
        ["apple", "bread", "cup"],
    ],
)
def test_names_of_one_take_stay_one_recording(
    tmp_path: Path, make_image: Callable[..., Path], names: list[str]
) -> None:
    for i, name in enumerate(names):
        make_image(f"take/{name}.png", i)
    (one,), _ = read(tmp_path, **SEQUENCE)
    assert (one.key, len(one.frames)) == ("a/take", len(names))


def test_the_pattern_of_a_note_reads_one_series(
    tmp_path: Path, make_image: Callable[..., Path], write: Write
) -> None:
    for side in ("left", "right"):
        for i in range(4):
            make_image(f"take/{side}_{i}.png", i)
        make_image(f"take/rest_{side}.png", 9)
    rows = [f"take/{side}_{i}.png,{side} mug" for side in ("left", "right") for i in range(4)]
    write("labels.csv", "\n".join(["file,object", *rows]))
    still = {"background": {"file": "{stem}/rest_{series}.png"}}
    labels = {"labels": {"file": "labels.csv"}, "object": "{object}"}
    found, notes = read(tmp_path, **SEQUENCE | still | labels)
    assert [(one.key.rpartition("/")[2], one.object) for one in found] == [
        ("left", "left mug"),
        ("right", "right mug"),
    ]
    assert [one.background() is not None for one in found] == [True, True]
    assert "2 series" in notes[0]
    (pattern,) = [line.split("'")[-4] for line in notes if "series" in line]
    assert pattern == "*/left_*.png"
    (one,), notes = read(tmp_path, **SEQUENCE | {"images": pattern})
    assert (len(one.frames), notes) == (4, [])


def test_what_belongs_to_a_trial_is_held_out_together(
    tmp_path: Path, make_images: Callable[..., None]
) -> None:
    for trial in range(20):
        for side in ("left", "right"):
            make_images(f"trial_{trial:02d}/{side}/{{}}.png", range(2))
    layout = SEQUENCE | {"images": "*/*/*.png"}
    data = Recordings(str(tmp_path), {"a": layout}, val=0.3)
    sides = [{one.key.split("/")[1] for one in data.recordings(s)} for s in ("train", "val")]
    assert [len(trials) for trials in sides] == [13, 7]
    assert not sides[0] & sides[1]
    assert data.notes == []
    (line,) = data.held_out
    assert "40 recordings of 20 trials, by trials, with all sensors" in line
    assert line.endswith("14 recordings held out")

    alone = Recordings(str(tmp_path), {"a": layout | {"hold_out": "recording"}}, val=0.3)
    assert len([*alone.recordings("val")]) == 11
    (line,) = alone.notes
    assert "trials, such as 'trial_" in line
    assert "are in training and validation, by hold_out: recording" in line


def test_two_series_of_a_folder_are_held_out_together_and_by_a_folder_on_request(
    tmp_path: Path, make_images: Callable[..., None]
) -> None:
    for take in range(12):
        for side in ("tactile", "depth"):
            make_images(f"day{take % 3}/{take}/{side}_{{}}.png", range(2))
    for split, unit in (("trial", 2), ("{folder}", 1)):
        layout = SEQUENCE | {"images": "*/*/*.png", "hold_out": split}
        data = Recordings(str(tmp_path), {"a": layout}, val=0.3)
        train, val = (
            {"/".join(one.key.split("/")[1 : 1 + unit]) for one in data.recordings(s)}
            for s in ("train", "val")
        )
        assert train, split
        assert val, split
        assert not train & val


def test_a_folder_of_another_split_is_no_unit(
    tmp_path: Path, make_images: Callable[..., None]
) -> None:
    make_images("test/a/{}.png", range(2))
    layout = SEQUENCE | {"images": "*/*/*.png", "hold_out": "{folder}"}
    with pytest.raises(DataError, match=r"the split is 'test', but must be train or val"):
        [*Recordings(str(tmp_path), {"a": layout}).recordings("train")]


@pytest.mark.parametrize("pattern", ["**/*.avi", "*/*.avi"])
def test_links_to_folders_are_entered_and_others_are_named(
    tmp_path: Path, make_video: Callable[..., Path], pattern: str
) -> None:
    make_video("in/day0/a.avi", count=8)
    make_video("elsewhere/b.avi", count=9)
    root = tmp_path / "in"
    (root / "day1").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    (root / "day2").symlink_to(tmp_path / "gone", target_is_directory=True)
    data = Recordings(str(root), {"a": FIRST | {"videos": pattern}}, val=0)
    found = {one.key: len(one.frames) for one in data.recordings("train")}
    assert found == {"a/day0/a.avi": 8, "a/day1/b.avi": 9}
    assert data.skipped == [f"{root / 'day2'}: no file but a link to nothing; left out"]


def test_a_folder_under_two_names_is_read_once(
    tmp_path: Path, make_video: Callable[..., Path]
) -> None:
    make_video("in/day0/deep/a.avi", count=8)
    root = tmp_path / "in"
    (root / "day0/around").symlink_to(root, target_is_directory=True)
    (root / "again").symlink_to(root / "day0/deep", target_is_directory=True)
    data = Recordings(str(root), {"a": FIRST | {"videos": "**/*.avi"}}, val=0)
    assert [one.key for one in data.recordings("train")] == ["a/day0/deep/a.avi"]
    assert sorted(data.skipped) == [
        f"{path}: no file but a link to a folder that is read by another name; left out"
        for path in (root / "again", root / "day0/around")
    ]


def test_a_guess_sees_behind_links(tmp_path: Path, make_video: Callable[..., Path]) -> None:
    make_video("elsewhere/b.avi", count=9)
    (tmp_path / "in").mkdir()
    (tmp_path / "in/day").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    guess = Recordings.recognise(tmp_path / "in")
    assert guess is not None
    assert guess.options["layouts"]["guessed"]["videos"] == "*/*.avi"


def test_a_folder_with_some_pointers_is_read_without_them(
    tmp_path: Path, make_video: Callable[..., Path]
) -> None:
    make_video("a.avi", count=8)
    (tmp_path / "b.avi").write_text(
        "version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 9\n"
    )
    layout = {"videos": "*.avi", "sensor": "digit", "background": {"first": 1}}
    data = Recordings(str(tmp_path), {"a": layout}, val=0)
    assert len([*data.recordings("train")]) == 1
    (line,) = data.skipped
    assert line.startswith(
        f"{tmp_path / 'b.avi'}: a pointer of Git LFS, not the file: git lfs pull"
    )
