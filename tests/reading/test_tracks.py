"""Tracks of a layout: numbers per frame of a CSV, and frames to leave out."""

import numpy as np
import pytest

from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError

LAYOUT = {
    "videos": "*.avi",
    "sensor": "digit",
    "background": "none",
    "tracks": {
        "file": "labels/{file}{crop}.csv",
        "frame": "frame",
        "columns": ["contact", "slip"],
        "drop": "bad",
    },
}
ROWS = "frame,contact,slip,bad\n0,0,0,0\n1,1,0,0\n2,1,1,1\n3,,,0\n"


def read(root, layout=LAYOUT, **options):
    data = Recordings(str(root), {"a": layout}, val=0, **options)
    return list(data.recordings("train")), data


def test_columns_become_tracks_and_marked_frames_go(tmp_path, make_video, write):
    make_video("one.avi", count=6)
    write("labels/one.avi.csv", ROWS)
    (recording,), data = read(tmp_path)
    assert len(recording.frames) == len(recording.times) == 5
    np.testing.assert_allclose(recording.times * 30, [0, 1, 3, 4, 5], atol=1e-4)
    shown = [round(frame.mean() / 7) for frame in recording.frames.read(range(5))]
    assert shown == [0, 1, 3, 4, 5]
    nan = np.nan
    np.testing.assert_array_equal(recording.tracks["contact"], [0, 1, nan, nan, nan])
    np.testing.assert_array_equal(recording.tracks["slip"], [0, 0, nan, nan, nan])
    assert recording.tracks.keys() == {"contact", "slip"}
    assert data.notes == []


def test_without_them_all_frames_are_there(tmp_path, make_video, write):
    make_video("one.avi", count=6)
    write("labels/one.avi.csv", ROWS)
    (recording,), _ = read(tmp_path, tracks=False)
    assert (len(recording.frames), dict(recording.tracks)) == (6, {})


def test_a_recording_without_the_file_is_read_and_noted(tmp_path, make_video):
    make_video("one.avi", count=6)
    (recording,), data = read(tmp_path)
    assert dict(recording.tracks) == {}
    assert data.notes == ["a/one.avi: has no file of tracks"]


def test_each_crop_has_its_own(tmp_path, make_video, write):
    make_video("one.avi", count=4)
    write("labels/one.avi#left.csv", ROWS)
    write("labels/one.avi#right.csv", ROWS.replace("2,1,1,1", "2,1,1,0"))
    crops = {"left": {"box": [0, 0, 20, 20]}, "right": {"box": [20, 0, 20, 20]}}
    found, _ = read(tmp_path, LAYOUT | {"crops": crops})
    assert [len(recording.frames) for recording in found] == [3, 4]


def test_images_by_name(tmp_path, make_image, write):
    for i in range(3):
        make_image(f"one/{i}.png", i)
    write("labels.csv", "image,contact\none/2.png,1\n")
    tracks = {"file": "labels.csv", "key": "image", "columns": ["contact"]}
    layout = {"images": "*/*.png", "each": "sequence", "fps": 30} | {
        "sensor": "digit",
        "background": "none",
        "tracks": tracks,
    }
    (recording,), _ = read(tmp_path, layout)
    np.testing.assert_array_equal(recording.tracks["contact"], [np.nan, np.nan, 1])


@pytest.mark.parametrize(
    ("rows", "kind", "said"),
    [
        ("frame,contact,slip,bad\n9,1,0,0\n", DataError, "row 2: frame 9 does not exist"),
        ("frame,contact,slip,bad\n0,yes,0,0\n", DataError, "'yes' is not a finite number"),
        ("frame,contact,bad\n0,1,0\n", ConfigError, "slip"),
        (
            "frame,contact,slip,bad\n" + "".join(f"{i},,,1\n" for i in range(6)),
            DataError,
            "every frame is dropped",
        ),
    ],
)
def test_what_contradicts_the_frames_is_named(rows, kind, said, tmp_path, make_video, write):
    make_video("one.avi", count=6)
    write("labels/one.avi.csv", rows)
    with pytest.raises(kind, match=said) as caught:
        read(tmp_path)
    assert "one.avi.csv" in str(caught.value)


def test_a_key_that_is_unknown_names_the_nearest(tmp_path):
    tracks = {**LAYOUT["tracks"], "colums": ["contact"]}
    with pytest.raises(ConfigError, match="columns"):
        read(tmp_path, LAYOUT | {"tracks": tracks})


def ranged(frames, **more):
    return {**LAYOUT, "tracks": [{"name": "contact", "frames": frames, **more}]}


def test_ranges_become_a_track_without_values_around_edges(tmp_path, make_video):
    make_video("one.avi", count=12)
    (recording,), _ = read(tmp_path, ranged([[4, 8]], margin=1))
    nan = np.nan
    np.testing.assert_array_equal(
        recording.tracks["contact"], [0, 0, 0, nan, nan, 1, 1, nan, nan, 0, 0, 0]
    )
    (recording,), _ = read(tmp_path, ranged([[0, 2], [11, 12]]))
    np.testing.assert_array_equal(recording.tracks["contact"], [1, 1, *[0] * 9, 1])


@pytest.mark.parametrize(
    ("tracks", "said"),
    [
        ([{"name": "contact", "frames": [[1, 2]], "margin": -1}], "margin -1"),
        ([{"name": "contact", "frames": []}], "has 0 ranges"),
        ([{"name": "", "frames": [[1, 2]]}], "give each a name of its own"),
        ([{"name": "a", "frames": [[1, 2]]}] * 2, r"names \['a', 'a'\]"),
        ([], "give each a name of its own"),
    ],
)
def test_ranges_without_a_meaning_are_refused(tracks, said, tmp_path, make_video):
    make_video("one.avi", count=12)
    with pytest.raises(ConfigError, match=said):
        read(tmp_path, {**LAYOUT, "tracks": tracks})


def test_the_ends_of_a_recording_have_no_margin(tmp_path, make_video):
    make_video("one.avi", count=6)
    (recording,), _ = read(tmp_path, ranged([[0, 3]], margin=1))
    nan = np.nan
    np.testing.assert_array_equal(recording.tracks["contact"], [1, 1, nan, nan, 0, 0])


@pytest.mark.parametrize("frames", [[[4, 13]], [[4, 4]], [[6, 8], [2, 4]], [[2, 6], [5, 9]]])
def test_ranges_that_do_not_fit_the_frames_are_named(frames, tmp_path, make_video):
    make_video("one.avi", count=12)
    with pytest.raises(DataError, match="it has 12 frames, but the ranges of track 'contact'"):
        read(tmp_path, ranged(frames))
