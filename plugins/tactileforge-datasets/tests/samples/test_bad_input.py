"""Damaged, hostile and foreign samples: named, counted, never guessed."""

import json
import pickle
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_samples import FRAMES, add, frame_samples, made_set, part, picture, video, write_tar
from tactileforge_datasets.webdataset import WebDataset

from tactileforge.errors import ConfigError, DataError, DataNotFoundError

STILL = {"touch": "jpg", "sensor": "digit", "background": "none"}
CLIP = {"touch": "npy", "sensor": "digit", "background": "none", "fps": 10}


def skipped(
    tmp_path: Path, samples: list[tuple[str, dict[str, Any]]], layout: dict[str, Any]
) -> tuple[list[str], list[str]]:
    """Keys of the readable recordings, and lines about the others."""
    write_tar(tmp_path / "a.tar", [("good", {"jpg": picture(9), "npy": clip(2)}), *samples])
    data = WebDataset(str(tmp_path), layout, val=0)
    return [one.key for one in data.recordings("train")], data.skipped


def clip(count: int) -> Any:
    return np.stack([picture(9)] * count)


@pytest.mark.parametrize(
    ("parts", "layout", "words"),
    [
        ({"jpeg": picture(9).tobytes()}, STILL, r"bad: unknown part 'jpg'; did you mean 'jpeg'\?"),
        ({"jpg": b"<html>"}, STILL, r"bad\.jpg: no picture, it starts with b'<htm'"),
        ({"jpg": b""}, STILL, "no picture, it starts with b''"),
        ({"npy": pickle.dumps([1])}, CLIP, r"bad\.npy: not a plain array"),
        ({"npy": np.array([{}, 1], object)}, CLIP, "an array of object: only numbers are read"),
        (
            {
                "npy": b"\x93NUMPY\x01\0v\0{'descr': '|u1', 'shape': (9999999, 99, 99, 3), "
                b"'fortran_order': False}" + b" " * 60 + b"\n"
            },
            CLIP,
            "bytes for an array of",
        ),
        ({"npy": b"\x93NUMPY\x01\0\x20\0" + b"(" * 32}, CLIP, "not a plain array"),
        ({"npy": b"\x93NUMPY\x09\0\x20\0" + b" " * 32}, CLIP, "not a plain array"),
        ({"npy": clip(2).astype(np.float32)}, CLIP, "float32 .*, where uint8"),
        ({"npy": clip(2)[..., 0]}, CLIP, r"uint8 \(2, 32, 24\), where uint8 \(T, H, W, 3\)"),
        ({"npy": clip(2)[:0]}, CLIP, r"uint8 \(0, 32, 24, 3\)"),
        ({"npy": np.asfortranarray(clip(2))}, CLIP, "columns first"),
    ],
)
def test_a_part_that_is_no_picture(tmp_path: Path, parts, layout, words: str) -> None:
    read, lines = skipped(tmp_path, [("bad", parts)], layout)
    assert read == ["a/good"]
    assert len(lines) == 1
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(lines[0])
    assert str(tmp_path / "a.tar") in lines[0]


FORCE = {**CLIP, "force": {"values": "json:force"}}


@pytest.mark.parametrize(
    ("value", "layout", "words"),
    [
        (b"[" * 9000, FORCE, r"bad\.json: not JSON \(nested too deep\)"),
        (b"{", FORCE, "not JSON"),
        (b"\xff\xfe{}", FORCE, "byte 0 is not UTF-8"),
        ({"forc": 1}, FORCE, "unknown key 'force'; did you mean 'forc'"),
        ([1], FORCE, "unknown key 'force'"),
        ({"force": [[0, 0, 1]] * 3}, FORCE, r"json:force has shape \(3, 3\), .* 2 frames"),
        ({"force": [[0, 1]] * 2}, FORCE, r"shape \(2, 2\), where \(2, 3 or more\) belongs"),
        ({"force": [[0], [0, 1]]}, FORCE, "not numbers of one shape"),
        ({"force": "many"}, FORCE, "not numbers"),
        ({"force": [[0, 0, 10**400]] * 2}, FORCE, "not numbers"),
        (b'{"force": [[0, 0, Infinity], [0, 0, 1]]}', FORCE, "an infinite value"),
        ({"t": [0, 0]}, {**CLIP, "times": {"values": "json:t"}}, "time of frame 1, 0 s, is not af"),
        ({"t": [1, None]}, {**CLIP, "times": {"values": "json:t"}}, "times of shape"),
        ({"o": ["a"]}, {**CLIP, "object": "{json:o}"}, "json:o is no text and no number"),
        ({"o": 7}, {**CLIP, "object": "{json:o}", "words": {"json:o": {6: "x"}}}, "layout.words"),
    ],
)
def test_hostile_and_wrong_values(tmp_path: Path, value, layout, words: str) -> None:
    good = {"force": [[0, 0, 1]] * 2, "t": [0, 0.1], "o": 6}
    samples = [("fine", {"npy": clip(2), "json": good}), ("bad", {"npy": clip(2), "json": value})]
    write_tar(tmp_path / "a.tar", samples)
    data = WebDataset(str(tmp_path), layout, val=0)
    assert [one.key for one in data.recordings("train")] == ["a/fine"]
    (line,) = data.skipped
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(line)


