"""Every field of recordings, in each of the three kinds of bags."""

import pickle

import numpy as np
import pytest
from made_bags import (
    BEGIN,
    DELAY,
    HZ,
    KINDS,
    RIG_MAP,
    Messages,
    frame_rows,
    picture,
    rig_rows,
    write,
    write_rig,
)
from rosbags import rosbag1, rosbag2
from tactileforge_rosbags import bags, topic_frames
from tactileforge_rosbags.dataset import Rosbags
from tactileforge_rosbags.series import between

from tactileforge.errors import DataError
from tactileforge.testing import check

each = pytest.mark.parametrize("kind", KINDS)


def rig(tmp_path, kind, more="", count=20, **options):
    """The recordings of a made rig by their finger, and the data set."""
    write_rig(tmp_path / "set/pick", kind, count)
    (tmp_path / "rig.yaml").write_text(RIG_MAP + more)
    data = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "rig.yaml"), val=0, **options)
    return {str(one.labels["finger"]): one for one in data.recordings("train")}, data


@each
def test_every_field(kind, tmp_path):
    found, data = rig(tmp_path, kind)
    left, right = found["left"], found["right"]
    assert (left.key, right.key) == ("pick/left", "pick/right")
    assert (left.sensor, right.sensor) == ("digit", "gelsight_mini")
    np.testing.assert_array_equal(left.times, np.arange(20) / HZ)
    np.testing.assert_array_equal(left.frames.read([0, 7, 19]), [picture(i) for i in (0, 7, 19)])
    np.testing.assert_array_equal(right.frames.read([3])[0], np.rot90(picture(3)))
    assert (left.frames.shape, right.frames.shape) == ((32, 24), (24, 32))
    np.testing.assert_array_equal(left.background(), picture(0))
    # stamps are 4 ms before the recording, the lag is 12 ms: the wrench 8 ms after the recording of
    # each picture, between two of 10 ms each; they are counted from 10 ms before the first one
    number = 1.8 + 4 * np.arange(20)
    wanted = np.stack([number * 1e-3, np.full(20, -2e-3), number * 0.5e-3], axis=1)
    np.testing.assert_allclose(left.force, wanted, rtol=1e-6)
    assert left.force.dtype == np.float32
    assert right.force is None
    assert (left.object, left.text, left.licence) == ("mug", "touching a mug", "CC0-1.0")
    assert (left.tier, right.tier) == (1, 2)
    assert left.labels == {
        "episode": "pick",
        "finger": "left",
        "joints": "elbow wrist",
        "task": "lift",
    }
    np.testing.assert_array_equal(left.tracks["state"][:, 0], -left.tracks["state"][:, 1])
    np.testing.assert_array_equal(left.tracks["state"][:, 0], 2 * np.arange(20))
    np.testing.assert_array_equal(left.tracks["joint_velocity"], [[0.5, 0.25]] * 20)
    assert {*left.tracks} == {"state", "joint_velocity"}
    np.testing.assert_allclose(left.image_times, 2 * np.arange(10) / HZ)
    np.testing.assert_array_equal(
        left.image.read([4])[0], np.repeat(picture(4, 16, 20)[..., :1], 3, axis=2)
    )
    assert data.skipped == []
    assert data.provides == {"force", "object", "text", "image"}
    assert any("times are the stamps of the headers" in note for note in data.notes)


@each
def test_they_travel_to_workers(kind, tmp_path):
    found, _ = rig(tmp_path, kind)
    other = pickle.loads(pickle.dumps(found["right"]))
    np.testing.assert_array_equal(other.frames.read([5]), found["right"].frames.read([5]))


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8", "8UC1", "rgba8", "bgra8"])
def test_raw_pictures_with_padded_rows(encoding, tmp_path):
    write(tmp_path / "one", "mcap", frame_rows("mcap", "/gel", 3, raw=encoding, pad=3))
    (one,) = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0).recordings("train")
    wanted = picture(2)
    if encoding in ("mono8", "8UC1"):
        wanted = np.repeat(wanted[..., :1], 3, axis=2)
    np.testing.assert_array_equal(one.frames.read([2])[0], wanted)


