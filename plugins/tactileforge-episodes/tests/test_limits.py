"""Costs of damaged or hostile files: limits of links, chunks and unpacking, by the reader."""

import json
import os
import re
import shutil
import tarfile

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
from tactileforge_episodes.dataset import Episodes

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