def test_keys_alike_and_unlike(tmp_path: Path) -> None:
    samples = frame_samples(0, clips=2, frames=3)
    samples += [("pen/ep01_001", samples[0][1]), ("pen/readme", {"jpg": picture(9)})]
    write_tar(tmp_path / "a.tar", samples)
    with tarfile.open(tmp_path / "a.tar", "a") as tar:
        for name in ("._x.jpg", "README", "__MACOSX/a.jpg", ".jpg"):
            add(tar, name, b"x")
    data = WebDataset(str(tmp_path), FRAMES, val=0)
    found = {one.key: len(one.times) for one in data.recordings("train")}
    assert found == {"a/mug/ep00": 3, "a/pen/ep01": 2}
    assert [line.partition(": ")[2] for line in data.skipped] == [
        "4 members without a key and an ending, the first '._x.jpg'",
        "1 samples with a part that comes twice, the first 'pen/ep01_001'",
        "1 samples whose key is unlike layout.samples={object}/{clip}_{frame}, the first "
        "'pen/readme'",
    ]


def test_two_frames_of_one_number_and_labels_that_differ(tmp_path: Path) -> None:
    keys = {"a_1": 0, "a_01": 0, "b_1": 0, "b_2": 1, "c_1": 0, "c_2": 0}
    samples = [(key, {"jpg": picture(9), "cls": cls}) for key, cls in keys.items()]
    write_tar(tmp_path / "a.tar", samples)
    layout = {**STILL, "samples": "{clip}_{frame}", "fps": 10, "object": "{cls}"}
    data = WebDataset(str(tmp_path), layout, val=0)
    assert [one.key for one in data.recordings("train")] == ["a/c"]
    assert "two frames of one number, the first 'a_01'" in data.skipped[0]
    assert "frames with '0' and with '1' for {cls}" in data.skipped[1]


def test_truncated_empty_and_foreign_tars_beside_a_good_one(tmp_path: Path) -> None:
    made_set(tmp_path, tars=2)
    cut = tmp_path / "part-001.tar"
    cut.write_bytes(cut.read_bytes()[:-30_000])
    (tmp_path / "part-002.tar").write_bytes(bytes(10240))
    (tmp_path / "part-003.tar").write_bytes(b"\x1f\x8b\x08 packed")
    data = WebDataset(str(tmp_path), FRAMES, val=0)
    found = list(data.recordings("train"))
    assert {one.key.partition("/")[0] for one in found} == {"part-000", "part-001"}
    assert sum(len(one.times) for one in found) > 60
    assert [line.partition(": ")[2][:12] for line in data.skipped] == [
        *("damaged (it ", "an empty tar", "compressed, ")
    ]
    (source,) = data.sources("train")
    assert [part.recordings for part in source.parts] == [4, 3] or len(source.parts) == 2
    assert source.summary.recordings == len(found)


def test_nothing_readable_is_an_error(tmp_path: Path) -> None:
    write_tar(tmp_path / "a.tar", [("x", {"pth": b"1", "cls": "0"})])
    data = WebDataset(str(tmp_path), STILL, val=0)
    with pytest.raises(DataError, match=r"not one recording can be opened.*unknown part 'jpg'"):
        list(data.recordings("train"))
    with pytest.raises(DataError, match="not one recording can be opened"):
        data.sources("train")


def test_parts_without_a_place_are_said(tmp_path: Path) -> None:
    write_tar(tmp_path / "a.tar", [(str(i), {"jpg": picture(9), "pth": b"1"}) for i in range(3)])
    data = WebDataset(str(tmp_path), STILL, val=0)
    assert len(list(data.recordings("train"))) == 3
    assert data.notes == [f"{tmp_path}: the layout has no place for 3 members .pth"]


def test_a_damaged_video_is_named_by_its_member(tmp_path: Path) -> None:
    film = video(tmp_path / "v.mp4", range(0, 200, 10))
    samples = [("good", {"mp4": film}), ("cut", {"mp4": film[:900]}), ("no", {"mp4": b"x" * 99})]
    write_tar(tmp_path / "a.tar", samples)
    layout = {**STILL, "touch": "mp4"}
    data = WebDataset(str(tmp_path), layout, val=0)
    assert [one.key for one in data.recordings("train")] == ["a/good"]
    for name, line in zip(("cut", "no"), data.skipped, strict=True):
        assert line.startswith(f"{tmp_path / 'a.tar'}, {name}.mp4: not a video, or truncated")