@pytest.mark.parametrize("encoding", ["8UC3", "8UC4"])
def test_an_encoding_without_an_order_of_channels_is_read_where_the_map_says_it(encoding, tmp_path):
    write(tmp_path / "set/one", "mcap", frame_rows("mcap", "/gel", 3, raw=encoding))
    for said, wanted in (("bgr", picture(2)), ("rgb", picture(2)[..., ::-1])):
        (tmp_path / "m.yaml").write_text(
            f"touch: [{{topic: /gel, sensor: digit, channels: {said}}}]"
        )
        data = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "m.yaml"), val=0)
        (one,) = data.recordings("train")
        np.testing.assert_array_equal(one.frames.read([2])[0], wanted)
    unsaid = Rosbags(str(tmp_path / "set"), {"/gel": "digit"}, val=0)
    with pytest.raises(DataError, match=rf"'{encoding}' does not say .* channels: bgr where blue"):
        list(unsaid.recordings("train"))


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")],
)
def test_pairs_of_pixels_with_one_colour(encoding, order, tmp_path):
    make = Messages("mcap")
    # red, white, black and grey of BT.601: y, u, v
    colours = ((81, 90, 240), (235, 128, 128), (16, 128, 128), (126, 128, 128))
    values = {"y": 0, "u": 1, "v": 2}
    row = [colour[values[one]] for colour in colours for one in order]
    pixels = np.tile(np.array(row, np.uint8).reshape(8, 2), (4, 1, 1))
    write(tmp_path / "one", "mcap", [("/gel", BEGIN, make.raw(0, pixels, encoding, pad=2))])
    (one,) = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0).recordings("train")
    wanted = [[254, 0, 0], [255, 255, 255], [0, 0, 0], [128, 128, 128]]
    read = one.frames.read([0])[0].astype(int)
    assert abs(read[3, ::2] - wanted).max() <= 1
    np.testing.assert_array_equal(read[:, ::2], read[:, 1::2])


def test_exchanged_colours_are_put_right(tmp_path):
    make = Messages("sqlite3")
    rows = [("/gel", BEGIN + i, make.compressed(0, picture(i)[..., ::-1])) for i in range(2)]
    write(tmp_path / "set/one", "sqlite3", rows)
    lines = "touch: [{topic: /gel, sensor: digit, channels: bgr}]"
    (tmp_path / "m.yaml").write_text(lines)
    (one,) = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "m.yaml"), val=0).recordings("train")
    np.testing.assert_array_equal(one.frames.read([1])[0], picture(1))


@pytest.mark.parametrize(
    ("kind", "compress"),
    [
        ("sqlite3", rosbag2.CompressionMode.FILE),
        ("sqlite3", rosbag2.CompressionMode.MESSAGE),
        ("mcap", rosbag2.CompressionMode.STORAGE),
        ("ros1", rosbag1.Writer.CompressionFormat.BZ2),
        ("ros1", rosbag1.Writer.CompressionFormat.LZ4),
    ],
)
def test_compressed_bags(kind, compress, tmp_path):
    write_rig(tmp_path / "set/one", kind, compress=compress)
    data = Rosbags(str(tmp_path / "set"), {"/right/image_raw": "digit"}, val=0)
    (one,) = data.recordings("train")
    np.testing.assert_array_equal(one.frames.read([9])[0], picture(9))


@each
def test_topics_alone_make_no_force(kind, tmp_path):
    path = write_rig(tmp_path / "set/one", kind)
    data = Rosbags(str(path), {"/left/image/compressed": "digit"}, val=0, licence="MIT")
    (one,) = data.recordings("train")
    assert one.key == "one/left_image_compressed"
    assert (one.force, one.no_contact, one.image, one.licence) == (None, None, None, "MIT")
    assert {*one.tracks} == {"state", "joint_velocity", "wrench_ft_wrench"}
    np.testing.assert_allclose(one.tracks["wrench_ft_wrench"][2], [8.6, 2, -4.3, 0.1, 0.2, 0.3])
    assert data.provides == frozenset()


