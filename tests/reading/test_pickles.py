import collections
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.data.frames.encoded import Blob
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.reading import pickles
from tactileforge.reading.pickles import load_pickle, load_pickled_array

PROTOCOLS = range(2, pickle.HIGHEST_PROTOCOL + 1)
SHARED = [1.5, "a"]
PLAIN = {
    "numbers": [0, 1, 255, 256, -3, 2**40, 1.5, True, None],
    "text": "é" * 300,
    "tuples": ((), (1,), (1, 2), (1, 2, 3), (1, 2, 3, 4)),
    "sets": {1, 2},
    "same": [SHARED, SHARED],
    7: collections.OrderedDict(b=1),
}
ARRAYS = [
    np.arange(200, dtype=np.float32).reshape(50, 4),
    np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.arange(3, dtype=">i2"),
    np.zeros((0, 3)),
    np.array([True, False]),
    np.array(["ab", "c"]),
]


def dump(path: Path, value: Any, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol))
    return path


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_plain_data(tmp_path: Path, protocol: int) -> None:
    assert load_pickle(dump(tmp_path / "a.pkl", PLAIN, protocol)) == PLAIN
    same = load_pickle(tmp_path / "a.pkl")["same"]
    assert same[0] is same[1]


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_arrays(tmp_path: Path, protocol: int) -> None:
    content = load_pickle(dump(tmp_path / "a.pkl", [*ARRAYS, ARRAYS[0], np.float64(2.5)], protocol))
    for got, want in zip(content, [*ARRAYS, ARRAYS[0], np.float64(2.5)], strict=True):
        assert got.dtype == want.dtype
        np.testing.assert_array_equal(got, want)
    assert content[0] is content[len(ARRAYS)]


@pytest.mark.parametrize("protocol", range(3, pickle.HIGHEST_PROTOCOL + 1))
def test_long_bytes_stay_in_the_file(tmp_path: Path, protocol: int) -> None:
    texts = [bytes([i]) * size for i, size in enumerate((10, 255, 256, 70_000, 300))]
    content = load_pickle(dump(tmp_path / "a.pkl", {"images": [*texts, texts[3]]}, protocol))[
        "images"
    ]
    assert [type(item) for item in content] == [bytes, bytes, Blob, Blob, Blob, Blob]
    assert [item.read() if isinstance(item, Blob) else item for item in content] == [
        *texts,
        texts[3],
    ]


class Malicious:
    """Writes a file when it is unpickled the usual way."""

    def __init__(self, call: Any, *arguments: Any) -> None:
        self.call = call
        self.arguments = arguments

    def __reduce__(self) -> tuple[Any, ...]:
        return self.call, self.arguments


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_nothing_is_executed(tmp_path: Path, protocol: int) -> None:
    proof = tmp_path / "proof"
    for call, arguments in (
        (os.mkdir, (str(proof),)),
        (exec, (f"import os; os.mkdir({str(proof)!r})",)),
        (np.load, (str(proof),)),
    ):
        path = dump(tmp_path / "bad.pkl", [b"image", Malicious(call, *arguments)], protocol)
        with pytest.raises(DataError, match=r"bad\.pkl: not read: it asks for .*nothing in the"):
            load_pickle(path)
        assert not proof.exists()
    dump(tmp_path / "bad.pkl", Malicious(os.mkdir, str(proof)), protocol)
    pickle.loads((tmp_path / "bad.pkl").read_bytes())
    assert proof.is_dir(), "the usual way would have executed it"


@pytest.mark.parametrize(
    ("code", "what"),
    [
        (b"\x80\x02cos\nsystem\n(S'ls'\ntR.", "it asks for os.system"),
        (b"(ios\nsystem\n.", "the instruction INST"),
        (b"\x80\x02\x82\x01.", "the instruction EXT1"),
        (b"\x80\x02Pname\n.", "the instruction PERSID"),
        (b"\x80\x02cnumpy\nndarray\n)\x81.", "the instruction NEWOBJ"),
        (b"\x80\x02cnumpy\nndarray\n)R.", "it calls something"),
        (b"\x80\x02cnumpy\nndarray\n}b.", "it sets the state of an object"),
        (b"\x80\x02c_codecs\nencode\nX\x01\x00\x00\x00aX\x04\x00\x00\x00zlib\x86R.", "text in"),
        (b"\x80\x02cnumpy\ndtype\nX\x02\x00\x00\x00V8\x85R.", "an array of 'V8'"),
    ],
)
def test_instructions_outside_the_list(tmp_path: Path, code: bytes, what: str) -> None:
    (tmp_path / "bad.pkl").write_bytes(code)
    with pytest.raises(DataError, match=rf"bad\.pkl: not read: {what}"):
        load_pickle(tmp_path / "bad.pkl")


