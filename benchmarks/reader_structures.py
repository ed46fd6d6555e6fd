"""Changes of the structure of files, by kind of file, for reader_mutants.py.

Each change takes a good file and a generator of random numbers, and damages the file in place as no
flip of a byte does: sizes of 1e8, bombs, loops, wrong counts, duplicated members, other types.
"""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import os
import pickle
import re
import shutil
import sqlite3
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import lz4.block
import lz4.frame
import numpy as np
import pyarrow as arrow
from backports import zstd
from PIL import Image
from pyarrow import feather, parquet
from scipy import io as scipy_io

Rng = np.random.Generator
Change = Callable[[Path, Rng], object]

#: Bytes of zeros of a bomb.
BOMB = 1 << 30


@cache
def bomb(kind: str) -> bytes:
    """A gigabyte of zeros, packed."""
    part = bytes(1 << 25)
    count = BOMB >> 25
    if kind in ("gzip", "bz2", "zstd", "xz"):
        pack: dict[str, Any] = {"gzip": gzip.compress, "bz2": bz2.compress}
        pack |= {"zstd": zstd.compress, "xz": lzma.compress}
        return bytes(pack[kind](part)) * count
    if kind == "lz4":  # one frame: of a second one nothing is read
        return bytes(lz4.frame.compress(bytes(BOMB)))
    if kind == "lz4 block":
        return bytes(lz4.block.compress(bytes(BOMB)))
    coder = zlib.compressobj(6, zlib.DEFLATED, -15 if kind == "deflate" else 15)
    return b"".join([*(coder.compress(part) for _ in range(count)), coder.flush()])


def _pick(rng: Rng, items: list[Any]) -> Any:
    return items[int(rng.integers(0, len(items)))]


def _at(path: Path, place: int, new: bytes) -> None:
    raw = bytearray(path.read_bytes())
    raw[place : place + len(new)] = new
    path.write_bytes(raw)


# --- any file, any folder


def _fifo(path: Path, rng: Rng) -> None:
    path.unlink()
    os.mkfifo(path)


def _link(path: Path, rng: Rng, to: str = "") -> None:
    path.unlink()
    path.symlink_to(to or path.name)


def _two_links(path: Path, rng: Rng) -> None:
    other = path.with_name(f"{path.name}.other")
    path.unlink()
    path.symlink_to(other.name)
    other.symlink_to(path.name)


def _hard_link(path: Path, rng: Rng) -> None:
    path.with_name(f"9{path.name}").hardlink_to(path)


def _sparse(path: Path, rng: Rng) -> None:
    with path.open("r+b") as file:
        file.truncate(1 << 40)


def _around(path: Path, rng: Rng) -> None:
    for name in "abc":  # every folder has three ways back: 3 to the power of the depth
        (path.parent / name).symlink_to(".")


def _deep(path: Path, rng: Rng) -> None:
    place = path.parent
    for _ in range(300):
        place /= "d"
        place.mkdir()
    shutil.copy(path, place / path.name)


def _crowd(path: Path, rng: Rng) -> None:
    for i in range(1000):
        (path.parent / f"x{i}{path.suffix}").write_bytes(b"")


def _bad_name(path: Path, rng: Rng) -> None:
    path.rename(os.fsdecode(os.fsencode(path.parent) + b"/\xff\n" + os.fsencode(path.name)))


def _packed_file(path: Path, rng: Rng) -> None:
    path.write_bytes(gzip.compress(path.read_bytes()))


ANY: dict[str, Change] = {
    "a pipe": _fifo,
    "a link to itself": _link,
    "two links to each other": _two_links,
    "a link to /dev/zero": partial(_link, to="/dev/zero"),
    "a link out of the folder": partial(_link, to="/etc/hostname"),
    "a second hard link": _hard_link,
    "a terabyte of nothing at its end": _sparse,
    "links to the folder around it": _around,
    "300 folders in each other": _deep,
    "1,000 empty files beside it": _crowd,
    "a name that is not text": _bad_name,
    "packed by gzip": _packed_file,
}

# --- text


def _json_all(plain: Any, value: Any, rng: Rng) -> Any:
    """A random number of a JSON text, replaced."""
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        for key, one in list(pairs):
            if isinstance(one, dict | list):
                walk(one)
            elif isinstance(one, int | float) and not isinstance(one, bool):
                places.append((node, key))

    walk(plain)
    if not places:
        raise LookupError("no number")
    node, key = _pick(rng, places)
    node[key] = value
    return plain


def _json_number(path: Path, rng: Rng, value: str) -> None:
    mark = 123454321
    lines = path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
    row = int(rng.integers(0, len(lines)))
    lines[row] = json.dumps(_json_all(json.loads(lines[row]), mark, rng)).replace(str(mark), value)
    path.write_text("\n".join(lines))


def _json_key_twice(path: Path, rng: Rng) -> None:
    text = path.read_text()
    keys = re.findall(r'"(\w+)":', text)
    if not keys:
        raise LookupError("no key")
    at = text.rindex("}")
    path.write_text(f'{text[:at]}, "{_pick(rng, keys)}": [1]{text[at:]}')


def _write(path: Path, rng: Rng, text: str) -> None:
    path.write_text(text)


def _insert(path: Path, rng: Rng, text: str) -> None:
    whole = path.read_text()
    at = whole.index("\n") + 1 if "\n" in whole else len(whole)
    path.write_text(whole[:at] + text + whole[at:])


def _coded(path: Path, rng: Rng, coding: str) -> None:
    path.write_bytes(path.read_text().encode(coding))


def _json_text(path: Path, rng: Rng) -> None:
    text = path.read_text()
    strings = re.findall(r'"\w+"', text)
    if not strings:
        raise LookupError("no text")
    path.write_text(text.replace(_pick(rng, strings), '"' + "x" * 40_000_000 + '"', 1))


_NUMBERS = {
    "-1": "a number: -1", "100000000": "a number: 1e8", "9223372036854775808": "a number: 2^63",
    "1e999": "a number: 1e999", "NaN": "a number: NaN", "0": "a number: 0",
    "[1, 2]": "a number: a list", "null": "a number: nothing", '"7"': "a number: text",
}  # fmt: skip
JSON: dict[str, Change] = {
    **{said: partial(_json_number, value=value) for value, said in _NUMBERS.items()},
    "a key twice": _json_key_twice,
    "100,000 lists in each other": partial(_write, text="[" * 100_000),
    "100,000 whole lists in each other": partial(_write, text="[" * 100_000 + "]" * 100_000),
    "a number of 1,000,000 digits": partial(_json_number, value="9" * 1_000_000),
    "a text of 40 MB": _json_text,
    "UTF-16": partial(_coded, coding="utf-16"),
}
YAML: dict[str, Change] = {
    "a bomb of aliases": partial(
        _write,
        text="a0: &a0 [x, x]\n"
        + "".join(f"a{i + 1}: &a{i + 1} [*a{i}, *a{i}]\n" for i in range(60)),
    ),
    "an alias of itself": partial(_insert, text="zz: &zz [*zz]\n"),
    "merged keys in each other": partial(
        _write, text="".join(f"m{i}: &m{i}\n  <<: [*m{i - 1}, *m{i - 1}]\n" for i in range(1, 30))
    ),
    "10,000 lists in each other": partial(_write, text="a: " + "[" * 10_000 + "]" * 10_000),
    "a base-60 number": partial(_insert, text="zy: " + "59:" * 20_000 + "59\n"),
    "a key of 40 MB": partial(_insert, text="y" * 40_000_000 + ": 1\n"),
    "80,000 keys": partial(_insert, text="".join(f"k{i}: 1\n" for i in range(80_000))),
    "a key twice": partial(_insert, text="layouts: 1\nlayouts: 2\ntouch: 3\ntouch: 4\n"),
    "a tag of Python": partial(_insert, text="zx: !!python/object/apply:os.system [true]\n"),
    "UTF-16": partial(_coded, coding="utf-16"),
}


def _columns_twice(path: Path, rng: Rng) -> None:
    path.write_text("".join(f"{line},{line}\n" for line in path.read_text().splitlines()))


def _cell(path: Path, rng: Rng, value: str) -> None:
    lines = path.read_text().splitlines()
    row = int(rng.integers(min(1, len(lines) - 1), len(lines)))
    cells = re.split(r"[,\s]", lines[row])
    cells[int(rng.integers(0, len(cells)))] = value
    lines[row] = ("," if "," in lines[row] else " ").join(cells)
    path.write_text("\n".join(lines) + "\n")


def _rows(path: Path, rng: Rng, count: int) -> None:
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines, *(lines[-1:] * count)]))


def _wide(path: Path, rng: Rng) -> None:
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line + ",1" * 300_000 for line in lines[:20]))


def _turned(path: Path, rng: Rng) -> None:
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:1], *lines[:0:-1]]) + "\n")


CSV: dict[str, Change] = {
    "all columns twice": _columns_twice,
    "a cell of 1e8": partial(_cell, value="100000000"),
    "a cell of nan": partial(_cell, value="nan"),
    "a cell of 1e999": partial(_cell, value="1e999"),
    "a cell that opens a quote": partial(_cell, value='"'),
    "a cell of 40 MB": partial(_cell, value="9" * 40_000_000),
    "a line of 20 MB": partial(_insert, text="," * 20_000_000 + "\n"),
    "300 more rows": partial(_rows, count=300),
    "300,000 more columns": _wide,
    "rows turned round": _turned,
    "UTF-16": partial(_coded, coding="utf-16"),
    "the header twice": lambda path, rng: _insert(
        path, rng, path.read_text().split("\n")[0] + "\n"
    ),
}

# --- arrays


def _npy(path: Path, rng: Rng, **keys: str) -> None:
    raw = path.read_bytes()
    length = int.from_bytes(raw[8:10], "little")
    path.write_bytes(_header(raw[10 : 10 + length].decode("latin1"), keys) + raw[10 + length :])


def _header(text: str, keys: dict[str, str]) -> bytes:
    for key, value in keys.items():
        kind = r"\(.*?\)" if key == "shape" else r"'[^']*'|True|False|\[.*?\]"
        text = re.sub(rf"'{key}': (?:{kind})", f"'{key}': {value}", text)
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text.encode("latin1")


