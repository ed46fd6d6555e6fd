"""Damaged or contradictory bags are named and left out; the rest is read."""

import builtins
import os
import shutil
import sqlite3
import struct
from contextlib import closing
from types import SimpleNamespace

import lz4.frame
import numpy as np
import pytest
from made_bags import (
    BEGIN,
    HZ,
    KINDS,
    Messages,
    frame_rows,
    picture,
    store_of,
    write,
    write_rig,
)
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2.writer import zstd
from tactileforge_rosbags import bags, guards
from tactileforge_rosbags.dataset import Rosbags

from tactileforge.plugin import ConfigError, DataError, DataNotFoundError

each = pytest.mark.parametrize("kind", KINDS)
LEFT = "/left/image/compressed"


def data(root, topics=("/gel",), **options):
    return Rosbags(str(root), dict.fromkeys(topics, "digit"), val=0, **options)


def refused(made, wanted, kind=DataError):
    with pytest.raises(kind, match=wanted) as error:
        list(made.recordings("train"))
    assert "\n" not in str(error.value)


def mapped(tmp_path, lines):
    (tmp_path / "m.yaml").write_text(lines)
    return Rosbags(str(tmp_path / "set"), map=str(tmp_path / "m.yaml"), val=0)


def swap(rows, changes):
    """Rows with some messages changed, by their number."""
    return [(t, at, changes.get(i, message)) for i, (t, at, message) in enumerate(rows)]


def test_a_folder_without_bags(tmp_path):
    wanted = "no bag: no folder with metadata.yaml.*set data.root"
    refused(data(tmp_path), wanted, DataNotFoundError)
    refused(data(tmp_path / "gone"), wanted, DataNotFoundError)
    (tmp_path / "metadata.yaml").write_text("a: 1")
    refused(data(tmp_path), wanted, DataNotFoundError)


def test_no_topic_is_named(tmp_path):
    write_rig(tmp_path / "one", "mcap")
    made = Rosbags(str(tmp_path))
    wanted = r"which topics are touch\?.*topics of pictures: /left/image/compressed, /right"
    refused(made, wanted, ConfigError)
    assert made.provides == frozenset()


@each
def test_an_unknown_topic_names_the_nearest(kind, tmp_path):
    write_rig(tmp_path / "one", kind)
    made = data(tmp_path, ("/left/image/compress", LEFT))
    assert [one.key for one in made.recordings("train")] == ["one/left_image_compressed"]
    (line,) = made.skipped
    assert "unknown topic '/left/image/compress'; did you mean '/left/image/compressed'?" in line


def test_a_bag_without_touch(tmp_path):
    write_rig(tmp_path / "one", "mcap")
    refused(data(tmp_path, ("/none",)), r"no topic of touch \(/none\); topics of pictures: /left")


@each
def test_a_topic_of_another_type(kind, tmp_path):
    write_rig(tmp_path / "one", kind)
    wanted = "/notes: messages of std_msgs/msg/String, where sensor_msgs/msg/Image or .*/left/image"
    refused(data(tmp_path, ("/notes",)), wanted)


@each
def test_an_own_type_is_named_and_never_built(kind, tmp_path):
    from rosbags.typesys import get_types_from_msg

    store = store_of(kind)
    store.register(get_types_from_msg("float32 pressure", "mine/msg/Taxel"))
    message = store.types["mine/msg/Taxel"](pressure=2.0)
    rows = [*frame_rows(kind, "/gel", 2)]
    path = write(tmp_path / "one", kind, rows)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    made = {"ros1": bags_writer_1, "sqlite3": bags_writer_2, "mcap": bags_writer_2}[kind]
    made(path, kind, store, message)
    refused(data(tmp_path, ("/taxels",)), "messages of mine/msg/Taxel, where sensor_msgs/msg/Image")


def bags_writer_1(path, kind, store, message):
    from rosbags import rosbag1

    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/taxels", "mine/msg/Taxel", typestore=store)
        writer.write(connection, BEGIN, bytes(store.serialize_ros1(message, "mine/msg/Taxel")))


