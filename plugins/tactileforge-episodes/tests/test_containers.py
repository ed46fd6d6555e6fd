"""Arrays packed in different ways: the same recordings from each, and chunks alone."""

import json
import shutil
import zipfile

import h5py
import numpy as np
import pytest
import zarr
from made_episodes import open_x_tactile, pictures, tarred, univtac, write_hdf5, write_zarr, zipped
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.kept import KEPT, Kept
from tactileforge_episodes.members import FolderMembers, TarMembers, ZipMembers
from tactileforge_episodes.places import Place, find_places, open_place

from tactileforge.errors import DataError
from tactileforge.plugins import metadata
from tactileforge.reading import Facts
from tactileforge.testing import check_container


def oxt(root, **options):
    data = Episodes(str(root), preset="open_x_tactile", fps=10, val=0, **options)
    return data, list(data.recordings("train"))


@pytest.fixture
def folder(tmp_path):
    return open_x_tactile(tmp_path / "as_folder")


def root_zip(folder, out):
    return zipped(folder, out / "toy.zarr.zip")


def zip_with_folder(folder, out):
    return zipped(folder, out / "toy.zarr.zip", "toy.zarr")


def zip_of_one_episode(folder, out):
    return zipped(folder, out / "toy.zip", "toy.zarr")


def tar_with_set(folder, out):
    return tarred(folder, out / "VLA_touch.tar", ["VLA_touch", "toy.zarr"])