def test_times_that_a_layout_does_not_say(tmp_path: Path) -> None:
    write_tar(tmp_path / "a.tar", [("x", {"npy": clip(3)})])
    layout = {key: value for key, value in CLIP.items() if key != "fps"}
    with pytest.raises(ConfigError, match=r"3 frames without times; give layout\.fps"):
        list(WebDataset(str(tmp_path), layout, val=0).recordings("train"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"touch": "pyd"}, "pyd can run code when it is loaded, so it is never read"),
        ({"force": {"values": "force.pickle"}}, "pickle can run code"),
        ({"touch": "jpgg"}, "unknown kind of part 'jpgg'; did you mean 'jpg'"),
        ({"touch": "{frame}.npy", "fps": 3}, "number pictures"),
        ({"samples": "{clip}_{frame}"}, "fps is missing"),
        ({"samples": "{clip}_{frame}", "touch": "mp4"}, "mp4 holds a clip"),
        ({"samples": "{clip}{clip}"}, "once"),
        ({"samples": "{key}"}, "none of key"),
        ({"sensor": "digitt"}, "did you mean 'digit'"),
        ({"object": "{clz}"}, "unknown value 'clz'; did you mean 'cls'"),
        ({"object": "{cls"}, "write values in braces"),
        ({"action": "pres"}, "did you mean 'press'"),
        ({"action": "force"}, "force is not given"),
        ({"force": {"values": "json:force_kg"}}, "'json:force_kg' is in kgf by its name"),
        ({"background": "nothing"}, "must be one of"),
        ({"fps": 0}, "fps is 0"),
        ({"tier": 6}, "tier is 6"),
        ({"forse": 1}, "did you mean 'force'"),
        ({"rotate": 45}, "rotate is 45"),
        ({"force": {"values": "json:f", "unit": "stone"}}, "unit 'stone'"),
        ({"camera": "cam.txt"}, "unknown kind of part 'txt'"),
    ],
)
def test_wrong_layouts_name_the_key(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        WebDataset("x", {**STILL, **change})


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"tars": "b.tar"}, DataNotFoundError, r"no such file; did you mean 'a.tar'\?"),
        ({"tars": "b*.tar"}, DataNotFoundError, r"no tar like b\*.tar"),
        ({"tars": "{0..99999999999}.tar"}, ConfigError, "more than 1,000,000 tars"),
        ({"tars": "{a.tar"}, ConfigError, "write train-"),
        ({"tars": "../a.tar"}, ConfigError, "must be a name in data.root"),
        ({"tars": "pipe:touch x"}, DataNotFoundError, "no such file"),
        ({"tars": "https://x/a.tar"}, ConfigError, "must be a name in data.root"),
        ({"root": "pipe://touch x"}, DataError, "a command is never run"),
        ({"root": "http://127.0.0.1:9"}, ConfigError, "a server does not list its files"),
        ({"root": "nowhere"}, DataNotFoundError, "no such folder"),
        ({"val": 1.0}, ConfigError, "val is 1.0"),
        ({"layout": None}, ConfigError, "data inspect .*guesses one"),
    ],
)
def test_wrong_places_are_named(tmp_path: Path, options, kind, words: str) -> None:
    write_tar(tmp_path / "a.tar", [("x", {"jpg": picture(9)})])
    with pytest.raises(kind, match=words):
        list(WebDataset(**{"root": str(tmp_path), "layout": STILL, **options}).recordings("train"))
    with pytest.raises(ConfigError, match="unknown split"):
        list(WebDataset(str(tmp_path), STILL).recordings("trian"))


def test_random_bytes_end_in_errors_of_ours(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    made_set(tmp_path, tars=1, clips=2, frames=4)
    path = tmp_path / "part-000.tar"
    good = path.read_bytes()
    for _ in range(150):
        raw = bytearray(good)
        for _ in range(int(rng.integers(1, 6))):
            raw[int(rng.integers(0, len(raw)))] = int(rng.integers(0, 256))
        path.write_bytes(raw[: int(rng.integers(1, len(raw) + 1))] if rng.random() < 0.3 else raw)
        data = WebDataset(str(tmp_path), FRAMES, val=0)
        try:
            for one in data.recordings("train"):
                one.frames.read([0])
        except DataError:
            continue


def test_a_description_of_values_of_another_kind(tmp_path: Path) -> None:
    """A JSON with NaN, as Python writes it."""
    text = json.dumps({"force": [[float("nan")] * 3] * 2}).encode()
    write_tar(tmp_path / "a.tar", [("x", {"npy": clip(2), "json": text})])
    (found,) = WebDataset(str(tmp_path), FORCE, val=0).recordings("train")
    assert found.force is None
    assert part("json", {}) == b"{}"
