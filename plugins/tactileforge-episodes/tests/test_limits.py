"""Costs of damaged or hostile files: limits of links, chunks and unpacking, by the reader."""

import bz2
import io
import json
import os
import re
import shutil
import struct
import tarfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
import zarr
from made_episodes import (
    htt,
    jpegs,
    open_x_tactile,
    pictures,
    univtac,
    write_hdf5,
    write_zarr,
)
from numcodecs import Zstd
from tactileforge_episodes import hdf_chunks
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.grids import Grid
from tactileforge_episodes.hdf import HdfFile
from tactileforge_episodes.hdf_chunks import lzf_size
from tactileforge_episodes.mat_limits import check_mat5
from tactileforge_episodes.members import FolderMembers, TarMembers
from tactileforge_episodes.places import Place
from tactileforge_episodes.refs import ArrayRef
from tactileforge_episodes.slices import Handle, Slice

from tactileforge.plugin import DataError

FORCE = "data/right_tactile_data_force"


def read(root, preset="open_x_tactile", **options):
    """Recordings by the end of their key, and the data set."""
    if preset == "open_x_tactile":
        options = {"fps": 10} | options
    data = Episodes(str(root), preset=preset, val=0, **options)
    return list(data.recordings("train")), data


def two_sets(tmp_path):
    """A sound zarr of six recordings, and one to be damaged."""
    shutil.move(open_x_tactile(tmp_path / "made"), tmp_path / "set/sound.zarr")
    return shutil.move(open_x_tactile(tmp_path / "made"), tmp_path / "set/toy.zarr")


def the_one_fault(tmp_path):
    """The only line on skipped files; the sound set is read whole."""
    found, data = read(tmp_path / "set")
    assert [one.key.partition("/")[0] for one in found] == ["sound"] * 6
    (line,) = data.skipped
    assert "\n" not in line
    return line


@pytest.mark.parametrize("version", [2, 3])
def test_pictures_of_a_missing_chunk_are_no_black_pictures(version, tmp_path):
    arrays = {
        "meta/episode_ends": np.array([8, 12]),
        "data/left_gripper1_img": pictures(12, 24, 32, 3),
        "data/action": np.zeros((12, 4), "f4"),
    }
    path = write_zarr(tmp_path / "x.zarr", arrays, version, chunk=4)
    name = "1.0.0.0" if version == 2 else "c/1/0/0/0"
    (path / "data/left_gripper1_img" / name).unlink()
    (sound,), data = read(tmp_path, "reactive_diffusion")
    np.testing.assert_array_equal(sound.frames.read([0, 3]), pictures(12, 24, 32, 3)[[8, 11]])
    (line,) = data.skipped
    assert "x.zarr, data/left_gripper1_img: 4 of 8 pictures, the first of row 4, lie in a" in line


@pytest.mark.filterwarnings("ignore:The data type")  # of texts, in version 3
@pytest.mark.parametrize("version", [2, 3])
def test_forces_of_a_missing_chunk_are_unknown_and_not_zero(version, tmp_path):
    path = open_x_tactile(tmp_path, version=version)
    (path / FORCE / ("1.0.0" if version == 2 else "c/1/0/0")).unlink()
    found, data = read(tmp_path)
    forces = [one.force for one in found if one.key.endswith("_0")]
    unknown = np.isnan(np.concatenate(forces)).any(1)  # 40 rows; chunks of 10
    assert np.flatnonzero(unknown).tolist() == [*range(10, 20)]
    (line,) = [note for note in data.notes if "missing chunk" in note]
    assert f"toy.zarr, {FORCE}: 10 of 15 rows, from row 10 on, lie in a missing chunk" in line


def test_chunks_of_no_size_are_named(tmp_path):
    about = two_sets(tmp_path) / FORCE / ".zarray"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"chunks": [0, 0, 0]}))
    assert f"toy.zarr, {FORCE}: cannot be read (shape [40, 2, 3] in chunks of [0, 0, 0])" in (
        the_one_fault(tmp_path)
    )


def test_links_that_loop_or_lead_away_are_named_and_not_entered(tmp_path):
    path = open_x_tactile(tmp_path / "set")
    (path / "data/me").symlink_to(".")
    shutil.move(path / FORCE, tmp_path / "away")
    (path / FORCE).symlink_to(tmp_path / "away")
    found, data = read(tmp_path / "set")
    assert len(found) == 6
    assert all(one.force is None for one in found), "read from beside the set"
    for name in ("data/me", FORCE):
        (line,) = [note for note in data.notes if f"toy.zarr/{name}" in note]
        assert line.endswith("a link that loops, or leads out of toy.zarr")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes with a name")
