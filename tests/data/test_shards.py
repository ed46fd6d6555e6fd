import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data import shards
from tactileforge.data.frames import ArrayFrames
from tactileforge.errors import ConfigError, DataError


@pytest.fixture
def touch() -> Recording:
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (5, 24, 32, 3), np.uint8)
    force = rng.normal(size=(5, 3)).astype(np.float32)
    force[2] = np.nan
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
        labels={"hardness": 0.3, "place": "rim"},
        source="here",
        tier=1,
        licence="CC0-1.0",
    )


def packed(recording: Recording, codec: str = "png") -> shards.Packed:
    def encoded(frames: object) -> list[bytes]:
        assert isinstance(frames, ArrayFrames)
        return [shards.encode(picture, codec) for picture in frames.array]

    return shards.Packed(
        shards.head(recording),
        codec,
        encoded(recording.frames),
        encoded(recording.no_contact),
        encoded(recording.image),
    )


def test_a_recording_comes_back_as_it_went(touch: Recording, tmp_path: Path) -> None:
    shards.write(tmp_path / "a.tar", [packed(touch), packed(touch, "webp")])
    first, second = shards.read(tmp_path / "a.tar")
    for back in (first, second):
        for name in ("key", "sensor", "object", "text", "labels", "source", "tier", "licence"):
            assert getattr(back, name) == getattr(touch, name)
        np.testing.assert_array_equal(back.times, touch.times)
        np.testing.assert_array_equal(back.force, touch.force)
        np.testing.assert_array_equal(back.action, touch.action)
        for name in ("frames", "no_contact", "image"):
            there, here = getattr(back, name), getattr(touch, name)
            np.testing.assert_array_equal(there.read(range(len(here))), here.array)


def test_what_a_recording_lacks_stays_lacking(touch: Recording, tmp_path: Path) -> None:
    bare = Recording(
        key="bare", sensor="digit", frames=touch.frames, times=touch.times, no_contact=None
    )
    assert isinstance(touch.frames, ArrayFrames)
    frames = [shards.encode(picture) for picture in touch.frames.array]
    shards.write(tmp_path / "a.tar", [shards.Packed(shards.head(bare), "jpg", frames, [], [])])
    (back,) = shards.read(tmp_path / "a.tar")
    missing = (back.no_contact, back.force, back.action, back.object, back.text, back.image)
    assert missing == (None,) * 6


def test_any_tool_reads_it(touch: Recording, tmp_path: Path) -> None:
    shards.write(tmp_path / "a.tar", [packed(touch)])
    with tarfile.open(tmp_path / "a.tar") as tar:
        names = tar.getnames()
    assert names == [
        "000000.json",
        *(f"000000.background.{i:04d}.png" for i in range(2)),
        *(f"000000.image.{i:04d}.png" for i in range(2)),
        *(f"000000.{i:04d}.png" for i in range(5)),
    ]


def test_the_same_content_gives_the_same_bytes(touch: Recording, tmp_path: Path) -> None:
    for name in ("a.tar", "b.tar"):
        shards.write(tmp_path / name, [packed(touch)])
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


def test_webdataset_reads_it(touch: Recording, tmp_path: Path) -> None:
    from webdataset.tariterators import group_by_keys, tar_file_iterator

    shards.write(tmp_path / "a.tar", [packed(touch)])
    with (tmp_path / "a.tar").open("rb") as stream:
        members = [{**m, "__url__": "a"} for m in tar_file_iterator(stream)]
    (sample,) = group_by_keys(members)
    assert json.loads(sample["json"])["key"] == touch.key
    assert "0004.png" in sample


def test_jpeg_of_quality_95_is_close() -> None:
    y, x = np.mgrid[:64, :64]
    picture = np.stack([x * 4, y * 4, 255 - x * 2 - y * 2], -1).clip(0, 255).astype(np.uint8)
    raw = shards.encode(picture, "jpg")
    assert raw[:2] == b"\xff\xd8"
    from tactileforge.data.encoded import EncodedFrames

    back = EncodedFrames("x", [raw]).read([0])[0]
    assert np.abs(back.astype(int) - picture).mean() < 2
    assert len(shards.encode(picture, "jpg", 50)) < len(raw)


def test_a_stopped_write_leaves_no_shard(touch: Recording, tmp_path: Path) -> None:
    def broken():  # type: ignore[no-untyped-def]
        yield packed(touch)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shards.write(tmp_path / "a.tar", broken())
    assert not (tmp_path / "a.tar").exists()


def test_damage_is_named(touch: Recording, tmp_path: Path) -> None:
    whole = tmp_path / "whole.tar"
    shards.write(whole, [packed(touch)])
    raw = whole.read_bytes()
    cut = tmp_path / "cut.tar"
    cut.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(DataError, match=r"cut\.tar"):
        list(shards.read(cut))
    (tmp_path / "no.tar").write_bytes(b"no tar at all" * 100)
    with pytest.raises(DataError, match=r"no\.tar: not a whole shard"):
        list(shards.read(tmp_path / "no.tar"))
    newer = packed(touch)
    newer.head["version"] = 99
    shards.write(tmp_path / "newer.tar", [newer])
    with pytest.raises(DataError, match="shard version 99, but this tactileforge reads up to 1"):
        list(shards.read(tmp_path / "newer.tar"))
    newer.head["version"] = 1
    del newer.head["sensor"]
    shards.write(tmp_path / "bad.tar", [newer])
    with pytest.raises(DataError, match=r"bad\.tar:cups/7.*damaged \(KeyError\('sensor'\)\)"):
        list(shards.read(tmp_path / "bad.tar"))


def test_impossible_codecs_are_named() -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    with pytest.raises(ConfigError, match="unknown codec 'jpeg'; did you mean 'jpg'"):
        shards.encode(picture, "jpeg")
    with pytest.raises(ConfigError, match="quality=95: only jpg has one"):
        shards.encode(picture, "png", 95)