def test_damage_is_named(tmp_path: Path) -> None:
    whole = pickle.dumps({"a": [np.arange(100.0), b"x" * 400]}, 4)
    for length in range(0, len(whole) - 1, 7):
        (tmp_path / "cut.pkl").write_bytes(whole[:length])
        with pytest.raises(DataError, match=r"cut\.pkl"):
            load_pickle(tmp_path / "cut.pkl")
    for junk in (b"no pickle", b"\x80\x04K\x01K\x02.", b"\x80\x04h\x09.", b"\x80\x04]\x85K\x01s."):
        (tmp_path / "cut.pkl").write_bytes(junk)
        with pytest.raises(DataError, match=r"cut\.pkl: not a pickle, or damaged"):
            load_pickle(tmp_path / "cut.pkl")
    with pytest.raises(DataNotFoundError, match=r"gone\.pkl"):
        load_pickle(tmp_path / "gone.pkl")


def test_a_file_that_shrinks_afterwards(tmp_path: Path) -> None:
    path = dump(tmp_path / "a.pkl", [b"x" * 400])
    (blob,) = load_pickle(path)
    path.write_bytes(b"short")
    with pytest.raises(DataError, match="has become shorter"):
        blob.read()
    path.unlink()
    with pytest.raises(DataError, match="cannot be read"):
        blob.read()


@pytest.mark.slow
@pytest.mark.parametrize("make", [b"\x85", b"t"])
@pytest.mark.parametrize("use", [b"", b"s", b"\x8f(Ne\x90"])
def test_tuples_nested_without_end_are_an_error(tmp_path: Path, make: bytes, use: bytes) -> None:
    """Python ends with a segmentation fault on hashing, or dropping, one of them."""
    count = 300_000
    nested = b"N" + b"\x85" * count if make == b"\x85" else b"(" * count + b"N" + b"t" * count
    start = b"}" if use == b"s" else b""
    path = tmp_path / "a.pkl"
    path.write_bytes(b"\x80\x04" + start + nested + (b"N" + use if use else b"") + b".")
    with pytest.raises(DataError, match="values nested too deep"):
        load_pickle(path)


def test_a_type_of_something_nested_is_an_error(tmp_path: Path) -> None:
    class Typed:
        def __reduce__(self) -> tuple[Any, ...]:
            return np.dtype, ([("a", [("b", "f8")])],)

    with pytest.raises(DataError, match="an array of no type"):
        load_pickle(dump(tmp_path / "a.pkl", Typed()))


def test_a_header_of_an_array_that_is_no_literal(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\0\x20\0" + b"(" * 32)
    with pytest.raises(DataError, match=r"a\.npy: not a pickle, or damaged \(TokenError"):
        load_pickled_array(path)


def test_a_pickle_that_repeats_its_values_without_end(monkeypatch, tmp_path):
    monkeypatch.setattr(pickles, "_MOST_VALUES", 31)
    value = ["x"]
    for _ in range(3):
        value = [value, value]
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"a": value, "b": 7}))  # 23 and 2 values
    assert load_pickle(path)["a"] == value
    path.write_bytes(pickle.dumps([value, (value,)]))
    with pytest.raises(DataError, match="more than 31 values, with those that it repeats"):
        load_pickle(path)
    value.append(value)
    path.write_bytes(pickle.dumps(value))
    with pytest.raises(DataError, match="a container that holds itself"):
        load_pickle(path)
    path.write_bytes(b"\x80\x04" + b"]" * 100_000 + b"a" * 99_999 + b".")
    with pytest.raises(DataError, match="RecursionError"):
        load_pickle(path)