def bags_writer_2(path, kind, store, message):
    plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/taxels", "mine/msg/Taxel", typestore=store)
        writer.write(connection, BEGIN, bytes(store.serialize_cdr(message, "mine/msg/Taxel")))


def test_another_type_by_a_name_of_ros_is_refused(tmp_path):
    store = store_of("sqlite3")
    with rosbag2.Writer(tmp_path / "one", version=9) as writer:
        connection = writer.add_connection(
            "/gel",
            "sensor_msgs/msg/Image",
            msgdef="int8 evil",
            rihs01="RIHS01_" + "0" * 64,
        )
        message = Messages("sqlite3").raw(BEGIN, picture(0))
        writer.write(connection, BEGIN, bytes(store.serialize_cdr(message, message.__msgtype__)))
    refused(data(tmp_path), "its sensor_msgs/msg/Image is not that of ROS")


def test_an_unknown_encoding(tmp_path):
    make = Messages("mcap")
    odd = make.raw(BEGIN, picture(0))
    odd.encoding = "bayer_rggb8"
    write(tmp_path / "one", "mcap", [("/gel", BEGIN, odd)])
    wanted = "none of its 1 messages can be read; message 0, encoding 'bayer_rggb8', where rgb8, "
    refused(data(tmp_path), wanted)
    video = make.compressed(BEGIN, picture(0), "h264", b"\0\0\0\1g")
    write(tmp_path / "two/one", "mcap", [("/gel", BEGIN, video)])
    refused(data(tmp_path / "two"), r"format 'h264': no readable picture \(5 bytes\)")
    depth = make.compressed(BEGIN, picture(0), "16UC1; compressedDepth png", b"\0\0\0\1g")
    write(tmp_path / "three/one", "mcap", [("/gel", BEGIN, depth)])
    refused(data(tmp_path / "three"), "is a depth, and no picture")


@each
def test_damaged_pictures_are_counted_and_the_rest_is_read(kind, tmp_path):
    make = Messages(kind)
    rows = [*frame_rows(kind, "/gel", 10)]
    whole = rows[4][2].data.tobytes()
    time = BEGIN + 4 * 10**9 // HZ
    cut = make.compressed(time, picture(4), data=whole[:-20])
    rows = swap(rows, {3: make.compressed(time - 1, picture(3), data=b"no picture"), 4: cut})
    write(tmp_path / "one", kind, rows)
    made = data(tmp_path)
    (one,) = made.recordings("train")
    assert len(one.frames) == len(one.times) == 8
    np.testing.assert_array_equal(one.frames.read([3])[0], picture(5))
    (line,) = made.skipped
    assert line.endswith(
        "/gel: 2 of 10 messages left out, the first: message 3, format 'png': no readable picture "
        "(10 bytes)"
    )


def test_raw_pictures_with_too_few_bytes(tmp_path):
    rows = [*frame_rows("ros1", "/gel", 4, raw="rgb8")]
    rows[2][2].data = rows[2][2].data[:-5]
    write(tmp_path / "one", "ros1", rows)
    made = data(tmp_path)
    (one,) = made.recordings("train")
    assert len(one.frames) == 3
    assert "message 2, 2299 bytes for 32 x 24 pixels in rows of 72 bytes" in made.skipped[0]


def test_pictures_of_another_size_are_counted(tmp_path):
    make = Messages("mcap")
    rows = swap(frame_rows("mcap", "/gel", 4), {1: make.compressed(BEGIN, picture(1, 8, 8))})
    write(tmp_path / "one", "mcap", rows)
    made = data(tmp_path, clock="bag")
    (one,) = made.recordings("train")
    assert len(one.frames) == 3
    assert "1 pictures left out: of 8 x 8 pixels, where the first has 32 x 24" in made.skipped[0]


def test_a_picture_damaged_within_is_named_when_it_is_read(tmp_path):
    rows = [*frame_rows("mcap", "/gel", 3)]
    raw = bytearray(rows[1][2].data.tobytes())
    middle = len(raw) // 2
    raw[middle : middle + 8] = b"\xff" * 8
    rows[1][2].data = np.frombuffer(bytes(raw), np.uint8)
    write(tmp_path / "one", "mcap", rows)
    (one,) = data(tmp_path).recordings("train")
    with pytest.raises(DataError, match="/gel, frame 1: not a readable image"):
        one.frames.read([0, 1])