def test_a_wrench_is_between_the_two_nearest_and_exact_at_a_stamp():
    times = np.array([30, 0, 10, 20]) * 10**6
    values = np.array([[3, 7], [0, 1], [1, np.nan], [2, 5]], np.float32)
    at = np.array([-2, 0, 5, 10, 25, 30, 33, 90]) * 10**6
    found, near = between(times, at, 0.008, values)
    np.testing.assert_array_equal(near, [True] * 7 + [False])
    np.testing.assert_array_equal(found[:7, 0], np.float32([0, 0, 0.5, 1, 2.5, 3, 3]))
    np.testing.assert_array_equal(found[:7, 1], np.float32([1, 1, np.nan, np.nan, 6, 7, 7]))
    # one of the two is too far: the nearest counts
    far, _ = between(times, np.array([27 * 10**6]), 0.006, values)
    assert far[0, 0] == 3


def test_a_wrench_of_another_frame_is_a_track_and_said_so(tmp_path):
    lines = RIG_MAP.replace("unit: mN", "unit: mN, at: flange")
    write_rig(tmp_path / "set/one", "mcap")
    (tmp_path / "m.yaml").write_text(lines)
    data = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "m.yaml"), val=0)
    left = next(data.recordings("train"))
    assert left.force is None
    assert left.tracks["wrench"].shape == (20, 6)
    assert any("/ft/wrench: not on the gel (at: flange)" in note for note in data.notes)


@each
def test_intervals_are_recordings(kind, tmp_path):
    more = """intervals:
  pick:
    - {start: 0.2, stop: 0.4, object: can, labels: {trial: 3}}
    - {start: 0.5, stop: 0.62}
    - {start: 70, stop: 71}
"""
    found, data = rig(tmp_path, kind, more)
    keys = [one.key for one in data.recordings("train")]
    assert keys == ["pick/000/left", "pick/001/left", "pick/000/right", "pick/001/right"]
    first = next(iter(data.recordings("train")))
    # the bag begins 10 ms before the first picture
    assert (first.object, first.labels["trial"], first.labels["episode"]) == ("can", 3, "pick_000")
    np.testing.assert_array_equal(first.frames.read([0])[0], picture(5))
    assert len(first.frames) == 5
    assert found["left"].object == "mug"
    assert any("no frame from 70 s to 71 s" in line for line in data.skipped)


def test_the_background_of_the_bag(tmp_path):
    more = "intervals: {pick: [{start: 0.2, stop: 0.4}]}\n"
    found, _ = rig(tmp_path, "mcap", more, background="bag")
    np.testing.assert_array_equal(found["left"].background(), picture(0))
    found, _ = rig(tmp_path / "first", "mcap", more)
    np.testing.assert_array_equal(found["left"].background(), picture(5))


def test_without_stamps_the_time_of_recording_counts(tmp_path):
    rows = [*frame_rows("sqlite3", "/gel", 6, stamped=False)]
    write(tmp_path / "one", "sqlite3", rows)
    data = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0)
    (one,) = data.recordings("train")
    np.testing.assert_array_equal(one.times, np.arange(6) / HZ)
    assert data.notes == ["/gel: headers without stamps, so the time of recording counts"]


def test_stamps_or_the_time_of_recording(tmp_path):
    make = Messages("mcap")
    late = [0, 30, 5, 20]  # ms from stamp to recording
    rows = [
        (
            "/gel",
            BEGIN + i * 40_000_000 + ms * 10**6,
            make.compressed(BEGIN + i * 40_000_000, picture(i)),
        )
        for i, ms in enumerate(late)
    ]
    write(tmp_path / "one", "mcap", rows)
    found = {
        clock: next(
            Rosbags(str(tmp_path), {"/gel": "digit"}, clock=clock, val=0).recordings("train")
        )
        for clock in ("header", "bag")
    }
    np.testing.assert_allclose(found["header"].times, [0, 0.04, 0.08, 0.12])
    np.testing.assert_allclose(found["bag"].times, [0, 0.07, 0.085, 0.14])