def _npy_array(path: Path, rng: Rng, change: Callable[[Any], Any]) -> None:
    np.save(path, change(np.load(path)))


_HEADS: dict[str, dict[str, str]] = {
    "a shape of 1e8": {"shape": "(100000000, 3)"},
    "a shape of 2^62": {"shape": "(4611686018427387904, 8)"},
    "a negative size": {"shape": "(-1, 3)"},
    "no rows": {"shape": "(0, 100000000)"},
    "20,000 axes": {"shape": "(" + "1, " * 20_000 + ")"},
    "brackets in each other": {"shape": "(" * 5000 + "1" + ")" * 5000},
    "Python objects": {"descr": "'|O'"},
    "items of 2 GB": {"descr": "'|V2000000000'"},
    "another endianness": {"descr": "'>f8'"},
    "texts": {"descr": "'<U1'"},
    "fields": {"descr": "[('a', '<f4'), ('b', '<f4')]"},
    "by columns": {"fortran_order": "True"},
}
_SWAPS: dict[str, Callable[[Any], Any]] = {
    "values of int64": lambda array: array.astype(np.int64),
    "values of float16": lambda array: array.astype(np.float16),
    "bytes turned": lambda array: array.astype(array.dtype.newbyteorder(">")),
    "values of complex": lambda array: array.astype(np.complex64),
    "an axis more": lambda array: array[None],
    "half the rows": lambda array: array[: len(array) // 2] if array.ndim else array,
}


def _any(keys: dict[str, str]) -> dict[str, Any]:
    return {**keys}


NPY: dict[str, Change] = {
    **{said: partial(_npy, **_any(keys)) for said, keys in _HEADS.items()},
    **{said: partial(_npy_array, change=change) for said, change in _SWAPS.items()},
    "a header of 4 GB": lambda path, rng: _at(path, 6, b"\x02\x00\xff\xff\xff\xff"),
    "version 9": lambda path, rng: _at(path, 6, b"\x09"),
}


# --- zip


def _members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as old:
        return {one.filename: old.read(one) for one in old.infolist() if not one.is_dir()}


def _zipped(
    path: Path, members: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED
) -> None:
    with zipfile.ZipFile(path, "w", method) as new:
        for name, content in members:
            new.writestr(name, content)


def _zip_twice(path: Path, rng: Rng) -> None:
    items = [*_members(path).items()]
    name, content = _pick(rng, items)
    _zipped(path, [*items, (name, content[: len(content) // 2])], zipfile.ZIP_STORED)


def _zip_bomb(path: Path, rng: Rng, said: int = 0) -> None:
    """A member of a gigabyte, with a false size if one is given."""
    items = _members(path)
    name = _pick(rng, [*items])
    items[name] = b"BOMB"
    _zipped(path, [*items.items()])
    raw = path.read_bytes()
    packed, small = bomb("deflate"), zlib.compress(b"BOMB", 6)[2:-4]
    place = raw.index(small)
    crc, size = zlib.crc32(b"BOMB"), said or BOMB
    old = struct.pack("<III", crc, len(small), 4)
    new = struct.pack("<III", crc, len(packed), size)
    raw = raw.replace(old, new)
    grown = len(packed) - len(small)
    raw = raw[:place] + packed + raw[place + len(small) :]
    # places of the members behind it, and of the central directory
    out, at = bytearray(raw), raw.find(b"PK\1\2", place + len(packed))
    while at >= 0:
        offset = int.from_bytes(raw[at + 42 : at + 46], "little")
        if offset > place:
            out[at + 42 : at + 46] = (offset + grown).to_bytes(4, "little")
        at = raw.find(b"PK\1\2", at + 46)
    end = raw.rindex(b"PK\5\6")
    central = int.from_bytes(raw[end + 16 : end + 20], "little") + grown
    out[end + 16 : end + 20] = central.to_bytes(4, "little")
    path.write_bytes(out)


def _zip_entry(path: Path, rng: Rng, place: int, new: bytes) -> None:
    """Bytes of an entry of the central directory."""
    raw = path.read_bytes()
    found = [one.start() for one in re.finditer(b"PK\1\2", raw)]
    _at(path, _pick(rng, found) + place, new)


def _zip_end(path: Path, rng: Rng, place: int, new: bytes) -> None:
    _at(path, path.read_bytes().rindex(b"PK\5\6") + place, new)


def _zip_names(path: Path, rng: Rng, name: str) -> None:
    items = [*_members(path).items()]
    at = int(rng.integers(0, len(items)))
    items[at] = (name, items[at][1])
    _zipped(path, items)


def _zip_many(path: Path, rng: Rng) -> None:
    items = [*_members(path).items()]
    _zipped(path, [*items, *((f"x/{i}.npy", b"") for i in range(40_000))], zipfile.ZIP_STORED)


def _zip_overlap(path: Path, rng: Rng) -> None:
    """All entries at the place of the last."""
    raw = bytearray(path.read_bytes())
    found = [one.start() for one in re.finditer(b"PK\1\2", bytes(raw))]
    for at in found:
        raw[at + 42 : at + 46] = raw[found[-1] + 42 : found[-1] + 46]
    path.write_bytes(raw)


def _zip_method(path: Path, rng: Rng, method: int) -> None:
    _zipped(path, [*_members(path).items()], method)


def _zip_part(path: Path, rng: Rng) -> None:
    items = _members(path)
    name = _pick(rng, [*items])
    items[name] = items[name][: len(items[name]) // 2]
    _zipped(path, [*items.items()], zipfile.ZIP_STORED)


def _zip_missing(path: Path, rng: Rng) -> None:
    items = _members(path)
    del items[_pick(rng, [*items])]
    _zipped(path, [*items.items()], zipfile.ZIP_STORED)


ZIP: dict[str, Change] = {
    "a member twice": _zip_twice,
    "a member of a gigabyte": _zip_bomb,
    "a member of a gigabyte that says 4 kB": partial(_zip_bomb, said=4096),
    "a member of 4 GB, it says": partial(_zip_entry, place=24, new=b"\xfe\xff\xff\xff"),
    "packed by method 99": partial(_zip_entry, place=10, new=b"\x63\x00"),
    "encrypted": partial(_zip_entry, place=8, new=b"\x01\x00"),
    "a member at 4 GB": partial(_zip_entry, place=42, new=b"\xfe\xff\xff\xff"),
    "another CRC": partial(_zip_entry, place=16, new=b"\x01\x02\x03\x04"),
    "all members in one place": _zip_overlap,
    "65,000 members said": partial(_zip_end, place=8, new=b"\xe8\xfd\xe8\xfd"),
    "a directory of 4 GB, it says": partial(_zip_end, place=12, new=b"\xff\xff\xff\x7f"),
    "a comment of 64 kB, it says": partial(_zip_end, place=20, new=b"\xff\xff"),
    "a name that leads out": partial(_zip_names, name="../../x.npy"),
    "a name of 60,000 letters": partial(_zip_names, name="n" * 60_000),
    "40,000 members": _zip_many,
    "packed by bzip2": partial(_zip_method, method=zipfile.ZIP_BZIP2),
    "packed by deflate": partial(_zip_method, method=zipfile.ZIP_DEFLATED),
    "half a member": _zip_part,
    "a member less": _zip_missing,
}


def _npz_header(path: Path, rng: Rng, keys: dict[str, str]) -> None:
    items = _members(path)
    name = _pick(rng, [one for one in items if one.endswith(".npy")])
    raw = items[name]
    length = int.from_bytes(raw[8:10], "little")
    items[name] = _header(raw[10 : 10 + length].decode("latin1"), keys) + raw[10 + length :]
    _zipped(path, [*items.items()], zipfile.ZIP_STORED)


NPZ: dict[str, Change] = {
    **ZIP,
    **{f"of an array: {said}": partial(_npz_header, keys=keys) for said, keys in _HEADS.items()},
}

# --- tar


def _tar_items(path: Path) -> list[tuple[tarfile.TarInfo, bytes]]:
    with tarfile.open(path) as old:
        return [(one, b"".join(old.extractfile(one) or [])) for one in old if one.isreg()]


def _tarred(path: Path, items: list[tuple[tarfile.TarInfo, bytes]], mode: str = "w") -> None:
    with tarfile.open(path, mode, format=tarfile.PAX_FORMAT) as new:  # type: ignore[call-overload]
        for about, content in items:
            about.size = len(content) if about.isreg() else 0
            new.addfile(about, io.BytesIO(content))


def _tar_twice(path: Path, rng: Rng) -> None:
    items = _tar_items(path)
    about, content = _pick(rng, items)
    _tarred(path, [*items, (about, content[: len(content) // 2])])


def _tar_kind(path: Path, rng: Rng, kind: bytes) -> None:
    items = _tar_items(path)
    about = _pick(rng, items)[0]
    about.type, about.linkname = kind, about.name
    _tarred(path, items)


def _tar_links(path: Path, rng: Rng) -> None:
    """Two members, hard links to each other."""
    items = _tar_items(path)
    first, second = items[0][0], items[-1][0]
    first.type = second.type = tarfile.LNKTYPE
    first.linkname, second.linkname = second.name, first.name
    _tarred(path, items)


def _tar_field(path: Path, rng: Rng, place: int, new: bytes) -> None:
    """A field of the header of a member, with its sum."""
    with tarfile.open(path) as old:
        at = _pick(rng, [one.offset for one in old])
    raw = bytearray(path.read_bytes())
    raw[at + place : at + place + len(new)] = new
    raw[at + 148 : at + 156] = b" " * 8
    raw[at + 148 : at + 156] = b"%06o\0 " % sum(raw[at : at + 512])
    path.write_bytes(raw)


def _tar_pax(path: Path, rng: Rng, keys: dict[str, str]) -> None:
    items = _tar_items(path)
    _pick(rng, items)[0].pax_headers = keys
    _tarred(path, items)


def _tar_many(path: Path, rng: Rng) -> None:
    items = _tar_items(path)
    _tarred(path, [*items, *((tarfile.TarInfo(f"x/{i}"), b"") for i in range(40_000))])


def _tar_name(path: Path, rng: Rng, name: str) -> None:
    items = _tar_items(path)
    _pick(rng, items)[0].name = name
    _tarred(path, items)


def _tar_content(path: Path, rng: Rng, change: Callable[[bytes], bytes]) -> None:
    items = _tar_items(path)
    at = int(rng.integers(0, len(items)))
    items[at] = (items[at][0], change(items[at][1]))
    _tarred(path, items)


def _tar_turned(path: Path, rng: Rng) -> None:
    _tarred(path, _tar_items(path)[::-1])


def _tar_packed(path: Path, rng: Rng, mode: str) -> None:
    _tarred(path, _tar_items(path), mode)


TAR: dict[str, Change] = {
    "a member twice": _tar_twice,
    "a member is a link to itself": partial(_tar_kind, kind=tarfile.SYMTYPE),
    "a member is a hard link to itself": partial(_tar_kind, kind=tarfile.LNKTYPE),
    "two members are links to each other": _tar_links,
    "a member is a pipe": partial(_tar_kind, kind=tarfile.FIFOTYPE),
    "a member is a device": partial(_tar_kind, kind=tarfile.CHRTYPE),
    "a negative size": partial(_tar_field, place=124, new=b"\xff" * 12),
    "a size of 8 GB": partial(_tar_field, place=124, new=b"77777777777\0"),
    "a name of 8 GB": partial(_tar_field, place=124, new=b"77777777777\0" + b" " * 20 + b"L"),
    "a PAX header of 8 GB": partial(_tar_field, place=124, new=b"77777777777\0" + b" " * 20 + b"x"),
    "a sparse member": partial(_tar_field, place=156, new=b"S"),
    "a PAX size of 1e12": partial(_tar_pax, keys={"size": "1000000000000"}),
    "a PAX size of -512": partial(_tar_pax, keys={"size": "-512"}),
    "a sparse map of PAX": partial(
        _tar_pax, keys={"GNU.sparse.major": "1", "GNU.sparse.minor": "0"}
    ),
    "a PAX comment of 40 MB": partial(_tar_pax, keys={"comment": "9" * 40_000_000}),
    "40,000 empty members": _tar_many,
    "a name that leads out": partial(_tar_name, name="../../../x.png"),
    "a name of 1 MB": partial(_tar_name, name="n" * 1_000_000),
    "half of a member": partial(_tar_content, change=lambda raw: raw[: len(raw) // 2]),
    "an empty member": partial(_tar_content, change=lambda raw: b""),
    "members turned round": _tar_turned,
    "packed by gzip": partial(_tar_packed, mode="w:gz"),
    "packed by xz": partial(_tar_packed, mode="w:xz"),
}

# --- zarr


def _zarr_key(path: Path, rng: Rng, change: Callable[[dict[str, Any]], object]) -> None:
    about = json.loads(path.read_text())
    if "shape" not in about:
        raise LookupError("a group")
    change(about)
    path.write_text(json.dumps(about))


def _sizes(about: dict[str, Any], chunks: bool, change: Callable[[list[int]], list[int]]) -> None:
    if not chunks:
        about["shape"] = change(about["shape"])
    elif "chunks" in about:
        about["chunks"] = change(about["chunks"])
    else:
        inner = about["chunk_grid"]["configuration"]
        inner["chunk_shape"] = change(inner["chunk_shape"])


def _zarr_sizes(chunks: bool, change: Callable[[list[int]], list[int]]) -> Change:
    return partial(_zarr_key, change=lambda about: _sizes(about, chunks, change))


def _zarr_type(about: dict[str, Any], old: str, new: str) -> None:
    if "dtype" in about:
        about["dtype"] = old
    else:
        about["data_type"] = new


def _turn(about: dict[str, Any]) -> None:
    if "dtype" in about:
        kind = about["dtype"]
        about["dtype"] = (">" if kind[0] in "<|" else "<") + kind[1:]
    for codec in about.get("codecs", []):
        if codec.get("name") == "bytes":
            codec["configuration"] = {"endian": "big"}


def _set(**keys: Any) -> Change:
    return partial(_zarr_key, change=lambda about: about.update(keys))


ZARRAY: dict[str, Change] = {
    "a shape of 1e8": _zarr_sizes(False, lambda sizes: [100_000_000, *sizes[1:]]),
    "a shape of 1e8 along its last axis": _zarr_sizes(False, lambda s: [*s[:-1], 100_000_000]),
    "a shape of 2^62": _zarr_sizes(False, lambda sizes: [1 << 62, *sizes[1:]]),
    "a negative size": _zarr_sizes(False, lambda sizes: [-5, *sizes[1:]]),
    "no rows": _zarr_sizes(False, lambda sizes: [0, *sizes[1:]]),
    "a row more": _zarr_sizes(False, lambda sizes: [sizes[0] + 1, *sizes[1:]]),
    "a row less": _zarr_sizes(False, lambda sizes: [sizes[0] - 1, *sizes[1:]]),
    "axes turned round": _zarr_sizes(False, lambda sizes: sizes[::-1]),
    "sizes of true": _zarr_sizes(False, lambda sizes: [True] * len(sizes)),
    "64 axes": _set(shape=[1] * 64, chunks=[1] * 64),
    "chunks of nothing": _zarr_sizes(True, lambda sizes: [0, *sizes[1:]]),
    "chunks of 1e8": _zarr_sizes(True, lambda sizes: [100_000_000, *sizes[1:]]),
    "negative chunks": _zarr_sizes(True, lambda sizes: [-1, *sizes[1:]]),
    "chunks of one row": _zarr_sizes(True, lambda sizes: [1, *sizes[1:]]),
    "chunks of one value": _zarr_sizes(True, lambda sizes: [1] * len(sizes)),
    "another type": partial(_zarr_key, change=lambda a: _zarr_type(a, "<f8", "float64")),
    "a smaller type": partial(_zarr_key, change=lambda a: _zarr_type(a, "|i1", "int8")),
    "Python objects": partial(_zarr_key, change=lambda a: _zarr_type(a, "|O", "object")),
    "items of 2 GB": partial(_zarr_key, change=lambda a: _zarr_type(a, "|V2000000000", "r16e9")),
    "another endianness": partial(_zarr_key, change=_turn),
    "by columns": _set(order="F"),
    "no codec": _set(compressor=None, codecs=[{"name": "bytes"}]),
    "gzip": _set(
        compressor={"id": "gzip", "level": 1},
        codecs=[{"name": "bytes"}, {"name": "gzip", "configuration": {"level": 1}}],
    ),
    "1,000 filters": _set(filters=[{"id": "delta", "dtype": "<f4"}] * 1000),
    "a filter of Python": _set(filters=[{"id": "pickle"}]),
    "another separator": _set(
        dimension_separator="/",
        chunk_key_encoding={"name": "v2", "configuration": {"separator": "."}},
    ),
    "a fill of text": _set(fill_value="x" * 1000),
    "a fill of a list": _set(fill_value=[1, [2]]),
    "no fill": _set(fill_value=None),
    "version 9": _set(zarr_format=9),
    "shards in each other": _set(
        codecs=[
            {
                "name": "sharding_indexed",
                "configuration": {
                    "chunk_shape": [1],
                    "codecs": [{"name": "bytes"}],
                    "index_codecs": [{"name": "bytes"}],
                },
            }
        ]
    ),
    **JSON,
}


def _chunk(path: Path, rng: Rng, made: Callable[[], bytes], codec: Any = None) -> None:
    """A chunk of other bytes, under another codec if given."""
    for place in path.parents:
        about = place / ".zarray"
        if about.exists() and codec is not None:
            plain = json.loads(about.read_text())
            about.write_text(json.dumps({**plain, "compressor": codec, "filters": None}))
        about = place / "zarr.json"
        if (
            about.exists()
            and codec is not None
            and "shape" in (plain := json.loads(about.read_text()))
        ):
            name = codec["id"]
            ends = {"zstd": {"level": 0, "checksum": False}, "gzip": {"level": 1}}.get(name)
            coded = [{"name": "bytes", "configuration": {"endian": "little"}}]
            coded += [{"name": name if ends else f"numcodecs.{name}", "configuration": ends or {}}]
            about.write_text(json.dumps({**plain, "codecs": coded}))
            break
        if (place / ".zarray").exists():
            break
    path.write_bytes(made())


def _blosc(said: int) -> bytes:
    return struct.pack("<BBBBIII", 2, 1, 0x21, 1, said, said, 1016) + bytes(1000)


def _is_gone(path: Path, rng: Rng) -> None:
    path.unlink()


def _copies(path: Path, rng: Rng) -> None:
    for i in range(2000):
        shutil.copy(path, path.with_name(str(10_000 + i)))


CHUNK: dict[str, Change] = {
    "missing": _is_gone,
    "a bomb of gzip": partial(_chunk, made=lambda: bomb("gzip"), codec={"id": "gzip", "level": 1}),
    "a bomb of zlib": partial(_chunk, made=lambda: bomb("zlib"), codec={"id": "zlib", "level": 1}),
    "a bomb of zstd": partial(_chunk, made=lambda: bomb("zstd"), codec={"id": "zstd", "level": 0}),
    "a bomb of bz2": partial(_chunk, made=lambda: bomb("bz2"), codec={"id": "bz2", "level": 1}),
    "a bomb of lzma": partial(_chunk, made=lambda: bomb("xz"), codec={"id": "lzma"}),
    "a bomb of lz4": partial(
        _chunk,
        made=lambda: BOMB.to_bytes(4, "little") + bomb("lz4 block"),
        codec={"id": "lz4"},
    ),
    "2 GB of blosc, it says": partial(
        _chunk, made=lambda: _blosc(2_000_000_000), codec={"id": "blosc"}
    ),
    "blocks of nothing of blosc": partial(_chunk, made=lambda: _blosc(0), codec={"id": "blosc"}),
    "empty": partial(_chunk, made=lambda: b""),
    "100 MB": partial(_chunk, made=lambda: bytes(100_000_000)),
    "2,000 chunks more": _copies,
}

# --- HDF5


def _sets(file: h5py.File) -> list[str]:
    found: list[str] = []
    file.visititems(
        lambda name, node: found.append(name) if isinstance(node, h5py.Dataset) else None
    )
    return found


def _hdf(path: Path, rng: Rng, change: Callable[[h5py.File, str], object]) -> None:
    with h5py.File(path, "r+") as file:
        names = _sets(file)
        if not names:
            raise LookupError("no array")
        change(file, _pick(rng, names))


def _made_again(file: h5py.File, name: str, **how: Any) -> h5py.Dataset:
    old = file[name]
    attributes = dict(old.attrs)
    data = how.pop("change", lambda values: values)(old[()])
    del file[name]
    made = file.create_dataset(name, data=data, **how)
    made.attrs.update(attributes)
    return made


def _hdf_of(change: Callable[[Any], Any]) -> Change:
    return partial(_hdf, change=lambda file, name: _made_again(file, name, change=change))


def _grown(file: h5py.File, name: str, rows: int, **how: Any) -> None:
    """An array with more rows, none of them written."""
    old = file[name]
    shape, dtype = (rows, *old.shape[1:]), old.dtype
    if not old.ndim:
        raise LookupError("a number")
    del file[name]
    file.create_dataset(name, shape, dtype, chunks=(1, *shape[1:]), **how)


def _hdf_bomb(file: h5py.File, name: str, size: int = BOMB) -> None:
    """A chunk of a gigabyte, packed."""
    old = file[name]
    if not old.ndim or old.dtype.kind not in "iuf":
        raise LookupError("a number")
    made = _made_again(file, name, chunks=old.shape, compression="gzip")
    made.id.write_direct_chunk((0,) * made.ndim, bomb("zlib"))


def _lzf_bomb(file: h5py.File, name: str) -> None:
    old = file[name]
    if not old.ndim or old.dtype.kind not in "iuf":
        raise LookupError("a number")
    made = _made_again(file, name, chunks=old.shape, compression="lzf")
    run = b"\x00\x00" + b"\xe0\xff\x00" * 1_500_000  # 264 bytes from each three
    made.id.write_direct_chunk((0,) * made.ndim, run)


def _huge_chunks(file: h5py.File, name: str) -> None:
    old = file[name]
    if not old.ndim:
        raise LookupError("a number")
    shape, dtype, data = old.shape, old.dtype, old[()]
    del file[name]
    made = file.create_dataset(
        name, shape, dtype, chunks=(400_000_000 // max(1, data[:1].nbytes), *shape[1:]),
        maxshape=(None, *shape[1:]), compression="gzip",
    )  # fmt: skip
    made[...] = data


def _in_place(file: h5py.File, name: str, put: Callable[[h5py.File, str], object]) -> None:
    del file[name]
    put(file, name)


def _loop_of_groups(file: h5py.File, name: str) -> None:
    first = file.require_group("aa/bb/cc")
    first["up"] = file["aa"]
    first["top"] = file["/"]
    file[name].parent["again"] = file["/"]


def _hdf_deep(file: h5py.File, name: str) -> None:
    place = file
    for _ in range(1500):
        place = place.create_group("g")
    place["x"] = file[name]


def _wide_links(file: h5py.File, name: str) -> None:
    """Each of 25 groups is in the one above it twice."""
    place = file.create_group("w")
    for _ in range(25):
        inner = place.create_group("a")
        place["b"] = inner
        place = inner
    place["x"] = file[name]


def _many_sets(file: h5py.File, name: str) -> None:
    place = file.create_group("many")
    for i in range(1000):
        place[f"{i}"] = file[name]


def _texts(file: h5py.File, name: str) -> None:
    old = file[name]
    rows = old.shape[0] if old.ndim else 1
    del file[name]
    file.create_dataset(name, data=["x" * 3_000_000] * min(rows, 60), dtype=h5py.string_dtype())


def _attribute(file: h5py.File, name: str) -> None:
    node = file[name]
    for key in [*node.attrs]:
        node.attrs[key] = "y" * 60_000
    node.attrs["more"] = np.zeros(8000, "S8")


def _virtual(file: h5py.File, name: str) -> None:
    old = file[name]
    shape, dtype = old.shape, old.dtype
    del file[name]
    made = h5py.VirtualLayout(shape, dtype)
    made[...] = h5py.VirtualSource("/etc/passwd", "x", shape=shape, dtype=dtype)
    file.create_virtual_dataset(name, made)


HDF: dict[str, Change] = {
    "a shape of 1e8": partial(_hdf, change=lambda f, n: _grown(f, n, 100_000_000)),
    "a shape of 2^40": partial(_hdf, change=lambda f, n: _grown(f, n, 1 << 40)),
    "no rows": partial(_hdf, change=lambda f, n: _grown(f, n, 0, maxshape=(None, *f[n].shape[1:]))),
    "a row less": _hdf_of(lambda values: values[:-1]),
    "rows turned round": _hdf_of(lambda values: values[::-1]),
    "an axis more": _hdf_of(lambda values: np.asarray(values)[None]),
    "another type": _hdf_of(lambda values: np.asarray(values).astype("f8")),
    "a smaller type": _hdf_of(lambda values: np.asarray(values).astype("i1")),
    "bytes turned": _hdf_of(lambda v: np.asarray(v).astype(np.asarray(v).dtype.newbyteorder(">"))),
    "fields": _hdf_of(lambda v: np.zeros(np.shape(v), [("a", "f4"), ("b", "i8")])),
    "complex numbers": _hdf_of(lambda values: np.asarray(values).astype("c16")),
    "nan": _hdf_of(lambda values: np.full(np.shape(values), np.nan)),
    "a bomb of gzip": partial(_hdf, change=_hdf_bomb),
    "a bomb of lzf": partial(_hdf, change=_lzf_bomb),
    "chunks of 400 MB": partial(_hdf, change=_huge_chunks),
    "a group in its place": partial(
        _hdf, change=lambda f, n: _in_place(f, n, lambda g, m: g.create_group(m))
    ),
    "missing": partial(_hdf, change=lambda f, n: _in_place(f, n, lambda g, m: None)),
    "no values": partial(
        _hdf,
        change=lambda f, n: _in_place(f, n, lambda g, m: g.create_dataset(m, data=h5py.Empty("f"))),
    ),
    "a link to itself": partial(
        _hdf,
        change=lambda f, n: _in_place(f, n, lambda g, m: g.__setitem__(m, h5py.SoftLink(f"/{m}"))),
    ),
    "a link to another file": partial(
        _hdf,
        change=lambda f, n: _in_place(
            f, n, lambda g, m: g.__setitem__(m, h5py.ExternalLink("/etc/passwd", "/x"))
        ),
    ),
    "values in another file": partial(
        _hdf,
        change=lambda f, n: _in_place(
            f,
            n,
            lambda g, m: g.create_dataset(m, (8, 3), "u1", external=[("/etc/passwd", 0, 24)]),
        ),
    ),
    "values of other files": partial(_hdf, change=_virtual),
    "groups in themselves": partial(_hdf, change=_loop_of_groups),
    "1,500 groups in each other": partial(_hdf, change=_hdf_deep),
    "2^25 names of a group": partial(_hdf, change=_wide_links),
    "1,000 names of an array": partial(_hdf, change=_many_sets),
    "texts of 3 MB": partial(_hdf, change=_texts),
    "attributes of 64 kB": partial(_hdf, change=_attribute),
    "filters: fletcher32 and shuffle": partial(
        _hdf, change=lambda f, n: _made_again(f, n, fletcher32=True, shuffle=True, chunks=True)
    ),
}

# --- MATLAB 5


def _mat(path: Path, rng: Rng, change: Callable[[Any], Any], packed: bool = False) -> None:
    if path.read_bytes()[:10] == b"MATLAB 7.3":
        raise LookupError("HDF5")
    found = {k: v for k, v in scipy_io.loadmat(path).items() if k[:1] != "_"}
    name = _pick(rng, [*found])
    found[name] = change(found[name])
    scipy_io.savemat(path, found, do_compression=packed, long_field_names=True)


def _mat_sizes(path: Path, rng: Rng, sizes: tuple[int, int], kind: int = 0) -> None:
    """Sizes and type of an unpacked variable."""
    _mat(path, rng, lambda values: values)
    raw = path.read_bytes()
    mark = b"\x06\x00\x00\x00\x08\x00\x00\x00"  # flags of an array
    found = [one.start() for one in re.finditer(re.escape(mark), raw)]
    at = _pick(rng, found)
    count = int.from_bytes(raw[at + 20 : at + 24], "little")
    new = bytearray(raw)
    new[at + 24 : at + 32] = struct.pack("<ii", *sizes)
    if count > 8:
        new[at + 32 : at + 24 + count] = b"\1\0\0\0" * ((count - 8) // 4)
    if kind:
        new[at + 8] = kind
    path.write_bytes(new)


def _nested(depth: int) -> Any:
    value: Any = {"x": 1.0}
    for _ in range(depth):
        value = {"s": value}
    return value


def _mat_packed_sizes(path: Path, rng: Rng) -> None:
    """A variable of a gigabyte, packed a thousandfold."""
    _mat(path, rng, lambda values: values)
    raw, name = path.read_bytes(), b"boom"
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    sizes = struct.pack("<IIii", 5, 8, BOMB >> 3, 1)
    head = flags + sizes + struct.pack("<II", 1, len(name)) + name.ljust(8, b"\0")
    head += struct.pack("<II", 9, BOMB)
    coder = zlib.compressobj(6)
    out = [coder.compress(struct.pack("<II", 14, len(head) + BOMB) + head)]
    out += [coder.compress(bytes(1 << 25)) for _ in range(BOMB >> 25)] + [coder.flush()]
    packed = b"".join(out)
    path.write_bytes(raw + struct.pack("<II", 15, len(packed)) + packed)


MAT: dict[str, Change] = {
    "a bomb": _mat_packed_sizes,
    "a shape of 1e8": partial(_mat_sizes, sizes=(100_000_000, 3)),
    "a shape of 2^31": partial(_mat_sizes, sizes=(2**31 - 1, 2**31 - 1)),
    "a negative size": partial(_mat_sizes, sizes=(-5, 3)),
    "1e8 cells": partial(_mat_sizes, sizes=(100_000_000, 1), kind=1),
    "1e8 structs": partial(_mat_sizes, sizes=(100_000_000, 1), kind=2),
    "1e8 objects": partial(_mat_sizes, sizes=(100_000_000, 1), kind=3),
    "1e8 letters": partial(_mat_sizes, sizes=(100_000_000, 1), kind=4),
    "1e8 sparse": partial(_mat_sizes, sizes=(100_000_000, 100_000_000), kind=5),
    "1e8 bytes": partial(_mat_sizes, sizes=(100_000_000, 1), kind=9),
    "a function": partial(_mat_sizes, sizes=(1, 1), kind=16),
    "packed": partial(_mat, change=lambda values: values, packed=True),
    "200 structs in each other": partial(_mat, change=lambda values: _nested(200)),
    "cells": partial(
        _mat, change=lambda values: np.array([values, "x", None, []], dtype=object)[:2]
    ),
    "another type": partial(_mat, change=lambda values: np.asarray(values).astype("f8")),
    "complex numbers": partial(_mat, change=lambda values: np.asarray(values) + 1j),
    "turned round": partial(_mat, change=lambda values: np.asarray(values).T),
    "a row less": partial(_mat, change=lambda values: values[:-1]),
    "no rows": partial(_mat, change=lambda values: values[:0]),
    "another endianness": lambda path, rng: _at(path, 126, b"MI"),
    "version 4": lambda path, rng: _at(path, 0, b"\0\0\0\0"),
}

# --- parquet, feather


def _table(path: Path) -> Any:
    return feather.read_table(path) if path.suffix == ".feather" else parquet.read_table(path)


def _write_table(path: Path, table: Any, **how: Any) -> None:
    if path.suffix == ".feather":
        feather.write_feather(table, path, **how)
    else:
        parquet.write_table(table, path, **how)


def _arrow(path: Path, rng: Rng, change: Callable[[Any, int], Any], **how: Any) -> None:
    table = _table(path)
    column = int(rng.integers(0, table.num_columns))
    _write_table(path, change(table, column), **how)


def _column(table: Any, at: int, values: Any) -> Any:
    return table.set_column(at, table.column_names[at], values)


def _long(table: Any, at: int) -> Any:
    """Ten million equal rows, in a dictionary of a few bytes."""
    row = table.slice(0, 1)
    picked = arrow.array(np.zeros(10_000_000, np.int32))
    columns = []
    for one in row.columns:
        single = one.combine_chunks()
        if arrow.types.is_nested(single.type) or (single.nbytes > 64):
            single = arrow.array([None], single.type)
        columns.append(arrow.DictionaryArray.from_arrays(picked, single))
    return arrow.table(columns, table.column_names)


def _footer(path: Path, rng: Rng, new: int) -> None:
    _at(path, path.stat().st_size - 8, new.to_bytes(4, "little"))


ARROW: dict[str, Change] = {
    "a column twice": partial(
        _arrow, change=lambda t, i: t.append_column(t.column_names[i], t.column(i))
    ),
    "a column less": partial(_arrow, change=lambda t, i: t.remove_column(i)),
    "a column of nothing": partial(
        _arrow, change=lambda t, i: _column(t, i, arrow.nulls(len(t), t.column(i).type))
    ),
    "a column without a type": partial(
        _arrow, change=lambda t, i: _column(t, i, arrow.nulls(len(t)))
    ),
    "a column of texts": partial(_arrow, change=lambda t, i: _column(t, i, ["x"] * len(t))),
    "a column of floats": partial(_arrow, change=lambda t, i: _column(t, i, [0.5] * len(t))),
    "a column of -1": partial(_arrow, change=lambda t, i: _column(t, i, [-1] * len(t))),
    "a column of 2^62": partial(_arrow, change=lambda t, i: _column(t, i, [1 << 62] * len(t))),
    "a column of lists": partial(
        _arrow, change=lambda t, i: _column(t, i, [[0.5] * (k % 3) for k in range(len(t))])
    ),
    "a column of lists in each other": partial(
        _arrow, change=lambda t, i: _column(t, i, [[[[[1]]]]] * len(t))
    ),
    "a column of records": partial(
        _arrow, change=lambda t, i: _column(t, i, [{"a": 1, "bytes": b"x"}] * len(t))
    ),
    "texts of 3 MB": partial(
        _arrow,
        change=lambda t, i: (
            _column(t, i, ["x" * 3_000_000] * min(len(t), 50)) if len(t) <= 50 else t.slice(0, 0)
        ),
    ),
    "times": partial(
        _arrow,
        change=lambda t, i: _column(t, i, arrow.array([1 << 60] * len(t), arrow.timestamp("ns"))),
    ),
    "no rows": partial(_arrow, change=lambda t, i: t.slice(0, 0)),
    "a row less": partial(_arrow, change=lambda t, i: t.slice(0, len(t) - 1)),
    "rows turned round": partial(_arrow, change=lambda t, i: t.take(list(range(len(t)))[::-1])),
    "a row twice": partial(_arrow, change=lambda t, i: arrow.concat_tables([t, t.slice(0, 1)])),
    "10,000,000 equal rows": partial(_arrow, change=_long),
    "packed by zstd": partial(_arrow, change=lambda t, i: t, compression="zstd"),
}
PARQUET: dict[str, Change] = {
    **ARROW,
    "a group for each row": partial(_arrow, change=lambda t, i: t, row_group_size=1),
    "a footer of 2 GB": partial(_footer, new=2_000_000_000),
    "a footer of nothing": partial(_footer, new=0),
    "encrypted": lambda path, rng: _at(path, path.stat().st_size - 4, b"PARE"),
}

# --- bags


def _records(raw: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, first byte and size of the content of each record of an mcap."""
    at = 8
    while at + 9 <= len(raw) - 8:
        size = int.from_bytes(raw[at + 1 : at + 9], "little")
        yield raw[at], at + 9, size
        at += 9 + size


def _mcap_chunk(path: Path, rng: Rng, coding: str, packed: Callable[[], bytes], said: int) -> None:
    """An mcap with a bomb for a chunk, and without an index."""
    raw = path.read_bytes()
    begin = next(at for kind, at, _ in _records(raw) if kind == 6)
    head = raw[begin : begin + 16] + said.to_bytes(8, "little") + bytes(4)
    content = packed()
    head += len(coding).to_bytes(4, "little") + coding.encode() + len(content).to_bytes(8, "little")
    record = b"\x06" + (len(head) + len(content)).to_bytes(8, "little") + head + content
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20)
    path.write_bytes(raw[: begin - 9] + record + footer + raw[:8])


def _mcap_indexed(
    path: Path, rng: Rng, coding: str, packed: Callable[[], bytes], said: int
) -> None:
    """The same, with an index: the bomb is behind all others, and all chunks are said to be it."""
    raw = path.read_bytes()
    content = packed()
    start = next(at for kind, at, _ in _records(raw) if kind == 15) - 9
    first = next(at for kind, at, _ in _records(raw) if kind == 6)
    head = raw[first : first + 16] + said.to_bytes(8, "little") + bytes(4)
    head += len(coding).to_bytes(4, "little") + coding.encode() + len(content).to_bytes(8, "little")
    record = b"\x06" + (len(head) + len(content)).to_bytes(8, "little") + head + content
    rest = bytearray(raw[start:])
    at, out = 0, bytearray()
    while at < len(rest) - 8:
        kind, size = rest[at], int.from_bytes(rest[at + 1 : at + 9], "little")
        body = bytes(rest[at + 9 : at + 9 + size])
        if kind == 8:
            places = int.from_bytes(body[32:36], "little")
            body = (
                body[:16] + start.to_bytes(8, "little") + len(record).to_bytes(8, "little")
                + body[32 : 36 + places + 8] + len(coding).to_bytes(4, "little") + coding.encode()
                + len(content).to_bytes(8, "little") + said.to_bytes(8, "little")
            )  # fmt: skip
        if kind == 2:
            begin = int.from_bytes(raw[-28:-20], "little") + len(record)
            body = begin.to_bytes(8, "little") + bytes(12)
        out += bytes([kind]) + len(body).to_bytes(8, "little") + body
        at += 9 + size
    path.write_bytes(raw[:start] + record + bytes(out) + raw[-8:])


def _mcap_field(path: Path, rng: Rng, kind: int, place: int, new: bytes) -> None:
    """Bytes of a record of a kind."""
    raw = path.read_bytes()
    found = [at for one, at, _ in _records(raw) if one == kind]
    if not found:
        raise LookupError("no such record")
    _at(path, _pick(rng, found) + place, new)


def _mcap_repeat(path: Path, rng: Rng, kind: int, times: int) -> None:
    """Records of a kind of the summary, repeated."""
    raw = path.read_bytes()
    where = [(at - 9, at + size) for one, at, size in _records(raw) if one == kind]
    if not where:
        raise LookupError("no such record")
    begin, end = where[-1]
    path.write_bytes(raw[:end] + raw[begin:end] * times + raw[end:])


_BIG, _NEGATIVE = b"\xff" * 7 + b"\x7f", b"\xff" * 8
_HUGE, _BEGIN = (1 << 50).to_bytes(8, "little"), (8).to_bytes(8, "little")
_SIZES = tuple(bytes([size, 0, 0, 0]) for size in (4, 6, 8, 9, 10))
MCAP: dict[str, Change] = {
    **{
        f"a bomb of {coding}, {'with' if found is _mcap_indexed else 'without'} an index": partial(
            found, coding=coding, packed=partial(bomb, coding), said=BOMB
        )
        for coding in ("zstd", "lz4")
        for found in (_mcap_chunk, _mcap_indexed)
    },
    "a bomb of zstd that says 4 kB": partial(
        _mcap_chunk, coding="zstd", packed=partial(bomb, "zstd"), said=4096
    ),
    "a chunk that says 1 PB": partial(_mcap_field, kind=6, place=16, new=_HUGE),
    "an index that says 1 PB": partial(_mcap_field, kind=8, place=24, new=_BIG),
    "an index that is negative": partial(_mcap_field, kind=8, place=16, new=_NEGATIVE),
    "an index of itself": partial(_mcap_field, kind=8, place=16, new=_BEGIN),
    "a record of 1 PB": partial(_mcap_field, kind=6, place=-8, new=_HUGE),
    "a record of nothing": partial(_mcap_field, kind=6, place=-8, new=bytes(8)),
    "a footer that leads to the begin": partial(_mcap_field, kind=2, place=0, new=_BEGIN),
    "a footer that leads to itself": partial(_mcap_field, kind=2, place=0, new=_BIG),
    "2^62 messages": partial(_mcap_field, kind=11, place=0, new=_BIG),
    "times of 2^63": partial(_mcap_field, kind=8, place=8, new=_NEGATIVE),
    "another channel": partial(_mcap_field, kind=4, place=0, new=b"\x09\x00"),
    "another schema": partial(_mcap_field, kind=4, place=2, new=b"\x01\x00"),
    "a schema of 4 GB": partial(_mcap_field, kind=3, place=2, new=b"\xff\xff\xff\xff"),
    "2,000 times the same chunk": partial(_mcap_repeat, kind=8, times=2000),
    "20,000 times the same channel": partial(_mcap_repeat, kind=4, times=20_000),
    "times the same schema": partial(_mcap_repeat, kind=3, times=3),
}  # fmt: skip


def _ros1_chunk(path: Path, rng: Rng, coding: str) -> None:
    raw = path.read_bytes()
    content, name = bomb(coding), b"compression="
    at = raw.index(name)
    begin = at + len(name)
    old = raw[begin : begin + 4]
    # the record of the chunk: its header, then 4 bytes of size, then content
    header = raw.rindex(b"op=\x05", 0, len(raw))
    size_at = max(at + len(name) + len(old), header) + 64
    for place in range(begin, size_at):
        size = int.from_bytes(raw[place : place + 4], "little")
        end = place + 4 + size
        if size > 100 and raw[end + 4 :][:4] in _SIZES and raw[end : end + 4] == b"/\0\0\0":
            break
    else:
        raise LookupError("no chunk")
    name_new = raw[begin:place].replace(b"none", coding.encode().ljust(3)[:4])
    grown = len(name_new) - (place - begin) + len(content) - size
    out = bytearray(
        raw[:begin] + name_new + len(content).to_bytes(4, "little") + content + raw[end:]
    )
    field = at - 4
    length = int.from_bytes(out[field : field + 4], "little")
    out[field : field + 4] = (length + len(name_new) - (place - begin)).to_bytes(4, "little")
    index = raw.index(b"index_pos=") + len(b"index_pos=")
    pos = int.from_bytes(raw[index : index + 8], "little") + grown
    out[index : index + 8] = pos.to_bytes(8, "little")
    _fix_header(out, at, len(name_new) - (place - begin))
    path.write_bytes(out)


def _fix_header(raw: bytearray, at: int, grown: int) -> None:
    """Length of the header of a record with a field."""
    for start in range(at - 4, max(0, at - 200), -1):
        size = int.from_bytes(raw[start : start + 4], "little")
        if 20 < size < 200 and start + 4 + size > at and raw[start + 4 + 4 :][:1].isalpha():
            first = int.from_bytes(raw[start + 4 : start + 8], "little")
            if 3 < first < 40 and start != at - 4:
                raw[start : start + 4] = (size + grown).to_bytes(4, "little")
                return
    raise LookupError("no header")


def _ros1_field(path: Path, rng: Rng, name: str, new: bytes) -> None:
    raw = path.read_bytes()
    found = [one.end() for one in re.finditer(re.escape(f"{name}=".encode()), raw)]
    if not found:
        raise LookupError(name)
    _at(path, _pick(rng, found), new)


def _ros1_again(path: Path, rng: Rng) -> None:
    """The entry of the index for a chunk, 3,000 times."""
    raw = path.read_bytes()
    found = [one.start() for one in re.finditer(b"op=\x06", raw)]
    header = min(found) - 8
    while not 40 < int.from_bytes(raw[header : header + 4], "little") < 200:
        header -= 1
    size = int.from_bytes(raw[header : header + 4], "little")
    data = int.from_bytes(raw[header + 4 + size : header + 8 + size], "little")
    record = raw[header : header + 8 + size + data]
    out = bytearray(raw[:header] + record * 3000 + raw[header + len(record) :])
    count = raw.index(b"chunk_count=") + len(b"chunk_count=")
    old = int.from_bytes(raw[count : count + 4], "little")
    out[count : count + 4] = (old + 2999).to_bytes(4, "little")
    path.write_bytes(out)


BAG: dict[str, Change] = {
    "a bomb of bz2": partial(_ros1_chunk, coding="bz2"),
    "a bomb of lz4": partial(_ros1_chunk, coding="lz4"),
    "4e9 topics": partial(_ros1_field, name="conn_count", new=b"\xff" * 4),
    "4e9 chunks": partial(_ros1_field, name="chunk_count", new=b"\xff" * 4),
    "no chunk": partial(_ros1_field, name="chunk_count", new=bytes(4)),
    "an index at the begin": partial(_ros1_field, name="index_pos", new=(13).to_bytes(8, "little")),
    "an index at 2^63": partial(_ros1_field, name="index_pos", new=_BIG),
    "a chunk at the begin": partial(_ros1_field, name="chunk_pos", new=(13).to_bytes(8, "little")),
    "a chunk at 2^63": partial(_ros1_field, name="chunk_pos", new=_BIG),
    "a chunk packed in another way": partial(_ros1_field, name="compression", new=b"zstd"),
    "a chunk packed by bz2, it says": partial(_ros1_field, name="compression", new=b"bz2 "),
    "a chunk of 4 GB": partial(_ros1_field, name="size", new=b"\xff" * 4),
    "a time of 4e9": partial(_ros1_field, name="start_time", new=b"\xff" * 8),
    "another topic": partial(_ros1_field, name="conn", new=b"\x07\0\0\0"),
    "4e9 messages": partial(_ros1_field, name="count", new=b"\xff" * 4),
    "another type": partial(_ros1_field, name="type", new=b"geometry_msgs"),
    "another digest": partial(_ros1_field, name="md5sum", new=b"00000000"),
    "3,000 times the same chunk": _ros1_again,
    "version 1.2": lambda path, rng: _at(path, 0, b"#ROSBAG V1.2\n"),
}


def _sql(path: Path, rng: Rng, lines: str) -> None:
    with closing(sqlite3.connect(path)) as base:
        base.executescript(lines)
        base.commit()


_NO_END = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"
_SCRIPTS = {
    "messages without end": f"DROP TABLE messages; CREATE VIEW messages AS {_NO_END} x AS id, 1 AS "
    "topic_id, x AS timestamp, x'00' AS data FROM c",
    "a schema without end": f"DROP TABLE schema; CREATE VIEW schema AS {_NO_END} count(*) AS "
    "schema_version, 'x' AS ros_distro FROM c",
    "types without end": "DROP TABLE message_definitions; CREATE VIEW message_definitions AS "
    f"{_NO_END} x AS id, 'x' AS topic_type, 'ros2msg' AS encoding, 'y' AS "
    "encoded_message_definition, 'z' AS type_description_hash FROM c",
    "a generated column": "ALTER TABLE messages RENAME TO m; CREATE TABLE messages(id INTEGER, "
    "topic_id INTEGER, timestamp INTEGER, raw BLOB, data BLOB AS (zeroblob(900000000))); INSERT "
    "INTO messages SELECT id, topic_id, timestamp, data FROM m",
    "a time without end": "ALTER TABLE messages RENAME TO m; CREATE TABLE messages(id INTEGER, "
    "topic_id INTEGER, t INTEGER, data BLOB, timestamp INTEGER AS (t + "
    "length(hex(zeroblob(400000000))))); INSERT INTO messages SELECT id, topic_id, timestamp, data "
    "FROM m",
    "a virtual table": "DROP TABLE topics; CREATE VIRTUAL TABLE topics USING fts5(id, name, type, "
    "serialization_format, offered_qos_profiles, type_description_hash)",
    "a message of 900 MB": "UPDATE messages SET data = zeroblob(900000000) WHERE id = 3",
    "a message of text": "UPDATE messages SET data = 'x' WHERE id % 7 = 3",
    "a message of nothing": "UPDATE messages SET data = NULL WHERE id % 7 = 3",
    "a message of a number": "UPDATE messages SET data = 7 WHERE id % 7 = 3",
    "half of a message": "UPDATE messages SET data = substr(data, 1, length(data) / 2) WHERE "
    "id % 7 = 3",
    "a time of text": "UPDATE messages SET timestamp = 'soon' WHERE id % 7 = 3",
    "a time of -1": "UPDATE messages SET timestamp = -1 WHERE id % 7 = 3",
    "a time of 2^62": "UPDATE messages SET timestamp = 4611686018427387904 WHERE id % 7 = 3",
    "all at one time": "UPDATE messages SET timestamp = 5",
    "no message": "DELETE FROM messages",
    "400,000 messages": "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, "
    "timestamp + b.x, x'00010000' FROM messages, (WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT"
    " x + 1 FROM c LIMIT 40000) SELECT x FROM c) b LIMIT 400000",
    "a topic twice": "INSERT INTO topics SELECT id + 50, name, type, serialization_format, "
    "offered_qos_profiles, type_description_hash FROM topics",
    "another type": "UPDATE topics SET type = 'geometry_msgs/msg/Wrench'",
    "an unknown type": "UPDATE topics SET type = 'x'",
    "a name of 10 MB": "UPDATE topics SET name = hex(zeroblob(5000000)) WHERE id = 1",
    "qualities of 10 MB": "UPDATE topics SET offered_qos_profiles = hex(zeroblob(5000000))",
    "a bomb of qualities": "UPDATE topics SET offered_qos_profiles = 'a: &a [x,x]' || char(10) || "
    "'b: &b [*a,*a]' || char(10) || 'c: [*b,*b]'",
    "a name of nothing": "UPDATE topics SET name = NULL",
    "no table of messages": "DROP TABLE messages",
    "schema 99": "UPDATE schema SET schema_version = 99",
    "schema of text": "UPDATE schema SET schema_version = 'four'",
    "an index of the times that lies": "CREATE INDEX lies ON messages(timestamp); PRAGMA "
    "writable_schema = 1; UPDATE sqlite_master SET sql = 'CREATE INDEX lies ON messages(topic_id)' "
    "WHERE name = 'lies'",
}  # fmt: skip


def _pages(path: Path, rng: Rng) -> None:
    """A page of the file in the place of another: trees leading into themselves."""
    raw = bytearray(path.read_bytes())
    size = int.from_bytes(raw[16:18], "big") or 4096
    count = len(raw) // size
    one, other = int(rng.integers(1, count)), int(rng.integers(0, count))
    raw[one * size : one * size + size] = raw[other * size : other * size + size]
    path.write_bytes(raw)


DB3: dict[str, Change] = {
    **{said: partial(_sql, lines=lines) for said, lines in _SCRIPTS.items()},
    "a page in the place of another": _pages,
    "a journal without end": lambda path, rng: path.with_name(f"{path.name}-wal").write_bytes(
        bytes.fromhex("377f0682002de218") + bytes(5000)
    ),
    "page size 1": lambda path, rng: _at(path, 16, b"\0\1"),
}

# --- videos


def _box(path: Path, rng: Rng, name: bytes, place: int, new: bytes) -> None:
    """Bytes of a box of an mp4, from the end of its name."""
    raw = path.read_bytes()
    at = raw.find(name)
    if at < 0:
        raise LookupError(name)
    _at(path, at + 4 + place, new)


def _boxes(path: Path, rng: Rng) -> None:
    raw = path.read_bytes()
    inner = b""
    for _ in range(20_000):
        inner = (8 + len(inner)).to_bytes(4, "big") + b"moov" + inner
        if len(inner) > 100_000:
            break
    path.write_bytes(raw + inner)


def _edits(path: Path, rng: Rng) -> None:
    """500,000 edits in the place of one."""
    raw = path.read_bytes()
    at = raw.find(b"edts")
    count = 500_000
    entry = struct.pack(">IIHH", 1, 0, 1, 0)
    made = struct.pack(">I4sII", 16 + 12 * count, b"elst", 0, count) + entry * count
    if at >= 0:
        raise LookupError("edits")
    _grow(path, [b"moov", b"trak"], struct.pack(">I4s", 8 + len(made), b"edts") + made)


def _grow(path: Path, around: list[bytes], more: bytes) -> None:
    """Puts bytes at the end of a box of boxes."""
    raw = bytearray(path.read_bytes())
    at = 0
    for name in around:
        at = raw.find(name, at)
        if at < 0:
            raise LookupError(name)
        size = int.from_bytes(raw[at - 4 : at], "big")
        raw[at - 4 : at] = (size + len(more)).to_bytes(4, "big")
    end = at - 4 + int.from_bytes(raw[at - 4 : at], "big") - len(more)
    raw[end:end] = more
    path.write_bytes(raw)


MP4: dict[str, Change] = {
    "2^31 frames": partial(_box, name=b"stsz", place=8, new=b"\x7f\xff\xff\xff"),
    "1e8 frames of one size": partial(_box, name=b"stsz", place=4, new=b"\0\0\1\0\5\xf5\xe1\0"),
    "4e9 entries of times": partial(_box, name=b"stts", place=4, new=b"\xff\xff\xff\xff"),
    "frames of no duration": partial(_box, name=b"stts", place=12, new=bytes(4)),
    "frames of a long duration": partial(_box, name=b"stts", place=12, new=b"\x7f\xff\xff\xff"),
    "4e9 frames of a duration": partial(_box, name=b"stts", place=8, new=b"\xff\xff\xff\xff"),
    "4e9 chunks": partial(_box, name=b"stco", place=4, new=b"\xff\xff\xff\xff"),
    "a chunk at 4 GB": partial(_box, name=b"stco", place=8, new=b"\xff\xff\xff\xf0"),
    "4e9 frames in a chunk": partial(_box, name=b"stsc", place=12, new=b"\xff\xff\xff\xff"),
    "no time scale": partial(_box, name=b"mdhd", place=12, new=bytes(4)),
    "a time scale of 4e9": partial(_box, name=b"mdhd", place=12, new=b"\xff\xff\xff\xff"),
    "a duration of 4e9": partial(_box, name=b"mdhd", place=16, new=b"\xff\xff\xff\xff"),
    "65535 x 65535 pixels": partial(_box, name=b"mp4v", place=24, new=b"\xff\xff\xff\xff"),
    "16000 x 16000 pixels": partial(_box, name=b"tkhd", place=76, new=b"\x3e\x80\0\0\x3e\x80\0\0"),
    "turned by a quarter": partial(
        _box,
        name=b"tkhd",
        place=40,
        new=struct.pack(">9i", 0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30),
    ),
    "another codec": partial(_box, name=b"mp4v", place=-4, new=b"avc1"),
    "no begin": partial(_box, name=b"ftyp", place=-8, new=bytes(8)),
    "a box of nothing": partial(_box, name=b"stbl", place=-8, new=bytes(4)),
    "a box of 2^63": partial(_box, name=b"stbl", place=-8, new=b"\0\0\0\1stbl" + b"\x7f" * 8),
    "boxes in each other": _boxes,
    "500,000 edits": _edits,
}
AVI: dict[str, Change] = {
    "2^31 frames": partial(_box, name=b"avih", place=20, new=b"\xff\xff\xff\x7f"),
    "2^31 frames of the stream": partial(_box, name=b"strh", place=36, new=b"\xff\xff\xff\x7f"),
    "no rate": partial(_box, name=b"strh", place=28, new=bytes(4)),
    "no scale": partial(_box, name=b"strh", place=24, new=bytes(4)),
    "a rate of 4e9": partial(_box, name=b"strh", place=28, new=b"\xff\xff\xff\xff"),
    "65535 x 65535 pixels": partial(_box, name=b"strf", place=8, new=b"\xff\xff\0\0\xff\xff\0\0"),
    "negative height": partial(_box, name=b"strf", place=12, new=b"\xd8\xff\xff\xff"),
    "another codec": partial(_box, name=b"strf", place=20, new=b"FFV1"),
    "no codec": partial(_box, name=b"strf", place=20, new=bytes(4)),
    "an index of 4 GB": partial(_box, name=b"idx1", place=0, new=b"\xff\xff\xff\xff"),
    "an index that leads to the begin": partial(_box, name=b"idx1", place=12, new=bytes(4)),
    "a list of nothing": partial(_box, name=b"movi", place=-8, new=bytes(4)),
    "a list of 4 GB": partial(_box, name=b"movi", place=-8, new=b"\xff\xff\xff\xff"),
    "streams of 2^31": partial(_box, name=b"avih", place=28, new=b"\xff\xff\xff\x7f"),
}

# --- pictures


def _png(kind: bytes, content: bytes) -> bytes:
    crc = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", crc)


def _png_size(path: Path, rng: Rng, width: int, height: int, depth: int = 8, kind: int = 2) -> None:
    raw = path.read_bytes()
    head = _png(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0))
    path.write_bytes(raw[:8] + head + raw[8 + len(head) :])


def _png_more(path: Path, rng: Rng, more: Callable[[], bytes]) -> None:
    raw = path.read_bytes()
    path.write_bytes(raw[:33] + more() + raw[33:])


def _png_bomb(path: Path, rng: Rng) -> None:
    head = _png(b"IHDR", struct.pack(">IIBBBBB", 8000, 8000, 8, 2, 0, 0, 0))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + _png(b"IDAT", bomb("zlib")) + _png(b"IEND", b""))


def _again(path: Path, rng: Rng, change: Callable[[Any], Any], form: str = "", **how: Any) -> None:
    with Image.open(path) as picture:
        made, kind = change(picture.convert("RGB")), form or picture.format
    made.save(path, format=kind, **how)


def _frames(path: Path, rng: Rng) -> None:
    with Image.open(path) as picture:
        one = picture.convert("RGB")
    one.save(path, format="PNG", save_all=True, append_images=[one.rotate(k) for k in range(200)])


PICTURES: dict[str, Change] = {
    "another size": partial(_again, change=lambda p: p.resize((7, 5))),
    "one pixel": partial(_again, change=lambda p: p.resize((1, 1))),
    "60,000 x 1 pixels": partial(_again, change=lambda p: p.resize((60_000, 1))),
    "8,192 x 4,096 pixels": partial(_again, change=lambda p: p.resize((8192, 4096))),
    "12,000 x 12,000 pixels": partial(_again, change=lambda p: p.resize((12_000, 12_000))),
    "grey": partial(_again, change=lambda p: p.convert("L")),
    "BMP inside": partial(_again, change=lambda p: p, form="BMP"),
    "GIF inside": partial(_again, change=lambda p: p, form="GIF"),
    "TIFF inside": partial(_again, change=lambda p: p, form="TIFF"),
    "WebP inside": partial(_again, change=lambda p: p, form="WEBP"),
    "a picture of text": lambda path, rng: path.write_text("P3 2 2 255 " + "1 2 3 " * 4),
    "a vector": lambda path, rng: path.write_text("<svg><text>x</text></svg>"),
}
PNG: dict[str, Change] = {
    **PICTURES,
    "2^31 x 2^31 pixels, it says": partial(_png_size, width=2**31 - 1, height=2**31 - 1),
    "8,000 x 8,000 pixels, it says": partial(_png_size, width=8000, height=8000),
    "no pixels": partial(_png_size, width=0, height=40),
    "depth 3": partial(_png_size, width=48, height=40, depth=3),
    "colours that it has not": partial(_png_size, width=48, height=40, kind=3),
    "a bomb of pixels": _png_bomb,
    "a bomb of text": partial(
        _png_more, more=lambda: _png(b"zTXt", b"Comment\0\0" + bomb("zlib"))
    ),
    "a bomb of a profile": partial(
        _png_more, more=lambda: _png(b"iCCP", b"icc\0\0" + bomb("zlib"))
    ),
    "50,000 texts": partial(_png_more, more=lambda: _png(b"tEXt", b"k\0v") * 50_000),
    "200 pictures": _frames,
    "sixteen bits": partial(_again, change=lambda p: p.convert("I")),
    "an alpha": partial(_again, change=lambda p: p.convert("RGBA").rotate(20)),
}  # fmt: skip


def _scans(path: Path, rng: Rng) -> None:
    """A progressive JPEG of 4,096 x 4,096 pixels with one scan a hundred times."""
    held = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    Image.fromarray(noise).resize((4096, 4096)).save(held, "JPEG", progressive=True, quality=10)
    raw = held.getvalue()
    found = [one.start() for one in re.finditer(b"\xff\xda", raw)]
    last = raw[found[-1] : -2]
    path.write_bytes(raw[:-2] + last * 100 + raw[-2:])


def _jpg_size(path: Path, rng: Rng, width: int, height: int) -> None:
    raw = path.read_bytes()
    at = max(raw.find(b"\xff\xc0"), raw.find(b"\xff\xc2"))
    if at < 0:
        raise LookupError("no size")
    _at(path, at + 5, struct.pack(">HH", height, width))


def _jpg_again(path: Path, rng: Rng, times: int) -> None:
    raw = path.read_bytes()
    found = [one.start() for one in re.finditer(b"\xff\xdb", raw)]
    size = int.from_bytes(raw[found[0] + 2 : found[0] + 4], "big") + 2
    part = raw[found[0] : found[0] + size]
    path.write_bytes(raw[: found[0]] + part * times + raw[found[0] :])


#: An orientation, 6: a quarter turn.
_EXIF = b"Exif\0\0MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"
JPG: dict[str, Change] = {
    **PICTURES,
    "65,535 x 65,535 pixels, it says": partial(_jpg_size, width=65535, height=65535),
    "8,000 x 8,000 pixels, it says": partial(_jpg_size, width=8000, height=8000),
    "no pixels": partial(_jpg_size, width=0, height=0),
    "a scan a hundred times": _scans,
    "100,000 tables": partial(_jpg_again, times=100_000),
    "progressive": partial(_again, change=lambda p: p, progressive=True),
    "CMYK": partial(_again, change=lambda p: p.convert("CMYK"), form="JPEG"),
    "an orientation": partial(
        _again, change=lambda p: p, form="JPEG", exif=_EXIF,
    ),
}  # fmt: skip

# --- weights, pickles, meshes


def _tensors(path: Path, rng: Rng, change: Callable[[dict[str, Any]], object]) -> None:
    raw = path.read_bytes()
    size = int.from_bytes(raw[:8], "little")
    head = json.loads(raw[8 : 8 + size])
    change(head)
    text = json.dumps(head).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + raw[8 + size :])


def _first(head: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = next(one for name, one in head.items() if name != "__metadata__")
    return found


def _tensor_twice(path: Path, rng: Rng) -> None:
    raw = path.read_bytes()
    size = int.from_bytes(raw[:8], "little")
    text = raw[8 : 8 + size].rstrip()
    name = next(one for one in json.loads(text) if one != "__metadata__")
    about = json.dumps(json.loads(text)[name])
    text = text[:-1] + f', "{name}": {about}}}'.encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + raw[8 + size :])


SAFETENSORS: dict[str, Change] = {
    "a header of 2^60 bytes": lambda path, rng: _at(path, 0, (1 << 60).to_bytes(8, "little")),
    "a header of nothing": lambda path, rng: _at(path, 0, bytes(8)),
    "a shape of 1e8": partial(_tensors, change=lambda h: _first(h).update(shape=[10**8])),
    "a shape of 2^64": partial(_tensors, change=lambda h: _first(h).update(shape=[2**32, 2**32])),
    "a negative size": partial(_tensors, change=lambda h: _first(h).update(shape=[-1])),
    "another type": partial(_tensors, change=lambda h: _first(h).update(dtype="F64")),
    "an unknown type": partial(_tensors, change=lambda h: _first(h).update(dtype="X9")),
    "places of the whole file": partial(
        _tensors, change=lambda h: _first(h).update(data_offsets=[0, 1 << 40])
    ),
    "places turned round": partial(
        _tensors, change=lambda h: _first(h).update(data_offsets=[64, 0])
    ),
    "a tensor less": partial(
        _tensors, change=lambda h: h.pop(next(k for k in h if k != "__metadata__"))
    ),
    "a tensor twice": _tensor_twice,
    "a tensor that overlaps": partial(_tensors, change=lambda h: h.update(zz=_first(h))),
    "metadata of 40 MB": partial(
        _tensors, change=lambda h: h.setdefault("__metadata__", {}).update(k="x" * 40_000_000)
    ),
    "metadata of a list": partial(_tensors, change=lambda h: h.update(__metadata__=[1])),
    "20,000 empty tensors": partial(
        _tensors,
        change=lambda h: h.update(
            {f"e{i}": {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]} for i in range(20_000)}
        ),
    ),
}


class _Global:
    """A name of the module os in a pickle."""

    def __reduce__(self) -> Any:
        return os.getcwd, ()


def _doubled(depth: int) -> Any:
    value: Any = ["x"]
    for _ in range(depth):
        value = [value, value]
    return value


def _itself() -> Any:
    value: list[Any] = []
    value.append(value)
    return value


def _shape(path: Path, rng: Rng, old: int, new: int) -> None:
    """A size of an array of a pickle."""
    raw = path.read_bytes()
    mark = b"K" + bytes([old])
    if mark not in raw:
        raise LookupError(old)
    path.write_bytes(raw.replace(mark, b"J" + new.to_bytes(4, "little", signed=True), 1))


def _put(value: Callable[[], Any]) -> Change:
    return lambda path, rng: path.write_bytes(pickle.dumps(value()))


PKL: dict[str, Change] = {
    "lists in each other, 2^40 texts": _put(lambda: _doubled(40)),
    "a dict of them": _put(lambda: {"a": _doubled(40), "force": _doubled(30)}),
    "a list of itself": _put(_itself),
    "a name of os": _put(_Global),
    "100,000 lists in each other": lambda path, rng: path.write_bytes(
        b"\x80\x04" + b"]" * 100_000 + b"a" * 99_999 + b"."
    ),
    "a text of 4 GB, it says": lambda path, rng: path.write_bytes(b"\x80\x04X\xff\xff\xff\xff."),
    "a text of 2^63, it says": lambda path, rng: path.write_bytes(b"\x80\x04\x8e" + _BIG + b"."),
    "a frame of 2^63": lambda path, rng: path.write_bytes(b"\x80\x04\x95" + _BIG + b"N."),
    "a bytearray of 1 GB": lambda path, rng: path.write_bytes(
        b"\x80\x05\x96" + (1 << 30).to_bytes(8, "little") + b"."
    ),
    "a number of 2^31 bytes": lambda path, rng: path.write_bytes(b"\x80\x04\x8b\xff\xff\xff\x7f."),
    "a memo at 2^31": lambda path, rng: path.write_bytes(b"\x80\x02Nr\xff\xff\xff\x7f."),
    "an array of 1e8": _put(lambda: np.broadcast_to(np.float32(1), (3, 2))),
    "a size of 1e8": partial(_shape, old=9, new=100_000_000),
    "a size of -1": partial(_shape, old=9, new=-1),
    "nothing": _put(lambda: None),
    "a set": _put(lambda: {1, 2}),
    "protocol 0": lambda path, rng: path.write_bytes(
        pickle.dumps(pickle.loads(path.read_bytes()), 0)
    ),
    "packed by zlib": lambda path, rng: path.write_bytes(zlib.compress(path.read_bytes())),
    "two pickles": lambda path, rng: path.write_bytes(path.read_bytes() * 2),
}
STL: dict[str, Change] = {
    "4e9 faces": lambda path, rng: _at(path, 80, b"\xff\xff\xff\xff"),
    "no faces": lambda path, rng: _at(path, 80, bytes(4)),
    "nan": lambda path, rng: _at(path, 96, b"\xff" * 12),
    "1e38": lambda path, rng: _at(path, 96, struct.pack("<3f", 1e38, -1e38, 1e38)),
    "text": lambda path, rng: path.write_text("solid x\nendsolid x\n"),
    "text of one corner": lambda path, rng: path.write_text(
        "solid x\nfacet normal 0 0 1\nouter loop\nvertex 1 2 3\nendloop\nendfacet\nendsolid\n"
    ),
}

#: Changes by kind of file.
CHANGES: dict[str, dict[str, Change]] = {
    ".json": JSON, ".jsonl": JSON, ".yaml": YAML, ".csv": CSV, ".txt": CSV, ".npy": NPY,
    ".npz": NPZ, ".zip": ZIP, ".xlsx": ZIP, ".pth": ZIP, ".pt": ZIP, ".tar": TAR,
    ".zarray": ZARRAY, "zarr.json": ZARRAY, "chunk": CHUNK, ".hdf5": HDF, ".h5": HDF,
    ".mat": {**MAT, **HDF}, ".parquet": PARQUET, ".feather": ARROW, ".mcap": MCAP, ".bag": BAG,
    ".db3": DB3, ".mp4": MP4, ".mov": MP4, ".avi": AVI, ".png": PNG, ".jpg": JPG,
    ".safetensors": SAFETENSORS, ".pkl": PKL, ".stl": STL,
}  # fmt: skip


def kind_of(path: Path) -> str:
    """Kind of a file, a key of `CHANGES`, or its ending."""
    if path.name in CHANGES:
        return path.name
    if re.fullmatch(r"\d+(\.\d+)*", path.name):
        return "chunk"
    if path.name == "file":
        return ".pt" if path.read_bytes()[:2] == b"PK" else ".yaml"
    return path.suffix


def changes(root: Path, rng: Rng) -> list[tuple[Path, str, Change]]:
    """All changes of a file of each kind in a folder, in an order drawn."""
    files = sorted(one for one in root.rglob("*") if one.is_file() and one.name[0] != ".")
    files += sorted(root.rglob(".zarray"))
    kinds: dict[str, list[Path]] = {}
    for path in files:
        kinds.setdefault(kind_of(path), []).append(path)
    out: list[tuple[Path, str, Change]] = []
    for kind, paths in kinds.items():
        for said, change in CHANGES.get(kind, {}).items():
            out.append((_pick(rng, paths), said, change))
    for said, change in ANY.items():
        out.append((_pick(rng, files), said, change))
    return [out[i] for i in rng.permutation(len(out))]
