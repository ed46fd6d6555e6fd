import io
import json
import math
import struct
import tarfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bent import bent

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import description, shards
from tactileforge.data.shards.index import IndexEntry
from tactileforge.errors import ConfigError, DataError, TactileForgeError


@pytest.fixture
def touch() -> Recording:
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (5, 24, 32, 3), np.uint8)
    force = rng.normal(size=(5, 3)).astype(np.float32)
    force[2] = np.nan
    force[3, :2] = np.nan
    return Recording(
        key="cups/7.press [0:5]",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.array([0.0, 0.1, 0.25, 0.3, 1 / 3]),
        no_contact=ArrayFrames(frames[:2]),
        force=force,
        action=np.array([-1, 0, 0, 1, 1]),
        object="cup",
        text="{action} a cup, plainly",
        image=ArrayFrames(frames[3:]),
        image_times=np.array([0.1, 0.3]),
        surface=ArrayFrames(frames[:, ::3, ::4]),
        labels={"hardness": 0.3, "place": "rim"},
        tracks={
            "pose": np.arange(20, dtype=np.float32).reshape(5, 2, 2) / 3,
            "slip": force[:, 0] > 0,
        },
        source="here",
        tier=1,
        licence="CC0-1.0",
    )


def packed(recording: Recording, codec: str = "png") -> shards.Packed:
    def encoded(frames: object) -> list[bytes]:
        assert isinstance(frames, ArrayFrames)
        return [shards.encode_image(picture, codec) for picture in frames.array]

    return shards.Packed(
        shards.describe_recording(recording),
        codec,
        encoded(recording.frames),
        encoded(recording.no_contact),
        encoded(recording.image),
        [shards.encode_image(image, "png") for image in recording.surface.array],
    )


def test_a_recording_comes_back_as_it_went(touch: Recording, tmp_path: Path) -> None:
    shards.write_shard(tmp_path / "a.tar", [packed(touch), packed(touch, "webp")])
    first, second = shards.read_shard(tmp_path / "a.tar")
    for back in (first, second):
        for name in ("key", "sensor", "object", "text", "labels", "source", "tier", "licence"):
            assert getattr(back, name) == getattr(touch, name)
        np.testing.assert_array_equal(back.times, touch.times)
        np.testing.assert_array_equal(back.force, touch.force)
        np.testing.assert_array_equal(back.action, touch.action)
        np.testing.assert_array_equal(back.image_times, touch.image_times)
        for name, values in touch.tracks.items():
            np.testing.assert_array_equal(back.tracks[name], values)
            assert back.tracks[name].dtype == values.dtype
        for name in ("frames", "no_contact", "image", "surface"):
            there, here = getattr(back, name), getattr(touch, name)
            np.testing.assert_array_equal(there.read(range(len(here))), here.array)


def test_what_a_recording_lacks_stays_lacking(touch: Recording, tmp_path: Path) -> None:
    bare = Recording(
        key="bare", sensor="digit", frames=touch.frames, times=touch.times, no_contact=None
    )
    assert isinstance(touch.frames, ArrayFrames)
    frames = [shards.encode_image(picture) for picture in touch.frames.array]
    shards.write_shard(
        tmp_path / "a.tar", [shards.Packed(shards.describe_recording(bare), "jpg", frames, [], [])]
    )
    (back,) = shards.read_shard(tmp_path / "a.tar")
    missing = (back.no_contact, back.force, back.action, back.object, back.text, back.image)
    assert (*missing, back.surface) == (None,) * 7


def test_any_tool_reads_it(touch: Recording, tmp_path: Path) -> None:
    shards.write_shard(tmp_path / "a.tar", [packed(touch)])
    with tarfile.open(tmp_path / "a.tar") as tar:
        names = tar.getnames()
    assert names == [
        "000000.json",
        *(f"000000.background.{i:04d}.png" for i in range(2)),
        *(f"000000.image.{i:04d}.png" for i in range(2)),
        *(f"000000.surface.{i:04d}.png" for i in range(5)),
        *(f"000000.{i:04d}.png" for i in range(5)),
    ]


