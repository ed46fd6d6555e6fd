"""The index of a tar, beside Python's tarfile, and damaged tars."""

import gzip
import tarfile
from pathlib import Path

import pytest
from made_samples import add
from tactileforge_datasets.samples.members import read_members

from tactileforge.errors import DataError

LONG = "folder_" * 20 + "/" + "name_" * 19 + ".jpg"
NAMES = ("a.jpg", "b/c.d.json", LONG, "caf\u00e9.txt", "empty.txt", "x" * 300 + ".npy")


def made(path: Path, form: int) -> Path:
    with tarfile.open(path, "w", format=form) as tar:
        for i, name in enumerate(NAMES):
            add(tar, name, bytes([i]) * (0 if name.startswith("empty") else 700 * i + 1))
            folder = tarfile.TarInfo(f"folder_{i}")
            folder.type = tarfile.DIRTYPE
            tar.addfile(folder)
        link = tarfile.TarInfo("link.jpg")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(link)
    return path


@pytest.mark.parametrize("form", [tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_names_and_places_are_those_of_tarfile(tmp_path: Path, form: int) -> None:
    path = made(tmp_path / "a.tar", form)
    index = read_members(path)
    with tarfile.open(path) as tar:
        expected = [(one.name, one.offset_data, one.size) for one in tar if one.isfile()]
    assert [(name, blob.offset, blob.size) for name, blob in index.members] == expected
    assert [name for name, _ in index.members] == list(NAMES)
    assert index.damage == ""
    assert index.members[2][1].read() == b"\x02" * 1401


def test_long_paths_of_ustar(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        add(tar, LONG, b"1")
    assert [name for name, _ in read_members(path).members] == [LONG]


def test_a_size_in_base_256(tmp_path: Path) -> None:
    path = made(tmp_path / "a.tar", tarfile.GNU_FORMAT)
    raw = bytearray(path.read_bytes())
    raw[124:136] = b"\x80" + (1).to_bytes(11)
    raw[148:156] = b" " * 8
    raw[148:156] = b"%06o\0 " % sum(raw[:512])
    path.write_bytes(raw)
    assert [name for name, _ in read_members(path).members] == list(NAMES)


@pytest.mark.parametrize(
    ("change", "damage", "left"),
    [
        (lambda raw: raw[:3000], "it ends within '2.jpg'", 2),
        (lambda raw: raw[:3072], "it ends before its end mark", 3),
        (lambda raw: raw[:1030] + b"!" + raw[1031:], "no tar, or damaged at byte 1024", 1),
    ],
)
def test_members_before_a_damage_are_kept(tmp_path: Path, change, damage: str, left: int) -> None:
    path = tmp_path / "a.tar"
    with tarfile.open(path, "w", format=tarfile.GNU_FORMAT) as tar:
        for i in range(6):
            add(tar, f"{i}.jpg", b"x" * 500)
    path.write_bytes(change(path.read_bytes()))
    index = read_members(path)
    assert [name for name, _ in index.members] == [f"{i}.jpg" for i in range(left)]
    assert index.damage == damage


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it ends before its end mark"),
        (bytes(10240), "an empty tar"),
        (b"no tar at all" * 99, "no tar, or damaged at byte 0"),
        (gzip.compress(bytes(10240)), "compressed, so no member can be found; gunzip it"),
    ],
    ids=["cut", "empty", "text", "gzip"],
)
def test_what_is_no_tar_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.tar"
    path.write_bytes(content)
    with pytest.raises(DataError, match=rf"a\.tar: .*{words}"):
        read_members(path)
    with pytest.raises(DataError, match=r"b\.tar: cannot be read"):
        read_members(tmp_path / "b.tar")


def test_an_index_follows_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    for count in (1, 3):
        with tarfile.open(path, "w") as tar:
            for i in range(count):
                add(tar, f"{i}.jpg", b"x")
        assert len(read_members(path).members) == count