def compressed_zip(folder, out):
    archive = zipped(folder, out / "stored.zip", "toy.zarr")
    new = zipfile.ZipFile(out / "toy.zarr.zip", "w", zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(archive) as old, new:
        for name in old.namelist():
            new.writestr(name, old.read(name))
    archive.unlink()
    return out / "toy.zarr.zip"


PACKINGS = [root_zip, zip_with_folder, zip_of_one_episode, tar_with_set, compressed_zip]


@pytest.mark.parametrize("pack", PACKINGS, ids=lambda pack: pack.__name__)
def test_every_packaging_gives_the_same(pack, folder, tmp_path):
    out = tmp_path / "packed"
    out.mkdir()
    pack(folder, out)
    _, wanted = oxt(folder)
    data, found = oxt(out)
    assert data.skipped == []
    names = {"tar_with_set": "VLA_touch/toy", "zip_of_one_episode": "toy/toy"}
    name = names.get(pack.__name__, "toy")
    assert [one.key for one in found] == [one.key.replace("toy", name, 1) for one in wanted]
    for new, old in zip(found, wanted, strict=True):
        every = range(len(old.frames))
        np.testing.assert_array_equal(new.frames.read(every), old.frames.read(every))
        np.testing.assert_array_equal(new.image.read(every), old.image.read(every))
        np.testing.assert_array_equal(new.force, old.force)
        np.testing.assert_array_equal(new.tracks["state"], old.tracks["state"])
        assert new.text == old.text


def test_a_folder_and_its_archive_are_read_once(folder):
    root_zip(folder, folder.parent)
    data, found = oxt(folder.parent)
    assert len(found) == 6
    assert any("the same name as" in note for note in data.notes)


def test_what_computers_put_beside_data_is_no_data(folder, tmp_path):
    archive = zipped(folder, tmp_path / "toy.zarr.zip", "toy.zarr")
    with zipfile.ZipFile(archive, "a") as file:
        file.writestr("__MACOSX/toy.zarr/.zgroup", "no")
        file.writestr("._toy.zarr", "no")
    shutil.rmtree(folder.parent)
    data, found = oxt(tmp_path)
    assert (len(found), data.skipped) == (6, [])


@pytest.mark.parametrize("codec", ["sharded", "gzip", "none"])
def test_zarr_version_3(codec, tmp_path):
    frames = pictures(40, 24, 32, 3)
    root = zarr.open_group(tmp_path / "x.zarr", mode="w", zarr_format=3)
    options = {
        "sharded": {"chunks": (5, 24, 32, 3), "shards": (20, 24, 32, 3)},
        "gzip": {"chunks": (5, 24, 32, 3), "compressors": zarr.codecs.GzipCodec()},
        "none": {"chunks": (5, 24, 32, 3), "compressors": None},
    }[codec]
    root.create_array("data/front", shape=frames.shape, dtype="u1", **options)[:] = frames
    root["data"].create_array("left_gripper1_img", shape=frames.shape, dtype="u1", **options)
    root["data/left_gripper1_img"][:] = frames
    root["data"].create_array("action", data=np.ones((40, 4), "f4"))
    root.create_array("meta/episode_ends", data=np.array([15, 40]))
    data = Episodes(str(tmp_path), preset="reactive_diffusion", val=0)
    first, second = data.recordings("train")
    np.testing.assert_array_equal(second.frames.read([24, 0]), frames[[39, 15]])
    assert len(first.frames) == 15


def counted(monkeypatch):
    """Bytes of chunks read from now on."""
    read = FolderMembers.read
    total = []

    def reading(self, name, start=0, stop=None):
        content = read(self, name, start, stop)
        if content is not None and not name.endswith((".zarray", ".zattrs", "zarr.json")):
            total.append((name.rpartition("/")[2], len(content)))
        return content

    monkeypatch.setattr(FolderMembers, "read", reading)
    return total


def test_a_clip_of_zarr_reads_its_chunks_alone(tmp_path, monkeypatch):
    arrays = {
        "meta/episode_ends": np.array([200]),
        "data/left_gripper1_img": pictures(200, 24, 32, 3),
        "data/action": np.zeros((200, 2)),
    }
    write_zarr(tmp_path / "x.zarr", arrays, chunk=10)
    (one,) = Episodes(str(tmp_path), preset="reactive_diffusion", val=0).recordings("train")
    total = counted(monkeypatch)
    one.frames.read([58, 59, 60, 61])
    assert [name for name, _ in total] == ["5.0.0.0", "6.0.0.0"]
    one.frames.read([52, 69])  # kept in memory
    assert len(total) == 2


def test_an_inner_chunk_of_a_shard_is_read_alone(tmp_path, monkeypatch):
    frames = np.random.default_rng(0).integers(0, 255, (80, 24, 32, 3)).astype("u1")
    root = zarr.open_group(tmp_path / "x.zarr", mode="w", zarr_format=3)
    size = {"chunks": (5, 24, 32, 3), "shards": (80, 24, 32, 3)}
    made = root.create_array("data/left_gripper1_img", shape=frames.shape, dtype="u1", **size)
    made[:] = frames
    root.create_array("data/action", data=np.ones((80, 4), "f4"))
    root.create_array("meta/episode_ends", data=np.array([80]))
    (one,) = Episodes(str(tmp_path), preset="reactive_diffusion", val=0).recordings("train")
    total = counted(monkeypatch)
    np.testing.assert_array_equal(one.frames.read([41]), frames[[41]])
    assert sum(size for _, size in total) < frames.nbytes / 8  # of 16 inner chunks


@pytest.mark.parametrize("packed", ["zip", "tar"])
def test_hdf5_in_an_archive(packed, tmp_path):
    path = univtac(tmp_path / "made")
    top = path.parents[2]
    if packed == "zip":
        zipped(top, tmp_path / "UniVTAC.zip")
    else:
        tarred(top, tmp_path / "UniVTAC.tar", ["UniVTAC"])
    old = Episodes(str(top), preset="univtac", val=0).recordings("train")
    wanted = {one.key: one.frames.read([5]) for one in old}
    shutil.rmtree(top)
    data = Episodes(str(tmp_path), preset="univtac", val=0)
    found = {one.key.removeprefix("UniVTAC/"): one for one in data.recordings("train")}
    assert found.keys() == wanted.keys()
    for key, one in found.items():
        np.testing.assert_array_equal(one.frames.read([5]), wanted[key])
        assert one.labels["task"] == "insert_hole"


def test_a_compressed_member_that_cannot_be_read_in_part_is_named(tmp_path):
    path = univtac(tmp_path / "made")
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.write(path, "insert_hole/clean/0.hdf5")
    shutil.rmtree(tmp_path / "made")
    data = Episodes(str(tmp_path), preset="univtac", val=0)
    with pytest.raises(
        DataError, match=r"0\.hdf5 is compressed, so no part of it can be read; unpack"
    ):
        list(data.recordings("train"))


@pytest.mark.parametrize("way", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npz_of_any_order_and_compression(way, order, tmp_path):
    folder = tmp_path / "force/gsmini/processed/p2_box"
    folder.mkdir(parents=True)
    frames = np.asarray(pictures(9, 24, 32, 3), order=order)
    force = np.asarray(np.random.default_rng(0).random((9, 6)), order=order)
    rest = np.full((24, 32, 3), 100, "u1")
    way(
        folder / "a.npz",
        **{
            "tactile_img": frames,
            "6d_force": force,
            "ref_frame": rest,
            "probe": 2,
            "mode": "static",
        },
    )
    (one,) = Episodes(str(tmp_path), preset="htt", fps=25, val=0).recordings("train")
    np.testing.assert_array_equal(one.frames.read([8, 2]), frames[[8, 2]])
    np.testing.assert_allclose(one.force, force[:, :3], rtol=1e-6)


def test_rows_of_an_uncompressed_npz_are_read_alone(tmp_path, monkeypatch):
    np.savez(tmp_path / "a.npz", x=np.arange(10_000 * 30, dtype="f4").reshape(10_000, 30))
    file = open_place(Place(str(tmp_path / "a.npz"), "", "npz"))
    sizes = []
    inner = type(file._file)
    read = inner.read

    def counted(self, size=-1):
        sizes.append(len(content := read(self, size)))
        return content

    monkeypatch.setattr(inner, "read", counted)
    file.facts("x")
    sizes.clear()
    np.testing.assert_array_equal(file.read("x", 9_990, 9_992)[:, 0], [299_700, 299_730])
    assert sizes == [2 * 30 * 4]


def test_kept_rows_stay_within_their_memory_and_are_in_the_order_asked_for(tmp_path):
    values = np.arange(400_000, dtype="f8").reshape(4000, 100)
    write_zarr(tmp_path / "x.zarr", {"a": values}, chunk=100)
    file = open_place(Place(str(tmp_path / "x.zarr"), "", "zarr"))
    kept = Kept()
    rows = [3999, 0, 250, 250, 1]
    np.testing.assert_array_equal(kept.rows(file, "a", rows), values[rows])
    np.testing.assert_array_equal(kept.rows(file, "a", rows, ahead=True), values[rows])
    assert kept._bytes <= 1 << 27
    assert KEPT is not kept


@pytest.mark.parametrize("opened", [TarMembers, ZipMembers])
def test_members_outside_of_an_archive_do_not_exist(opened, folder, tmp_path):
    out = tmp_path / "packed"
    out.mkdir()
    if opened is ZipMembers:
        with zipfile.ZipFile(out / "a.zip", "w") as file:
            file.writestr("../outside.zarr/.zgroup", "{}")
            file.writestr("in/.zgroup", "{}")
        members = ZipMembers(out / "a.zip")
    else:
        members = TarMembers(tarred(folder, out / "a.tar", ["..", "outside.zarr"]))
    assert "outside.zarr" not in json.dumps(members.children(""))
    assert ".." not in members.children("")[0]


def test_a_file_that_is_replaced_is_read_anew(tmp_path):
    path = tmp_path / "a.hdf5"
    for number in (1, 2):
        with h5py.File(path, "w") as file:
            file["x"] = np.full(3 + number, number)
        place = Place(str(path), "", "hdf5")
        assert open_place(place).read("x", 0, 9).tolist() == [number] * (3 + number)


def test_places_are_found_in_order_and_groups_are_not_entered(folder, tmp_path):
    univtac(tmp_path)
    found = [str(place).removeprefix(f"{tmp_path}/") for place in find_places(tmp_path, print)]
    assert found == ["as_folder/toy.zarr", "insert_hole/clean/0.hdf5"]


@pytest.mark.parametrize("kind", ["zarr", "hdf5", "npz"])
def test_each_format_is_a_container(kind, tmp_path):
    arrays = {
        "a/touch": pictures(9, 8, 8, 3),
        "a/x": np.arange(18.0).reshape(9, 2),
        "n": np.arange(9),
    }
    if kind == "zarr":
        write_zarr(tmp_path / "a.zarr", arrays)
    elif kind == "hdf5":
        write_hdf5(tmp_path / "a.hdf5", arrays)
    else:
        np.savez(tmp_path / "a.npz", **arrays)
    (place,) = find_places(tmp_path, str)
    results = check_container(open_place(place))
    assert [one for one in results if one.status != "ran"] == []


class Whole:
    """An array in memory."""

    def __init__(self, values):
        self.values, self.facts = values, Facts(values.shape, values.dtype)

    def rows(self, rows):
        return self.values[list(rows)]


class Rig:
    """A format of another package: a folder that ends with `.rig`, with times of its own."""

    def __init__(self, path):
        self.arrays = dict(np.load(f"{path}/all.npz"))
        self.stamps = self.arrays.pop("stamps")

    def keys(self):
        return sorted(self.arrays)

    def array(self, key):
        return Whole(self.arrays[key])

    def times(self, key):
        return self.stamps

    def frames(self, key):
        return None


def test_a_container_of_another_package_is_found_guessed_and_read(tmp_path, monkeypatch):
    folder = tmp_path / "data" / "take.rig"
    folder.mkdir(parents=True)
    frames, force = pictures(6, 24, 32, 3), np.arange(18, dtype="f4").reshape(6, 3)
    stamps = 7 + np.array([0, 1, 2, 4, 5, 6]) / 25
    np.savez(folder / "all.npz", tactile=frames, force=force, stamps=stamps)
    monkeypatch.setitem(metadata.registered, ("containers", "rig"), Rig)
    guess = Episodes.recognise(tmp_path / "data")
    assert guess.format.startswith("rig")
    (one,) = Episodes(**guess.options, val=0).recordings("train")
    np.testing.assert_array_equal(one.frames.read(range(6)), frames)
    np.testing.assert_array_equal(one.force, force)
    np.testing.assert_allclose(one.times, stamps - 7, atol=1e-9)