def _strict(path: Path) -> dict[str, Any]:
    """The description of a shard's only recording, by the letter of the standard."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    with tarfile.open(path) as tar:
        member = tar.extractfile("000000.json")
        assert member is not None
        about = json.loads(member.read(), parse_constant=refuse)
    assert isinstance(about, dict)
    return about


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
def test_what_is_not_known_is_null(touch: Recording, tmp_path: Path, dtype: str) -> None:
    values = (np.arange(20).reshape(5, 2, 2) / 3).astype(dtype)
    values[1, 0, 1] = values[3] = np.nan
    some = replace(
        touch, tracks={"pose": values, "whole": values[:1].repeat(5, 0)}, labels={"mass": math.nan}
    )
    shards.write_shard(tmp_path / "a.tar", [packed(some)])
    about = _strict(tmp_path / "a.tar")
    rows = about["tracks"]["pose"]["values"]
    assert rows[1] == [[float(values[1, 0, 0]), None], values[1, 1].tolist()]
    assert rows[3] == [[None, None], [None, None]]
    assert (about["force"][2], about["labels"]) == (None, {"mass": None})
    (back,) = shards.read_shard(tmp_path / "a.tar")
    np.testing.assert_array_equal(back.tracks["pose"], values)
    assert back.tracks["pose"].dtype == dtype
    assert math.isnan(float(back.labels["mass"]))
    np.testing.assert_array_equal(back.force, touch.force)


def test_a_shard_written_with_nan_is_still_read(touch: Recording, tmp_path: Path) -> None:
    values = np.array([0.0, np.nan, 2.0, 3.0, 4.0])
    shards.write_shard(tmp_path / "a.tar", [packed(replace(touch, tracks={"slip": values}))])
    about = _strict(tmp_path / "a.tar")
    about["tracks"]["slip"]["values"] = values.tolist()
    stated = {key: value for key, value in about.items() if key != "crc32"}
    about["crc32"] = zlib.crc32(json.dumps(stated, sort_keys=True).encode())
    assert "NaN" in json.dumps(about)
    prediction = description.parse_description(json.dumps(about).encode(), "a.tar")
    np.testing.assert_array_equal(description._track(prediction["tracks"]["slip"]), values)


@pytest.mark.parametrize("what", ["force", "times", "track"])
def test_infinity_is_an_error(touch: Recording, tmp_path: Path, what: str) -> None:
    endless = np.full(5, np.inf)
    changed: dict[str, Any] = {
        "force": {"force": np.full((5, 3), np.inf, np.float32)},
        "times": {"times": np.array([0.0, 0.1, 0.2, 0.3, np.nan])},
        "track": {"tracks": {"slip": endless}},
    }
    with pytest.raises(DataError, match=r"cups/7.press.*: .* a number that no JSON has"):
        shards.write_shard(tmp_path / "a.tar", [packed(replace(touch, **changed[what]))])
    assert list(tmp_path.iterdir()) == []


def test_the_same_content_gives_the_same_bytes(touch: Recording, tmp_path: Path) -> None:
    for name in ("a.tar", "b.tar"):
        shards.write_shard(tmp_path / name, [packed(touch)])
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


def test_webdataset_reads_it(touch: Recording, tmp_path: Path) -> None:
    from webdataset.tariterators import group_by_keys, tar_file_iterator

    shards.write_shard(tmp_path / "a.tar", [packed(touch)])
    with (tmp_path / "a.tar").open("rb") as stream:
        members = [{**m, "__url__": "a"} for m in tar_file_iterator(stream)]
    (sample,) = group_by_keys(members)
    assert json.loads(sample["json"])["key"] == touch.key
    assert "0004.png" in sample


def test_jpeg_of_quality_95_is_close() -> None:
    y, x = np.mgrid[:64, :64]
    picture = np.stack([x * 4, y * 4, 255 - x * 2 - y * 2], -1).clip(0, 255).astype(np.uint8)
    raw = shards.encode_image(picture, "jpg")
    assert raw[:2] == b"\xff\xd8"
    from tactileforge.data.frames.encoded import EncodedFrames

    back = EncodedFrames("x", [raw]).read([0])[0]
    assert np.abs(back.astype(int) - picture).mean() < 2
    assert len(shards.encode_image(picture, "jpg", 50)) < len(raw)


def test_a_stopped_write_leaves_no_shard(touch: Recording, tmp_path: Path) -> None:
    def broken():  # type: ignore[no-untyped-def]
        yield packed(touch)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shards.write_shard(tmp_path / "a.tar", broken())
    assert list(tmp_path.iterdir()) == []


def _three(touch: Recording, path: Path) -> list[Recording]:
    """A shard of three recordings, called 0, 1, 2."""
    touches = [replace(touch, key=str(number)) for number in range(3)]
    shards.write_shard(path, [packed(recording) for recording in touches])
    return touches


def _kept(path: Path) -> tuple[list[str], list[str]]:
    said: list[str] = []
    kept = [
        recording.key
        for recording in shards.read_shard(path, lambda error: said.append(str(error)))
    ]
    return kept, said


def test_of_a_shard_that_is_cut_off_the_whole_recordings_are_kept(
    touch: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "a.tar"
    _three(touch, path)
    whole = path.read_bytes()
    *_, last = shards.read_shard(path)
    assert isinstance(last.frames, shards.PackedFrames)
    for size in (int(last.frames.starts[-1]) + 512, int(last.frames.starts[0])):
        path.write_bytes(whole[:size])
        kept, said = _kept(path)
        assert kept == ["0", "1"]
        assert said == [f"{path}: cut off at byte {size}; download or pack it again"]
    with pytest.raises(DataError, match="cut off"):
        list(shards.read_shard(path))


def test_a_flipped_byte_is_found_where_it_lies(touch: Recording, tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    _three(touch, path)
    _, second, _ = shards.read_shard(path)
    assert isinstance(second.frames, shards.PackedFrames)
    raw = bytearray(path.read_bytes())
    raw[int(second.frames.starts[3]) + 512 + 100] ^= 1
    path.write_bytes(raw)
    first, second, third = shards.read_shard(path)
    with pytest.raises(DataError, match=r"000001\.0003\.png of .*a\.tar:1 is damaged"):
        second.frames.read([3])
    for good in (first.frames.read([3]), third.frames.read([3]), second.frames.read([2])):
        assert good.shape == (1, 24, 32, 3)


def test_a_flipped_byte_in_a_description_costs_that_recording(
    touch: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "a.tar"
    _three(touch, path)
    raw = path.read_bytes()
    place = raw.index(b"a cup, plainly", raw.index(b'"key": "1"'))
    path.write_bytes(raw[:place] + b"e" + raw[place + 1 :])
    kept, said = _kept(path)
    assert kept == ["0", "2"]
    assert said == [
        f"{path}:000001.json: damaged (its checksum does not match); download or pack it again"
    ]


def test_a_picture_that_is_not_there_is_named(touch: Recording, tmp_path: Path) -> None:
    path, other = tmp_path / "a.tar", tmp_path / "b.tar"
    _three(touch, path)
    with tarfile.open(path) as tar, tarfile.open(other, "w", format=tarfile.USTAR_FORMAT) as out:
        for member in tar:
            if member.name != "000001.background.0001.png":
                out.addfile(member, tar.extractfile(member))
    by_key = {
        recording.key: recording for recording in shards.read_shard(other, lambda error: None)
    }
    background = by_key["1"].no_contact
    assert background is not None
    with pytest.raises(DataError, match=r"000001\.background\.0001\.png of .* is not there"):
        background.read([1])


def test_what_is_no_shard_is_named(touch: Recording, tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    path.write_bytes(b"no tar at all" * 100)
    with pytest.raises(DataError, match=r"a\.tar: no tar at byte 0"):
        list(shards.read_shard(path))
    with pytest.raises(DataError, match=r"gone\.tar: cannot be read"):
        list(shards.read_shard(tmp_path / "gone.tar"))
    with tarfile.open(path, "w") as tar:
        tar.addfile(tarfile.TarInfo("../../outside.json"))
    with pytest.raises(DataError, match=r"called '\.\./\.\./outside\.json'"):
        list(shards.read_shard(path))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 99}, "shard version 99, but this tactileforge reads 3"),
        ({"sensor": 3}, "sensor is 3, not a string"),
        ({"times": [0.0]}, "5 frames and 1 rows of times"),
        (
            {"times": [0.0], "tracks": {"times": {"dtype": "int8", "values": [0] * 5}}},
            "5 frames and 1 rows of times",
        ),
        ({"times": ["a"] * 5}, "could not convert string to float"),
        ({"force": [[1.0, 2.0]] * 5}, "cannot reshape"),
        ({"labels": 7}, "not iterable"),
        ({"tracks": {"slip": {"dtype": "O", "values": [0] * 5}}}, "a track of 'O'"),
        ({"tracks": {"slip": {"dtype": "int8", "values": [0]}}}, "5 frames and 1 rows of slip"),
        ({"tier": None}, "tier is None, not 1 to 5"),
        ({"tier": 6}, "tier is 6, not 1 to 5"),
        ({"action": [-2, 0, 0, 0, 0]}, "actions are numbers from -1 to 7"),
        ({"action": [8, 0, 0, 0, 0]}, "actions are numbers from -1 to 7"),
        ({"image_times": [0.3, 0.1]}, "image_times are finite numbers, one per view"),
        ({"image_times": [0.3]}, "image_times are finite numbers, one per view"),
        ({"times": [0.0, 0.2, 0.1, 0.3, 0.4]}, "that do not go back"),
        ({"text": ["a"]}, "neither a string nor null"),
    ],
)
def test_wrong_descriptions_are_named(
    change: dict[str, object], message: str, touch: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "a.tar"
    wrong = packed(touch)
    wrong.head.update(change)
    shards.write_shard(path, [wrong])
    with pytest.raises(DataError, match=message):
        list(shards.read_shard(path))


def rewrite(
    path: Path, first: tarfile.TarInfo, about: dict[str, Any], kept: list[tuple[Any, bytes]]
) -> None:
    """Writes a shard of one recording with another description and its right checksum."""
    sealed = about | {"crc32": description.checksum(about)}
    text = json.dumps(sealed).encode()
    first.size = len(text)
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for member, content in [(first, text), *kept]:
            tar.addfile(member, io.BytesIO(content))


@pytest.mark.slow
def test_descriptions_that_are_bent_are_named_or_read(touch: Recording, tmp_path: Path) -> None:
    """With the right checksum: an opened shard has numbers for every reader."""
    path, named, read = tmp_path / "a.tar", 0, 0
    whole = packed(touch)
    shards.write_shard(path, [whole])
    with tarfile.open(path) as tar:
        first, *others = tar.getmembers()
        kept = [(one, tar.extractfile(one).read()) for one in others]
        about = json.loads(tar.extractfile(first).read())
    del about["crc32"]
    for what, changed in list(bent(about))[::3]:
        rewrite(path, first, changed, kept)
        try:
            (one,) = shards.read_shard(path)
            for frames in filter(None, (one.frames, one.no_contact, one.image, one.surface)):
                assert frames.read(range(len(frames))).size > 0, what
            json.dumps(shards.describe_recording(one), allow_nan=False)
            json.dumps(IndexEntry.of(path).to_json())
            assert (np.diff(one.times) >= 0).all(), what
            read += 1
        except TactileForgeError:
            named += 1
    assert named > 350
    assert read > 30


@pytest.mark.parametrize("group", ["frames", "background", "image", "surface"])
def test_a_negative_shape_is_named(touch: Recording, tmp_path: Path, group: str) -> None:
    path = tmp_path / "a.tar"
    shards.write_shard(path, [packed(touch)])
    with tarfile.open(path) as tar:
        first, *others = tar.getmembers()
        kept = [(one, tar.extractfile(one).read()) for one in others]
        about = json.loads(tar.extractfile(first).read())
    del about["crc32"]
    about["pictures"][group]["shape"] = [-24, -32]
    rewrite(path, first, about, kept)
    with pytest.raises(DataError, match=f"{group}: -24 x -32 pixels"):
        list(shards.read_shard(path))


def test_a_picture_of_a_thousand_million_pixels_is_refused(
    touch: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A PNG of one grey value is small in bytes, whatever it would be in memory."""
    path = tmp_path / "a.tar"
    side = 31623
    head = struct.pack(">II5B", side, side, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + head
    bomb += struct.pack(">I", zlib.crc32(b"IHDR" + head))
    frames = replace(packed(touch), frames=[bomb] * 5)
    monkeypatch.setattr(shards, "image_size", lambda picture: (side, side))
    shards.write_shard(path, [frames])
    with pytest.raises(DataError, match="31623 x 31623 pixels"):
        list(shards.read_shard(path))
    monkeypatch.setattr(shards, "image_size", lambda picture: (24, 32))
    shards.write_shard(path, [frames])
    monkeypatch.undo()
    (back,) = shards.read_shard(path)
    with pytest.raises(DataError, match="frames 0"):
        back.frames.read([0])


def test_impossible_codecs_are_named() -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    with pytest.raises(ConfigError, match="unknown codec 'jpeg'; did you mean 'jpg'"):
        shards.encode_image(picture, "jpeg")
    with pytest.raises(ConfigError, match="quality=95: only jpg has one"):
        shards.encode_image(picture, "png", 95)


def tar_of(*members: tuple[bytes, bytes, bytes]) -> bytes:
    """A tar of members: name, the twelve bytes of the size, content."""
    out = b""
    for name, size, content in members:
        block = bytearray(tarfile.TarInfo(name.decode()).tobuf(tarfile.USTAR_FORMAT))
        block[124:136] = size.ljust(12, b"\0")
        block[148:156] = b"%06o\0 " % (256 + sum(block[:148]) + sum(block[156:512]))
        out += bytes(block) + content.ljust(-(-len(content) // 512) * 512, b"\0")
    return out + bytes(1024)


def described(touch: Recording, **change: Any) -> bytes:
    """A changed description with its right checksum."""
    about = shards.describe_recording(touch) | {"codec": "png"}
    about["pictures"] = {"frames": {"shape": [24, 32], "bytes": [9] * 5, "crc32": [0] * 5}}
    for key, value in change.items():
        place, _, last = key.rpartition("__")
        (about["pictures"]["frames"] if place else about)[last] = value
    return json.dumps(about | {"crc32": description.checksum(about)}).encode()


@pytest.mark.parametrize(
    "size",
    [
        b"\xff" * 12,  # base-256: -1
        b"\xff" * 10 + b"\xfe\x00",  # -512: the same member again, for ever
        b"\xff" * 8 + b"\xff\xff\x00\x00",
        b"\x80" + b"\x7f" * 11,
        b"-0000000001",
        b"77777777777",
        b"zzzz",
    ],
)
def test_a_size_that_is_none_ends_in_an_error(tmp_path: Path, size: bytes) -> None:
    for name in (b"000000.json", b"x.bin"):
        for before in ((), ((b"y.bin", b"00000000003", b"abc"),)):
            path = tmp_path / "a.tar"
            path.write_bytes(tar_of(*before, (name, size, b"{}")))
            with pytest.raises(DataError, match=r"a\.tar"):
                list(shards.read_shard(path))
            with pytest.raises(DataError, match=r"a\.tar"):
                list(shards.shard_members(path))


@pytest.mark.parametrize(
    "change",
    [
        {"x__bytes": [2**62] * 5},
        {"x__bytes": [2**70] * 5},
        {"x__bytes": [-600] * 5},
        {"x__bytes": [[9] * 5]},
        {"x__crc32": [2**40] * 5},
        {"x__shape": [1 << 20, 1 << 20]},
        {"x__shape": [float("inf"), 1]},
        {"tier": float("inf")},
        {"times": [float("nan")] * 5},
        {"times": [[0.0]] * 5},
        {"tracks": {"a": {"dtype": "f8,(", "values": [0] * 5}}},
        {"tracks": {"a": {"dtype": "O", "values": [0] * 5}}},
        {"tracks": {"a": {"dtype": ["x"], "values": [0] * 5}}},
        {"tracks": {"a": {"dtype": "int8", "values": [300] * 5}}},
        {"labels": 3},
        {"codec": ["png"]},
        {"key": None},
    ],
    ids=str,
)
def test_a_description_that_lies_is_an_error(
    touch: Recording, tmp_path: Path, change: dict[str, Any]
) -> None:
    text = described(touch, **change)
    path = tmp_path / "a.tar"
    path.write_bytes(tar_of((b"000000.json", b"%011o" % len(text), text)))
    with pytest.raises(DataError, match=r"a\.tar"):
        list(shards.read_shard(path))


def test_brackets_without_end_are_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    head = b'{"version": %d, "crc32": 1, "x": ' % description.SHARD_VERSION
    for text in (b"[" * 100_000, head + b"[" * 990 + b"]" * 990 + b"}"):
        path.write_bytes(tar_of((b"000000.json", b"%011o" % len(text), text)))
        with pytest.raises(DataError, match=r"no description of a recording|damaged"):
            list(shards.read_shard(path))
