"""Foreign text and pictures are read within limits."""

import io
import struct
import zlib
from pathlib import Path

import pytest

from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.errors import DataError
from tactileforge.util.untrusted import dump_yaml, load_json, load_yaml, open_picture


def png(width: int, height: int) -> bytes:
    """A PNG of black pixels with equal rows: a few hundred kilobytes at most."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        summed = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + summed

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * (height * (1 + (width + 7) // 8)), 1)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("side", [8193, 12_000, 20_000])
def test_a_picture_of_too_many_pixels_is_an_error(tmp_path: Path, side: int) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png(side, side))
    with pytest.raises(DataError, match=r"a\.png: not a readable image \(.*pixels"):
        ImageFrames([path])


def test_a_picture_within_the_limit_is_opened() -> None:
    with open_picture(io.BytesIO(png(64, 32))) as opened:
        assert opened.size == (64, 32)


def test_names_in_braces_stay_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET", "hunter2")
    assert load_yaml("a: ${oc.env:SECRET}\nb: ${a}") == {"a": "${oc.env:SECRET}", "b": "${a}"}


def test_yaml_is_read_as_it_was_written() -> None:
    given = {
        "z": [1e-5, 1e20, -0.5, 3, True, None],
        "a": {"1e-3": "1e-3", "on": "yes", "run": "8e61392a6fc47dc7", "b": "12e9"},
        "when": "2026-01-01",
        "text": "ä: [x] # no",
    }
    assert load_yaml(dump_yaml(given)) == given
    assert list(load_yaml(dump_yaml(given))) == list(given)


def test_aliases_may_repeat_a_little() -> None:
    assert load_yaml("a: &x {b: 1}\nc: *x\nd: {<<: *x, e: 2}")["d"] == {"b": 1, "e": 2}


BOMB = "a0: &a0 [x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30)
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "more than 100000 values"),
        ("a: &a [*a]", "nested too deep, or in itself"),
        ("[" * 5000, "nested too deep"),
        ("a: 1\na: 2", "'a' comes twice"),
        ("a: [", "not YAML"),
        ("a: !!python/object/apply:os.mkdir [x]", "not YAML"),
        ("#" * (1 << 20 | 1), "are the limit"),
    ],
)
def test_hostile_yaml_is_an_error(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        load_yaml(text)


@pytest.mark.slow
def test_nested_brackets_are_an_error() -> None:
    for text in ("[" * 100_000, '{"a":' * 100_000):
        with pytest.raises(ValueError, match="nested too deep"):
            load_json(text)