def test_a_wrench_without_stamps_is_put_on_the_clock_of_stamps(tmp_path):
    make = Messages("ros1")
    rows = [*frame_rows("ros1", "/gel", 8)]
    for i in range(32):
        time = BEGIN + i * 10**7
        rows.append(("/ft", time, make.wrench(time, (0, 0, i), stamped=False)))
    write(tmp_path / "one", "ros1", sorted(rows, key=lambda row: row[1]))
    data = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0)
    (one,) = data.recordings("train")
    # recorded at the same time as the picture
    np.testing.assert_array_equal(one.tracks["wrench_ft"][:, 2], 4 * np.arange(8))
    assert any(f"delay of /gel ({DELAY / 1e6:g} ms)" in note for note in data.notes)


@each
@pytest.mark.parametrize("shift", [0.0, 36.0, 0.5, -0.5])
def test_stamps_of_two_clocks_are_said_with_the_key(kind, shift, tmp_path):
    """A camera that counts TAI, or hangs on a machine whose clock is half a second ahead."""
    make, ahead = Messages(kind), int(shift * 1e9)
    rows = []
    for i in range(40):
        at = BEGIN + i * 10**9 // (1 if shift == 36 else HZ)  # the times of both overlap
        rows.append(("/gel", at, make.compressed(at - DELAY + ahead, picture(i))))
        rows.append(("/ft", at, make.wrench(at - DELAY // 4, (0, 0, i))))
    write(tmp_path / "one", kind, rows)
    said = {}
    for clock in ("header", "bag"):
        data = Rosbags(str(tmp_path), {"/gel": "digit"}, clock=clock, val=0)
        (one,) = data.recordings("train")
        said[clock] = [note for note in data.notes if "clocks differ" in note]
    # by the times of recording each picture has the force of its own moment
    np.testing.assert_array_equal(one.tracks["wrench_ft"][:, 2], np.arange(40))
    assert said["bag"] == []
    assert len(said["header"]) == bool(shift)
    if shift:
        (line,) = said["header"]
        assert line.count("/gel") == line.count("/ft") == 1
        apart = float(line.partition("differ by ")[2].partition(" s")[0])
        assert apart == pytest.approx(abs(shift), rel=0.02)
        assert line.endswith("data.clock=bag takes the times of recording for both")


def test_an_optional_topic_that_only_some_bags_have_is_said(tmp_path):
    for name in ("one", "two", "three"):
        rows = [row for row in rig_rows("mcap") if name != "two" or row[0] != "/ft/wrench"]
        write(tmp_path / "set" / name, "mcap", rows)
    force = "force: {topic: '/ft/wrench?', unit: N}, finger: left"
    (tmp_path / "m.yaml").write_text(
        f"touch: [{{topic: /left/image/compressed, sensor: digit, {force}}}]\n"
        "camera: {topic: '/elsewhere?'}\n"  # in no bag, which is no doubt
    )
    data = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "m.yaml"), val=0)
    known = {one.key.partition("/")[0]: one.force is not None for one in data.recordings("train")}
    assert known == {"one": True, "three": True, "two": False}
    (line,) = [note for note in data.notes if ": no '" in note]
    assert line == (
        f"{tmp_path}/set/two: no '/ft/wrench', which 2 of 3 have; copy it again, or leave the "
        "key out of the map"
    )


def test_values_farther_than_the_gap_are_unknown(tmp_path):
    make = Messages("mcap")
    rows = [*frame_rows("mcap", "/gel", 20)]
    rows.append(("/ft", BEGIN, make.wrench(BEGIN, (0, 0, 1))))
    write(tmp_path / "one", "mcap", sorted(rows, key=lambda row: row[1]))
    (one,) = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0).recordings("train")
    known = np.isfinite(one.tracks["wrench_ft"][:, 2])
    np.testing.assert_array_equal(np.flatnonzero(known), [0, 1, 2])  # within .1 s