def test_times_that_fall_are_refused_and_repeated_ones_counted(tmp_path):
    make = Messages("sqlite3")
    rows = [*frame_rows("sqlite3", "/gel", 6)]
    changes = {4: make.compressed(BEGIN - 2 * 10**9, picture(4))}
    write(tmp_path / "falls/one", "sqlite3", swap(rows, changes))
    refused(data(tmp_path / "falls"), "times fall by 2.116 s at message 4; give data.clock=bag")
    assert len(next(data(tmp_path / "falls", clock="bag").recordings("train")).times) == 6
    repeated = make.compressed(BEGIN + 2 * 10**9 // HZ - 4_000_000, picture(3))
    write(tmp_path / "same/one", "sqlite3", swap(rows, {3: repeated}))
    made = data(tmp_path / "same")
    (one,) = made.recordings("train")
    assert len(one.frames) == 5
    assert made.skipped[0].endswith("1 of 6 frames left out: they repeat a time")


@each
def test_an_empty_bag_and_an_empty_topic(kind, tmp_path):
    write(tmp_path / "none/one", kind, [])
    refused(data(tmp_path / "none"), "no message; record it again")
    if kind != "ros1":
        with rosbag2.Writer(tmp_path / "topic/one", version=9) as writer:
            writer.add_connection("/gel", "sensor_msgs/msg/Image", typestore=store_of(kind))
            other = writer.add_connection("/s", "std_msgs/msg/String", typestore=store_of(kind))
            raw = store_of(kind).serialize_cdr(Messages(kind).text("x"), "std_msgs/msg/String")
            writer.write(other, BEGIN, bytes(raw))
        refused(data(tmp_path / "topic"), "/gel: no message; record it again")


@each
@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_a_truncated_bag_is_left_out(kind, share, tmp_path):
    write(tmp_path / "good", kind, frame_rows(kind, "/gel", 30))
    path = write(tmp_path / "bad", kind, frame_rows(kind, "/gel", 30))
    file = next(one for one in path.iterdir() if one.suffix != ".yaml") if path.is_dir() else path
    raw = file.read_bytes()
    file.write_bytes(raw[: int(share * len(raw))])
    made = data(tmp_path)
    assert [one.key for one in made.recordings("train")] == ["good/gel"]
    (line,) = made.skipped
    assert "bad" in line
    assert "\n" not in line


def test_metadata_that_is_no_metadata(tmp_path):
    path = write(tmp_path / "bad", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    write(tmp_path / "good", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    for text in ("[", "a: 1", "!!python/object/apply:os.system ['true']"):
        (path / "metadata.yaml").write_text(text)
        made = data(tmp_path)
        assert [one.key for one in made.recordings("train")] == ["good/gel"]
        assert "bad: cannot be read (" in made.skipped[0]


def test_compression_that_is_not_known_is_named(tmp_path):
    path = write(tmp_path / "one", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    text = (path / "metadata.yaml").read_text()
    text = text.replace("compression_format: ''", "compression_format: snappy")
    text = text.replace("compression_mode: ''", "compression_mode: message")
    (path / "metadata.yaml").write_text(text)
    refused(data(tmp_path), "'snappy' is not supported")
    rows = frame_rows("mcap", "/gel", 3)
    path = write(tmp_path / "two/one", "mcap", rows, rosbag2.CompressionMode.STORAGE)
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes().replace(b"zstd", b"zpaq"))
    refused(data(tmp_path / "two"), "Unsupported chunk compression 'zpaq'")


def test_a_part_of_rosbags_that_is_absent_is_named(tmp_path, monkeypatch):
    write(tmp_path / "one", "mcap", frame_rows("mcap", "/gel", 3))
    kept = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'lz4'")
        return kept(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    wanted = r"cannot import rosbags \(No module named 'lz4'\): pip install rosbags lz4"
    refused(data(tmp_path), wanted, ConfigError)


def test_a_damaged_chunk_is_named(tmp_path):
    path = write(
        tmp_path / "one",
        "mcap",
        frame_rows("mcap", "/gel", 40),
        rosbag2.CompressionMode.STORAGE,
    )
    file = next(path.glob("*.mcap"))
    raw = bytearray(file.read_bytes())
    begin = raw.index(b"\x28\xb5\x2f\xfd")  # of a frame of zstd
    raw[begin + 4 : begin + 12] = b"\xff" * 8
    file.write_bytes(bytes(raw))
    refused(data(tmp_path), r"one: cannot be read \(.*mcap recover")


def test_a_path_that_sqlite_misreads(tmp_path):
    write(tmp_path / "50%", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    refused(data(tmp_path), r"sqlite misreads \?, # and % in a path; rename")
    write(tmp_path / "mcap/50%", "mcap", frame_rows("mcap", "/gel", 3))
    assert len(list(data(tmp_path / "mcap").recordings("train"))) == 1


def test_a_bag_that_changes_is_read_anew(tmp_path):
    path = write(tmp_path / "one", "sqlite3", frame_rows("sqlite3", "/gel", 6))
    (one,) = data(tmp_path).recordings("train")
    with sqlite3.connect(next(path.glob("*.db3"))) as base:
        base.execute("DELETE FROM messages WHERE id = 3")
    base.close()
    with pytest.raises(DataError, match="/gel: has changed since it was opened; start again"):
        one.frames.read([2])
    assert len(next(data(tmp_path).recordings("train")).frames) == 5
    with pytest.raises(DataError, match="frame 9 of 6 is not there"):
        one.frames.read([9])


def test_a_wrench_of_another_clock(tmp_path):
    make = Messages("mcap")
    rows = [*frame_rows("mcap", "/gel", 5)]
    rows.append(("/ft", BEGIN, make.wrench(10**9, (0, 0, 1))))
    write(tmp_path / "set/one", "mcap", rows)
    wanted = "/ft: no message within 0.1 s of a frame of /gel; if their stamps are of different"
    lines = "touch: [{topic: /gel, sensor: digit, force: {topic: /ft}}]"
    refused(mapped(tmp_path, lines), wanted)
    made = data(tmp_path / "set")  # of topics that nobody named, it is a note
    (one,) = made.recordings("train")
    assert "wrench_ft" not in one.tracks
    assert any("/ft: no message within" in note for note in made.notes)
    assert "wrench_ft" in next(data(tmp_path / "set", clock="bag").recordings("train")).tracks


def test_topics_of_a_map_that_are_absent(tmp_path):
    write(tmp_path / "set/one", "mcap", frame_rows("mcap", "/gel", 5))
    lines = 'touch: [{topic: /gel, sensor: digit, force: {topic: "/ft%s"}}]\n'
    refused(mapped(tmp_path, lines % ""), "unknown topic '/ft'")
    lines = lines % "?" + 'state: ["/arm?"]\ntracks: {wrist: "/w?"}\ncamera: {topic: "/c?"}\n'
    (one,) = mapped(tmp_path, lines).recordings("train")
    assert (one.force, one.image, dict(one.tracks)) == (None, None, {})


def test_joints_without_names_or_of_other_lengths_are_counted(tmp_path):
    make = Messages("mcap")
    rows = [*frame_rows("mcap", "/gel", 5)]
    rows += [
        ("/j", BEGIN, make.joints(BEGIN, ("a", "b"), (1.0, 2.0))),
        ("/j", BEGIN + 1, make.joints(BEGIN, ("a", "a"), (1.0, 2.0))),
        ("/j", BEGIN + 2, make.joints(BEGIN, ("a", "b"), (1.0,))),
    ]
    write(tmp_path / "one", "mcap", sorted(rows, key=lambda row: row[1]))
    made = data(tmp_path)
    (one,) = made.recordings("train")
    assert one.tracks["state"].shape == (5, 2)
    assert "/j: 2 of 3 messages left out, the first: message 1, joints without" in made.skipped[0]


@pytest.mark.parametrize(
    ("lines", "wanted"),
    [
        ("touch: []", "touch is empty"),
        ("touch: [{topic: /gel, sensor: digit}]\nfps: 3", "unknown key of .*'fps'"),
        ("touch: [{topic: /gel}]", "sensor"),
        ("touch: [{topic: /gel, sensor: digitt}]", "/gel: unknown sensor 'digitt'; did you mean"),
        ("touch: [{topic: /gel, sensor: digit}]\ngap: 0", "gap is 0"),
        (
            "touch: [{topic: /gel, sensor: digit}, {topic: /gel, sensor: digit}]",
            "two touches are called 'gel'",
        ),
        (
            "touch: [{topic: /gel, sensor: digit}]\nintervals: {one: [{start: 2, stop: 1}]}",
            "intervals of one: 2.* s to 1.* s",
        ),
        (
            "touch: [{topic: /gel, sensor: digit}]\nintervals: {onne: [{start: 0, stop: 1}]}",
            "unknown bag of `intervals` 'onne'; did you mean 'one'",
        ),
        (
            "touch: [{topic: /g, sensor: digit, force: {topic: /w, columns: [0, 1, 7]}}]",
            r"columns \(0, 1, 7\)",
        ),
    ],
)
def test_maps_that_contradict_themselves(lines, wanted, tmp_path):
    write(tmp_path / "set/one", "mcap", frame_rows("mcap", "/gel", 3))
    refused(mapped(tmp_path, lines), wanted, ConfigError)


def test_options_that_contradict_each_other(tmp_path):
    with pytest.raises(ConfigError, match="not both"):
        Rosbags(".", {"/gel": "digit"}, map="m.yaml")
    with pytest.raises(ConfigError, match=r"val is 1; give the share"):
        Rosbags(".", {"/gel": "digit"}, val=1)
    refused(Rosbags(".", map=str(tmp_path / "gone.yaml")), "gone.yaml: cannot be read", ConfigError)
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        next(data(tmp_path).recordings("test"))


def test_few_bags_stay_open(tmp_path):
    for i in range(8):
        write(tmp_path / f"bag_{i}", "mcap", frame_rows("mcap", "/gel", 2))
    every = list(data(tmp_path).recordings("train"))
    assert len(bags._OPEN._bags) == bags._KEPT
    assert [int(one.frames.read([1])[0, 0, 0, 0]) for one in every] == [41] * 8


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_zstd_that_unpacks_to_anything_is_named(mode, tmp_path):
    """96 MB of a file of 10 kB: the limit is 64 MB if less than a 50th is stored."""
    bomb = zstd.compress(bytes(96 << 20))
    assert len(bomb) < 20_000
    write(tmp_path / "one", "mcap", frame_rows("mcap", "/gel", 4))
    mode = rosbag2.CompressionMode[mode]
    path = write(tmp_path / "two", "sqlite3", frame_rows("sqlite3", "/gel", 4), mode)
    if mode is rosbag2.CompressionMode.FILE:
        next(path.glob("*.zstd")).write_bytes(bomb)
        wanted = f"two.db3.zstd: {96 << 20} bytes unpacked from {len(bomb)}: no data compress so"
    else:
        with sqlite3.connect(next(path.glob("*.db3"))) as file:
            file.execute("UPDATE messages SET data = ? WHERE id = 2", (bomb,))
        file.close()
        wanted = f"two: a message of {len(bomb)} bytes unpacks to more: {96 << 20} bytes"
    made = data(tmp_path)
    assert [one.key for one in made.recordings("train")] == ["one/gel"]
    (line,) = made.skipped
    assert wanted in line


@pytest.fixture
def small_limit(monkeypatch):
    """A limit of 1 MB for all unpacked bytes together."""
    monkeypatch.setattr(guards, "MOST_BYTES", 1 << 20)
    monkeypatch.setattr(bags, "MOST_BYTES", 1 << 20)


def of_zeros(kind, count=2 << 20):
    """Small pictures, and a text of zeros between them."""
    rows = [*frame_rows(kind, "/gel", 3)]
    return [*rows[:2], ("/notes", rows[1][1] + 1, Messages(kind).text("\0" * count)), *rows[2:]]


def without_index(path):
    """Has an mcap scanned: its footer names no summary."""
    raw = bytearray(path.read_bytes())
    raw[-28:-20] = bytes(8)
    path.write_bytes(raw)


def test_a_chunk_of_mcap_is_unpacked_within_the_limit(small_limit, tmp_path):
    storage = rosbag2.CompressionMode.STORAGE
    write(tmp_path / "good/one", "mcap", of_zeros("mcap", 1000), storage)
    assert len(next(data(tmp_path / "good").recordings("train")).frames) == 3
    without_index(tmp_path / "good/one/one.mcap")
    assert len(next(data(tmp_path / "good").recordings("train")).frames) == 3
    write(tmp_path / "set/one", "mcap", of_zeros("mcap"), storage)
    refused(data(tmp_path / "set"), r"set/one: a chunk of \d+ bytes unpacks to 2\d+ bytes; record")
    without_index(tmp_path / "set/one/one.mcap")
    refused(data(tmp_path / "set"), r"one.mcap: a chunk of \d+ bytes unpacks to 2\d+ bytes; record")


def test_a_chunk_of_mcap_that_says_less_than_it_unpacks_to():
    content = bytes(2 << 20)
    for coding, pack in (("zstd", zstd.compress), ("lz4", lz4.frame.compress)):
        guards.check_chunk("a", coding, pack(content), len(content))
        guards.check_chunk("a", coding, pack(content)[:-9], len(content))  # its reader says so
    with pytest.raises(DataError, match="unpacks to more than the 4096 bytes"):
        guards.check_chunk("a", "lz4", lz4.frame.compress(content), 4096)
    and_more = lz4.frame.compress(bytes(4096)) + lz4.frame.compress(b"x")
    with pytest.raises(DataError, match="unpacks to more than the 4096 bytes"):
        guards.check_chunk("a", "lz4", and_more, 4096)
    several = zstd.compress(b"x") + zstd.compress(bytes(1 << 25)) * 3
    with pytest.raises(DataError, match="more than the 4096 bytes that it says"):
        guards.check_chunk("a", "zstd", several, 4096)
    with pytest.raises(DataError, match="no data compress so well"):
        guards.check_chunk("a", "", b"x", 1 << 27)


@pytest.mark.parametrize(
    "compress", [rosbag1.Writer.CompressionFormat.BZ2, rosbag1.Writer.CompressionFormat.LZ4]
)
def test_a_chunk_of_ros_1_is_unpacked_within_the_limit(compress, small_limit, tmp_path):
    write(tmp_path / "good/one", "ros1", of_zeros("ros1", 1000), compress)
    assert len(next(data(tmp_path / "good").recordings("train")).frames) == 3
    write(tmp_path / "set/one", "ros1", of_zeros("ros1"), compress)
    refused(data(tmp_path / "set"), r"one.bag: a chunk of \d+ bytes unpacks to more than 1048576; ")


def test_a_message_of_several_frames_of_zstd(small_limit, tmp_path):
    write(
        tmp_path / "one",
        "sqlite3",
        frame_rows("sqlite3", "/gel", 3),
        rosbag2.CompressionMode.MESSAGE,
    )
    with closing(sqlite3.connect(tmp_path / "one/one.db3")) as base:
        (first,) = base.execute("SELECT data FROM messages WHERE id = 1").fetchone()
        base.execute(
            "UPDATE messages SET data = ? WHERE id = 1", (first + zstd.compress(bytes(2 << 20)),)
        )
        base.commit()
    refused(data(tmp_path), r"a message of \d+ bytes unpacks to more: \d+ bytes")


def test_a_hole_in_an_mcap(tmp_path):
    path = write(tmp_path / "set/one", "mcap", frame_rows("mcap", "/gel", 3)) / "one.mcap"
    without_index(path)
    raw = path.read_bytes()
    path.write_bytes(raw[:-37] + bytes(900) + raw[-37:])
    refused(data(tmp_path / "set"), f"one.mcap: no record at byte {len(raw) - 37}; mend it: mcap")
    path.write_bytes(raw[:-20])
    refused(data(tmp_path / "set"), "set/one: cannot be read .ReaderError: File end magic")


def test_a_chunk_is_checked_where_its_index_says_it_is(tmp_path):
    packed = lz4.frame.compress(bytes(2 << 20))
    head = struct.pack("<BQQQQI", 6, 0, 0, 1, 4096, 0) + struct.pack(
        "<I3sQ", 3, b"lz4", len(packed)
    )
    (tmp_path / "one.mcap").write_bytes(bytes(8) + head + packed)
    chunk = SimpleNamespace(
        chunk_start_offset=8,
        compression="lz4",
        compressed_size=len(packed),
        uncompressed_size=4096,
        message_start_time=0,
        message_end_time=1,
    )
    storage = SimpleNamespace(
        chunks=[chunk], path=tmp_path / "one.mcap", messages=lambda *_: iter(())
    )
    checked = guards.CheckedChunks("one", storage)
    assert list(checked.messages([], 2)) == [], "of another time"
    with pytest.raises(DataError, match=r"one: a chunk of .* more than the 4096 bytes"):
        list(checked.messages([]))
    chunk.compressed_size += 1
    with pytest.raises(DataError, match="its index names a chunk that is not there"):
        list(checked.messages([]))


def test_an_index_that_names_a_chunk_twice(tmp_path):
    path = write(tmp_path / "set/one", "mcap", frame_rows("mcap", "/gel", 3)) / "one.mcap"
    raw = path.read_bytes()
    at = int.from_bytes(raw[-28:-20], "little")
    while raw[at] != 8:
        at += 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
    end = at + 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
    path.write_bytes(raw[:end] + raw[at:end] * 5 + raw[end:])
    refused(data(tmp_path / "set"), "set/one: its index names a chunk twice; mend it: mcap recover")


SCRIPTS = {
    "a view": "ALTER TABLE schema RENAME TO s; CREATE VIEW schema AS WITH RECURSIVE c(x) AS (SELECT"
    " 4 UNION ALL SELECT x FROM c) SELECT max(x) AS schema_version, 'x' AS ros_distro FROM c",
    "a generated column": "ALTER TABLE messages RENAME TO m; CREATE TABLE messages(id INTEGER, "
    "topic_id INTEGER, timestamp INTEGER, raw BLOB, data BLOB AS (zeroblob(900000000)))",
    "a virtual table": "DROP TABLE topics; CREATE VIRTUAL TABLE topics USING fts5(id, name)",
    "a trigger": "CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT 1; END",
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_database_that_runs_something(script, tmp_path):
    write(tmp_path / "one", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    with closing(sqlite3.connect(tmp_path / "one/one.db3")) as base:
        base.executescript(SCRIPTS[script])
    refused(data(tmp_path), r"one/one.db3: '\w+' (is a \w+ that runs|computes values); record it")


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        ("data = 'x'", "TypeError: /gel has a message of <class 'str'> at 17"),
        ("timestamp = 'soon'", "TypeError: /gel has a message of <class 'bytes'> at 'soon'"),
        ("data = zeroblob(2000000)", "one: cannot be read .TooBigError"),
    ],
)
def test_a_database_of_other_values(change, wanted, small_limit, tmp_path):
    write(tmp_path / "one", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    with closing(sqlite3.connect(tmp_path / "one/one.db3")) as base:
        base.execute(f"UPDATE messages SET {change} WHERE id = 2")
        base.commit()
    refused(data(tmp_path), wanted)


@pytest.mark.parametrize(
    ("more", "wanted"),
    [
        ("a: &a [1]\nb: [*a, *a]\n", "metadata.yaml: has aliases, which no bag has; make it again"),
        ("# " + "x" * (1 << 24), "metadata.yaml: 167.* bytes, where 16777216 are the limit"),
    ],
)
def test_a_description_beyond_any_bag(more, wanted, tmp_path):
    write(tmp_path / "one", "sqlite3", frame_rows("sqlite3", "/gel", 3))
    with (tmp_path / "one/metadata.yaml").open("a") as file:
        file.write(more)
    refused(data(tmp_path), wanted)


def test_a_bag_of_a_name_that_is_not_utf_8(tmp_path):
    write(tmp_path / "one", "mcap", frame_rows("mcap", "/gel", 3))
    (tmp_path / "one").rename(os.fsdecode(os.fsencode(tmp_path) + b"/\xff"))
    refused(data(tmp_path), r"^'\\udcff/gel': its name is not UTF-8; rename the file or folder$")