@pytest.mark.timeout(60)
def test_a_pipe_in_place_of_a_chunk_is_named(tmp_path):
    chunk = two_sets(tmp_path) / FORCE / "1.0.0"
    chunk.unlink()
    os.mkfifo(chunk)
    assert f"toy.zarr/{FORCE}/1.0.0: no regular file" in the_one_fault(tmp_path)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.timeout(60)
def test_groups_with_many_names_are_entered_once(packed, tmp_path):
    path = univtac(tmp_path / "set")
    with h5py.File(path, "r+") as file:
        file.create_group("w0")
        for i in range(11):  # 8 ** 11 paths
            group = file.create_group(f"w{i + 1}")
            for name in range(8):
                file[f"w{i}"][f"c{name}"] = group
    if packed:
        with tarfile.open(tmp_path / "set.tar", "w") as tar:
            tar.add(tmp_path / "set", "set")
        shutil.rmtree(tmp_path / "set")
    found, data = read(tmp_path, "univtac")
    assert [one.key[-13:] for one in found] == ["/left_tactile", "right_tactile"]
    (line,) = [note for note in data.notes if "the same group as" in note]
    assert "0.hdf5, w0/c0" in line
    assert line.endswith("; 87 further names of groups are left out so")


def test_a_sensor_behind_a_link_to_another_file_is_named(tmp_path):
    path = univtac(tmp_path / "set")
    write_hdf5(tmp_path / "other.h5", {"x": jpegs(pictures(6, 24, 32, 3))})
    with h5py.File(path, "r+") as file:
        del file["tactile/left_tactile/rgb"]
        file["tactile/left_tactile/rgb"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
    found, data = read(tmp_path / "set", "univtac")
    assert [one.key for one in found] == ["insert_hole/clean/0/right_tactile"]
    assert data.notes[-1].endswith(
        "0.hdf5, tactile/left_tactile/rgb: a link to another file, which is not followed"
    )


@pytest.mark.parametrize(
    ("key", "values", "wanted"),
    [
        ("6d_force", np.zeros((6, 1_500_000)), "has 1500000 numbers a row, which are no force"),
        (
            "tactile_img",
            np.zeros((6, 2000, 2000, 3), "u1"),
            r"72000128 bytes unpacked from \d+: no data compress so well",
        ),
    ],
    ids=["columns", "unpacked"],
)
def test_a_member_of_an_npz_that_unpacks_to_anything_is_named(key, values, wanted, tmp_path):
    htt(tmp_path)
    path = tmp_path / "slip/gsmini/processed/p1_sphere/a.npz"
    with np.load(path) as held:
        size = {"ref_frame": values[0]} if key == "tactile_img" else {}
        np.savez_compressed(path, **{**held, **size, key: values})
    assert path.stat().st_size < 200_000
    found, data = read(tmp_path, "htt", fps=25)
    sound = next(one for one in found if one.key.startswith("force/"))
    assert sound.frames.read([5]).shape == (1, 24, 32, 3)
    said = [*data.skipped]
    for bomb in found:
        if bomb is not sound:  # its pictures are unpacked when they are asked for
            with pytest.raises(DataError) as error:
                bomb.frames.read([0])
            said.append(str(error.value))
    (line,) = said
    assert re.search(f"slip/.*a.npz, {key}: .*{wanted}", line), line


def test_a_chunk_of_zstd_that_unpacks_to_more_than_its_values_is_not_unpacked(tmp_path):
    path = two_sets(tmp_path)
    shutil.rmtree(path / FORCE)
    made = zarr.open_group(path)["data"].create_array(
        FORCE.partition("/")[2], shape=(40, 2, 3), dtype="f4", chunks=(10, 2, 3), compressors=Zstd()
    )
    made[:] = 1
    bomb = Zstd().encode(bytes(1 << 23))
    (path / FORCE / "1.0.0").write_bytes(bomb)
    line = the_one_fault(tmp_path)
    assert f"{len(bomb)} bytes that unpack to more than its values of" in line


# --- chunks of HDF5


def hdf_of(path, values, chunk=None, **how):
    """An HDF5 file of one packed array, its only chunk given."""
    with h5py.File(path, "w") as file:
        made = file.create_dataset("x", data=values, chunks=values.shape, **how)
        if chunk is not None:
            made.id.write_direct_chunk((0,) * values.ndim, chunk)
    return HdfFile(str(path), Slice(Handle(path)))


ZEROS = np.zeros((40, 30, 30), np.uint8)


@pytest.mark.parametrize("how", [{"compression": "gzip"}, {"compression": "lzf"}])
def test_a_packed_chunk_that_holds_its_values_is_read(how, tmp_path):
    values = np.random.default_rng(0).integers(200, 256, (60, 100, 100)).astype(np.uint8)
    for more in ({}, {"shuffle": True}, {"fletcher32": True}):
        file = hdf_of(tmp_path / "a.h5", values, **how, **more)
        assert (file.read("x", 0, 60) == values).all()


def test_a_bomb_of_gzip_in_hdf5(monkeypatch, tmp_path):
    monkeypatch.setattr(hdf_chunks, "MOST_BYTES", 1 << 10)
    bomb = zlib.compress(bytes(1 << 20))
    file = hdf_of(tmp_path / "a.h5", ZEROS, bomb, compression="gzip")
    wanted = r"a.h5, x, chunk at \(0, 0, 0\): \d+ bytes that unpack to more than its values of"
    with pytest.raises(DataError, match=wanted):
        file.read("x", 0, 40)


@pytest.mark.parametrize(
    ("number", "values", "head"),
    [
        (307, (), bz2.compress(bytes(1 << 20))),
        (32001, (), struct.pack("<4I", 0, 1 << 20, 0, 16)),
        (32004, (), struct.pack(">Q", 1 << 20)),
        (32008, (0, 4, 1, 0, 2), struct.pack(">Q", 1 << 20)),
        (32008, (0, 4, 1, 0, 3), struct.pack(">Q", 1 << 20)),
        (32008, (0, 4, 1, 8192, 0), None),
        (32008, (), None),
    ],
)
def test_a_bomb_of_a_registered_filter_in_hdf5(number, values, head, tmp_path):
    """Filters by their numbers: bz2, blosc, lz4, and bitshuffle with a coder and without."""
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_chunk((4,))
    plan.set_filter(number, h5py.h5z.FLAG_OPTIONAL, values)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space = h5py.h5s.create_simple((8,))
        found = h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_UINT8, space, plan)
        found.write_direct_chunk((0,), head or bytes(range(200, 208)))
        found.write_direct_chunk((4,), head or bytes(range(200, 208)), filter_mask=1)  # left out
    with h5py.File(tmp_path / "a.h5") as file:
        chunks = hdf_chunks.Chunks("a", file["x"])
        chunks.check(4, 8)
        if not head:
            return chunks.check(0, 4)
        with pytest.raises(DataError, match=r"a, chunk at \(0,\): .*more than its values of"):
            chunks.check(0, 4)