def test_joints_of_two_publishers_are_side_by_side(tmp_path):
    make = Messages("sqlite3")
    rows = [*frame_rows("sqlite3", "/gel", 4)]
    for i in range(8):
        time = BEGIN + i * 2 * 10**7
        rows.append(("/joint_states", time, make.joints(time, ("a", "b"), (i, i + 0.5))))
        rows.append(("/joint_states", time + 1, make.joints(time, ("finger",), (-i,), (), (3.0,))))
        # the same joints in another order
        rows.append(("/joint_states", time + 2, make.joints(time, ("b", "a"), (i + 0.5, i))))
    write(tmp_path / "one", "sqlite3", sorted(rows, key=lambda row: row[1]))
    (one,) = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0).recordings("train")
    assert one.labels["joints"] == "a b finger"
    np.testing.assert_array_equal(one.tracks["state"][2], [4, 4.5, -4])
    np.testing.assert_array_equal(one.tracks["joint_effort"][:, 2], [3.0] * 4)
    assert np.isnan(one.tracks["joint_effort"][:, :2]).all()
    assert "joint_velocity" not in one.tracks


@each
def test_a_clip_reads_its_messages_alone(kind, tmp_path, monkeypatch):
    write(tmp_path / "one", kind, frame_rows(kind, "/gel", 60))
    (one,) = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0).recordings("train")
    decoded = []
    kept = topic_frames.image_of
    monkeypatch.setattr(topic_frames, "image_of", lambda m: decoded.append(1) or kept(m))
    asked = []
    messages = bags.Bag.messages

    def spied(self, topic, start=None, stop=None):
        for pair in messages(self, topic, start, stop):
            asked.append(pair[0])
            yield pair

    monkeypatch.setattr(bags.Bag, "messages", spied)
    frames = one.frames.read([40, 42, 44, 10])
    np.testing.assert_array_equal(frames[3], picture(10))
    assert len(decoded) == 4
    assert len(asked) == 6  # 10, and 40 to 44 in one go


def test_messages_of_the_same_time_are_told_apart(tmp_path):
    for kind in KINDS:
        make = Messages(kind)
        rows = [
            ("/gel", BEGIN + i // 3, make.compressed(BEGIN + 10**6 * i, picture(i)))
            for i in range(9)
        ]
        write(tmp_path / kind / "one", kind, rows)
        (one,) = Rosbags(str(tmp_path / kind), {"/gel": "digit"}, val=0).recordings("train")
        np.testing.assert_array_equal(one.frames.read([7, 4])[:, 0, 0, 0], [47, 44])


def test_bags_are_found_as_folders_and_files(tmp_path):
    write_rig(tmp_path / "set/a/pick", "mcap")
    write_rig(tmp_path / "set/b/pick", "ros1")
    loose = write_rig(tmp_path / "loose", "sqlite3")
    (tmp_path / "set/c").mkdir()
    next(loose.glob("*.db3")).rename(tmp_path / "set/c/alone.db3")
    data = Rosbags(str(tmp_path / "set"), {"/right/image_raw": "digit"}, val=0)
    keys = [one.key.rpartition("/")[0] for one in data.recordings("train")]
    assert keys == ["a/pick", "b/pick", "c/alone"]


def test_whole_bags_are_held_out(tmp_path):
    for i in range(12):
        write(tmp_path / f"bag_{i}", "mcap", frame_rows("mcap", "/gel", 2))
    data = Rosbags(str(tmp_path), {"/gel": "digit"}, val=0.4)
    keys = {split: {one.key for one in data.recordings(split)} for split in ("train", "val")}
    assert keys["val"]
    assert not keys["train"] & keys["val"]
    assert len(keys["train"] | keys["val"]) == 12


def test_the_plugin_conforms(tmp_path):
    write_rig(tmp_path / "one", "mcap")
    results = check("dataset", Rosbags, root=str(tmp_path), topics={"/right/image_raw": "digit"})
    assert [one for one in results if one.status == "failed"] == []
    assert sum(one.status == "ran" for one in results) >= 5