def test_a_bomb_of_lzf_in_hdf5(monkeypatch, tmp_path):
    monkeypatch.setattr(hdf_chunks, "_SMALL", 1 << 10)
    bomb = b"\x00\x00" + b"\xe0\xff\x00" * 4000
    assert lzf_size(bomb, 1 << 30) >= 4000 * 264
    with pytest.raises(DataError, match="that unpack to more than its values of 101536 bytes"):
        hdf_of(tmp_path / "a.h5", ZEROS, bomb, compression="lzf").read("x", 0, 40)


def test_the_size_of_lzf_is_counted():
    assert lzf_size(bytes([2, 1, 2, 3, 0x20, 0]), 5) == 3 + 3
    assert lzf_size(bytes([0, 255, 0, 255, 0, 255]), 6) == 3  # literals of 255, and no repeat
    assert lzf_size(bytes([0, 7, 0xE0, 10, 0]), 10) == 1 + 19


def test_a_chunk_that_is_packed_twice(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        about = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        about.set_chunk((40, 30, 30))
        about.set_deflate(1)
        about.set_deflate(1)
        h5py.h5d.create(
            file.id, b"x", h5py.h5t.STD_U8LE, h5py.h5s.create_simple((40, 30, 30)), about
        )
    with pytest.raises(DataError, match=r"a.h5, x: compressed twice"):
        HdfFile("a.h5", Slice(Handle(tmp_path / "a.h5"))).read("x", 0, 40)


def test_an_array_of_which_more_is_lost_than_anyone_loses(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (100_000_000, 2), "f4", chunks=(10, 2))
        file.create_dataset("y", (100_000_000,), "u1")
        file["x"][0] = 1
    opened = HdfFile("a.h5", Slice(Handle(tmp_path / "a.h5")))
    for key, count in (("x", 10_000_000), ("y", 100_000_000)):
        with pytest.raises(DataError, match=f"a.h5, {key}: its shape says {count} rows or more"):
            opened.lost(key, 0, 100_000_000)
    assert opened.lost("x", 0, 30) == [*range(10, 30)]


def test_a_shape_of_zarr_of_which_nothing_is_stored():
    grid = Grid("a", (100_000_000,), (10,), "", ".")
    with pytest.raises(DataError, match="its shape says 10000000 rows or more that are not stored"):
        grid.lost(FolderMembers(Path("/nonexistent")), 0, 100_000_000)
    grid = Grid("a", (100_000_000,), (50_000_000,), "", ".")
    with pytest.raises(DataError, match="its shape says 50000000 rows or more that are not stored"):
        grid.lost(FolderMembers(Path("/nonexistent")), 0, 100_000_000)


def test_an_array_that_is_read_whole_is_small(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (100_000_000,), "f8", chunks=(100_000,))
        file["y"] = np.arange(3)
    place = Place(str(tmp_path / "a.h5"), "", "hdf5")
    with pytest.raises(DataError, match=r"a.h5, x: 762 MB at once, where 256 MB are the limit"):
        ArrayRef(place, "x").whole()
    assert ArrayRef(place, "y").whole().tolist() == [0, 1, 2]


# --- MATLAB


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def variable(holder, sizes, inner=b"", name=b"x"):
    """A variable of MATLAB 5."""
    flags = element(6, struct.pack("<II", holder, 0))
    return element(14, flags + element(5, struct.pack("<ii", *sizes)) + element(1, name) + inner)


def mat_of(*elements):
    return io.BytesIO(b"MATLAB 5.0".ljust(124) + b"\0\1IM" + b"".join(elements))


def test_variables_of_matlab_5_within_limits():
    number = variable(6, (1, 1), element(9, bytes(8)))
    packed = zlib.compress(number)
    check_mat5("a", mat_of(number, element(15, packed), variable(1, (2, 1), number * 2)))
    check_mat5("a", mat_of(element(15, packed[:-8])))  # scipy says so
    bomb = zlib.compress(bytes(100 << 20))
    with pytest.raises(DataError, match=r"a: .* bytes unpacked from .*: no data compress so well"):
        check_mat5("a", mat_of(struct.pack("<II", 15, len(bomb)) + bomb))
    for holder in (1, 2, 3):
        with pytest.raises(DataError, match=r"a: 100000000 cells or structs in .* bytes"):
            check_mat5("a", mat_of(number, variable(holder, (100_000_000, 1))))
        inner = variable(1, (1, 1), variable(holder, (1000, 1000)))
        with pytest.raises(DataError, match=r"a: 1000000 cells or structs in .* bytes"):
            check_mat5("a", mat_of(element(15, zlib.compress(inner))))
    check_mat5("a", mat_of(variable(5, (9, 9))))
    with pytest.raises(DataError, match="a sparse array in a struct or cell"):
        check_mat5("a", mat_of(variable(1, (1, 1), variable(5, (9, 9)))))
    with pytest.raises(DataError, match="a sparse array in a struct or cell"):
        check_mat5(
            "a", mat_of(variable(1, (1, 2), number + variable(5, (9, 9)), b"x".ljust(16, b"\0")))
        )
    deep = number
    for _ in range(40):
        deep = variable(1, (1, 1), deep)
    with pytest.raises(DataError, match="more than 32 structs and cells in each other"):
        check_mat5("a", mat_of(deep))


def test_variables_of_matlab_4_within_limits():
    good = struct.pack("<5i", 0, 3, 2, 0, 2) + b"x\0" + bytes(48)
    check_mat5("a", io.BytesIO(good * 2))
    swapped = struct.pack(">5i", 1000, 3, 2, 0, 2) + b"x\0" + bytes(48)
    check_mat5("a", io.BytesIO(swapped))
    for head in ((0, 10**8, 3, 0, 2), (0, -1, 2, 0, 2), (0, 3, 2, 1, 2)):
        with pytest.raises(DataError, match=f"a variable of {head[1]} x {head[2]} values, and no"):
            check_mat5("a", io.BytesIO(struct.pack("<5i", *head) + b"x\0" + bytes(48)))
        with pytest.raises(DataError, match="values, and no such bytes"):
            check_mat5("a", io.BytesIO(struct.pack("<5i", *head)))


def test_a_header_of_a_tar_is_small(tmp_path):
    with tarfile.open(tmp_path / "a.tar", "w", format=tarfile.PAX_FORMAT) as file:
        about = tarfile.TarInfo("x.h5")
        about.pax_headers = {"comment": "9" * (1 << 20)}
        file.addfile(about)
    with pytest.raises(DataError, match=r"a.tar: not a readable tar .*a header of 1048.* bytes"):
        TarMembers(tmp_path / "a.tar")
