"""Damaged, contradictory or unsafe files are named and left out; the rest is read."""

import contextlib
import json
import pickle
import shutil
import struct
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest
import zarr
from bomb import Bomb
from made_episodes import (
    htt,
    open_x_tactile,
    pictures,
    reactive_diffusion,
    touch_in_the_wild,
    univtac,
    write_hdf5,
    write_zarr,
)
from numcodecs import Pickle
from tactileforge_episodes import codecs
from tactileforge_episodes.dataset import Episodes

from tactileforge.plugin import ConfigError, DataError, DataNotFoundError


def rdp(root, **options):
    return Episodes(str(root), preset="reactive_diffusion", val=0, **options)


def buffer(**changes):
    """Arrays of a replay buffer; None leaves one out."""
    arrays = {
        "meta/episode_ends": np.array([6, 12]),
        "data/left_gripper1_img": pictures(12, 24, 32, 3),
        "data/action": np.zeros((12, 4), "f4"),
    } | {
        f"data/{name}" if name != "ends" else "meta/episode_ends": v for name, v in changes.items()
    }
    return {key: values for key, values in arrays.items() if values is not None}


def refused(root, wanted, kind=DataError, preset="reactive_diffusion", **options):
    data = Episodes(str(root), preset=preset, val=0, **options)
    with pytest.raises(kind, match=wanted) as error:
        list(data.recordings("train"))
    assert "\n" not in str(error.value)
    return data


def test_a_folder_without_files_says_what_is_looked_for(tmp_path):
    refused(tmp_path, r"no file that ends like .*\.zarr.*set data.root", DataNotFoundError)
    refused(tmp_path / "absent", "set data.root", DataNotFoundError)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"action": None}, r"x.zarr: unknown key 'data/action'"),
        ({"left_gripper1_img": None, "left_gripper_1_img": pictures(12, 4, 4, 3)}, "did you mean"),
        ({"left_gripper1_img": pictures(12, 24, 32)}, r"uint8 \(12, 24, 32\), where uint8 \(T, H"),
        ({"left_gripper1_img": pictures(12, 24, 32, 3) / 255.0}, "for fractions or 16 bits give `white`"),
        ({"left_gripper1_img": np.zeros((12, 24, 32, 3), "u2")}, "uint16"),
        ({"action": np.zeros((11, 4), "f4")}, r"action: \(11, 4\), where touch has 12 rows"),
        ({"ends": np.array([6, 11])}, "the last episode ends at row 11, but touch has 12"),
        ({"ends": np.array([8, 6, 12])}, "ends of episodes fall"),
        ({"ends": np.array([6.0, 12.0])}, "no ends of episodes"),
        ({"ends": None}, "unknown key 'meta/episode_ends'"),
        ({"action": np.full((12, 4), "a")}, "<U1 is not a type of numbers"),
    ],
)
def test_what_contradicts_itself_is_named_with_both(changes, wanted, tmp_path):
    write_zarr(tmp_path / "x.zarr", buffer(**changes))
    data = rdp(tmp_path)
    with pytest.raises(DataError, match=wanted) as error:
        [dict(one.tracks) for one in data.recordings("train")]
    assert "\n" not in str(error.value)


def test_one_bad_file_and_an_empty_episode_are_counted_and_the_rest_is_read(tmp_path):
    write_zarr(tmp_path / "a.zarr", buffer())
    write_zarr(tmp_path / "b.zarr", buffer(ends=np.array([6, 6, 12])))
    write_zarr(tmp_path / "c.zarr", buffer(ends=np.array([6, 13])))
    data = rdp(tmp_path)
    found = [one.key for one in data.recordings("train")]
    assert [key.split("/")[0] for key in found] == ["a", "a", "b", "b"]
    assert len(data.skipped) == 2
    assert "b.zarr: episode 1 has no frames" in data.skipped[0]
    assert "c.zarr" in data.skipped[1]


@pytest.mark.parametrize(
    ("times", "wanted"),
    [
        (np.array([*np.arange(20) / 30, *np.arange(20) / 40 + 0.1]), "times do not rise at row 20"),
        (np.zeros(40), "times do not rise at row 1"),
        (np.where(np.arange(40) == 12, np.nan, np.arange(40.0)), "times do not rise at row 12"),
        ((1.7e9 + np.arange(40) / 30).astype("f4"), "float32 has no place for such times"),
        (np.full(40, "x"), "are not times"),
        (np.arange(39.0), r"not row 39"),
    ],
)
def test_times_that_fall_or_stand(times, wanted, tmp_path):
    path = open_x_tactile(tmp_path)
    shutil.rmtree(path / "data/timestamps")
    zarr.open_group(path)["data"].create_array("timestamps", data=times)
    data = Episodes(str(tmp_path), preset="open_x_tactile", fps=30, val=0)
    with contextlib.suppress(DataError):  # where no episode can be read
        list(data.recordings("train"))
    assert wanted.replace("\\", "") in " ".join(data.skipped)


def test_numbers_of_frames_need_a_rate(tmp_path):
    open_x_tactile(tmp_path)
    refused(tmp_path, r"counts frames .*data.fps=\.\.\. \(Hz\)", ConfigError, "open_x_tactile")
    htt(tmp_path / "htt")
    refused(tmp_path / "htt", r"has no times; give its rate: data.fps=", ConfigError, "htt")


def test_fractions_out_of_range_are_named_when_they_are_read(tmp_path):
    frames = pictures(12, 32, 24, 3) / np.float32(255)
    arrays = buffer(left_gripper1_img=None, left_tactile_camera_taxim=frames * 3)
    write_zarr(tmp_path / "x.zarr", arrays | {"data/state": np.zeros((12, 7))})
    (one, _) = Episodes(str(tmp_path), preset="manifeel", val=0).recordings("train")
    with pytest.raises(
        DataError, match=r"values from 0\.\d+ to [12]\.\d+, where 0 to 1 is expected"
    ):
        one.frames.read([0])


def test_a_cut_block_of_blosc_in_a_shard_is_named(tmp_path):
    frames = pictures(40, 24, 32, 3)
    root = zarr.open_group(tmp_path / "x.zarr", mode="w", zarr_format=3)
    options = {"chunks": (5, 24, 32, 3), "shards": (20, 24, 32, 3)}
    options["compressors"] = zarr.codecs.BloscCodec(cname="lz4")
    made = root.create_array("data/left_gripper1_img", shape=frames.shape, dtype="u1", **options)
    made[:] = frames
    root.create_array("data/action", data=np.ones((40, 4), "f4"))
    root.create_array("meta/episode_ends", data=np.array([40]))
    shard = next((tmp_path / "x.zarr/data/left_gripper1_img/c").rglob("0/0/0/0"))
    raw = bytearray(shard.read_bytes())
    raw[12:16] = (1 << 20).to_bytes(4, "little")  # length of the first block
    shard.write_bytes(raw)
    (one,) = rdp(tmp_path).recordings("train")
    np.testing.assert_array_equal(one.frames.read([39]), frames[[39]])
    with pytest.raises(DataError, match="bytes, where 1048576 are said"):
        one.frames.read([1])


@pytest.mark.parametrize("damage", ["cut", "noise"])
def test_damaged_chunks_are_named_and_the_others_read(damage, tmp_path):
    path = write_zarr(tmp_path / "x.zarr", buffer(), chunk=4)
    chunk = path / "data/left_gripper1_img/1.0.0.0"
    raw = chunk.read_bytes()
    chunk.write_bytes(raw[: len(raw) // 2] if damage == "cut" else raw[::-1])
    first, second = rdp(tmp_path).recordings("train")
    wanted = r"1\.0\.0\.0: \d+ bytes, where" if damage == "cut" else "9232 bytes, where"
    with pytest.raises(DataError, match=f"x.zarr, .*{wanted}"):
        first.frames.read([4])
    np.testing.assert_array_equal(second.frames.read([5]), pictures(12, 24, 32, 3)[[11]])


def test_damaged_metadata_is_named(tmp_path):
    path = write_zarr(tmp_path / "x.zarr", buffer())
    for content, wanted in {
        "{": "is not JSON",
        "[]": "holds no names and values",
        json.dumps({"shape": [12], "chunks": "x", "zarr_format": 2}): "cannot be read",
    }.items():
        (path / "data/left_gripper1_img/.zarray").write_text(content)
        refused(tmp_path, wanted)
    about = json.loads((path / "data/action/.zarray").read_text())
    about |= {"shape": [1 << 40, 1 << 40], "chunks": [1 << 40, 1 << 40]}
    (path / "data/left_gripper1_img/.zarray").write_text(json.dumps(about))
    refused(tmp_path, "in chunks of")


def test_codecs_that_run_code_are_refused_by_name(tmp_path):
    path = write_zarr(tmp_path / "x.zarr", buffer())
    array = path / "data/action"
    about = json.loads((array / ".zarray").read_text())
    about |= {"dtype": "|O", "filters": [{"id": "pickle", "protocol": 5}], "fill_value": None}
    about["compressor"] = None
    (array / ".zarray").write_text(json.dumps(about))
    bomb = np.array([Bomb(tmp_path / "exploded")] * 48, object)
    (array / "0.0").write_bytes(Pickle().encode(bomb))
    refused(tmp_path, "its codec 'pickle' holds Python objects and can run code, so it is not read")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("about", "wanted"),
    [
        ({"compressor": {"id": "pickle"}}, "can run code"),
        ({"filters": [{"id": "categorize"}]}, "can run code"),
        ({"compressor": {"id": "zsdt"}}, "unknown codec 'zsdt'; did you mean 'zstd'"),
        ({"codecs": [{"name": "numcodecs.pickle"}]}, "can run code"),
        (
            {
                "codecs": [
                    {"name": "sharding_indexed", "configuration": {"codecs": [{"name": "pickle"}]}}
                ]
            },
            "can run code",
        ),
        ({"compressor": 3}, "unknown codec '3'"),
    ],
)
def test_codecs_are_checked_by_their_names(about, wanted):
    with pytest.raises(DataError, match=wanted):
        codecs.check_codecs("x.zarr, a", about)
    codecs.check_codecs("x.zarr, a", {"compressor": {"id": "blosc"}, "filters": None})


def test_jpeg_xl_names_the_package_of_its_codec(tmp_path, monkeypatch):
    path = write_zarr(tmp_path / "x.zarr", buffer())
    file = path / "data/left_gripper1_img/.zarray"
    about = json.loads(file.read_text()) | {"compressor": {"id": "imagecodecs_jpegxl"}}
    file.write_text(json.dumps(about))
    monkeypatch.setattr(codecs, "find_spec", lambda name: None)
    refused(tmp_path, "'imagecodecs_jpegxl'; install its codec: pip install imagecodecs")


def test_jpeg_xl_is_registered_where_it_is_installed(tmp_path, monkeypatch):
    calls = []

    class Module:
        @staticmethod
        def register_codecs(verbose):
            calls.append(verbose)

    monkeypatch.setattr(codecs, "find_spec", lambda name: True)
    monkeypatch.setattr(codecs, "import_module", lambda name: Module)
    codecs.check_codecs("x", {"compressor": {"id": "imagecodecs_jpegxl"}})
    assert calls == [False]


def test_npz_with_a_pickle_is_refused(tmp_path):
    htt(tmp_path)
    path = tmp_path / "force/gsmini/processed/p1_sphere/a.npz"
    content = dict(np.load(path))
    content["6d_force"] = np.array([Bomb(tmp_path / "exploded")] * 6, object)
    np.savez(path, **content)
    data = Episodes(str(tmp_path), preset="htt", fps=25, val=0)
    assert [one.key for one in data.recordings("train")] == [
        "slip/gsmini/processed/p1_sphere/a/gsmini"
    ]
    assert "6d_force: holds Python objects as a pickle, which can run code" in data.skipped[0]
    assert not (tmp_path / "exploded").exists()
    assert pickle.dumps(data)


def test_links_of_hdf5_to_other_files_are_not_followed(tmp_path):
    path = univtac(tmp_path)
    other = write_hdf5(tmp_path / "secret/x.h5", {"joint": np.ones((6, 9))})
    with h5py.File(path, "r+") as file:
        del file["embodiment/joint"]
        file["embodiment/joint"] = h5py.ExternalLink(str(other), "joint")
    other_raw = tmp_path / "secret/raw"
    other_raw.write_bytes(struct.pack("54d", *range(54)))
    refused(tmp_path / "insert_hole", "unknown key 'embodiment/joint'", preset="univtac")
    with h5py.File(path, "r+") as file:
        del file["embodiment/joint"]
        file.create_dataset(
            "embodiment/joint", (6, 9), "f8", external=[(str(other_raw), 0, 54 * 8)]
        )
    refused(tmp_path / "insert_hole", "its values lie in another file", preset="univtac")


def test_hdf5_with_a_filter_that_is_not_installed(tmp_path, monkeypatch):
    path = univtac(tmp_path)
    with h5py.File(path, "r+") as file:
        del file["embodiment/joint"]
        file.create_dataset("embodiment/joint", data=np.ones((6, 9)), compression="gzip")
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda number: False)
    monkeypatch.setattr("tactileforge_episodes.hdf.find_spec", lambda name: None)
    refused(
        tmp_path,
        r"its filter 'deflate' \(number 1\) is not installed: pip install hdf5plugin",
        preset="univtac",
    )


def test_damaged_files_are_named(tmp_path):
    path = univtac(tmp_path)
    path.write_bytes(path.read_bytes()[:3000])
    refused(tmp_path, "not a readable HDF5 file|damaged|cannot be read", preset="univtac")
    for name in ("a.zarr.zip", "b.tar"):
        (tmp_path / name).write_bytes(b"nothing of the kind" * 100)
    path.unlink()
    data = refused(tmp_path, "no file that ends like.*not a readable zip", DataNotFoundError)
    assert len(data.skipped) == 2


def test_an_image_that_cannot_be_decoded_is_named(tmp_path):
    path = univtac(tmp_path)
    with h5py.File(path, "r+") as file:
        raw = file["tactile/left_tactile/rgb"]
        raw[3] = raw[3][:40]
    one = next(iter(Episodes(str(tmp_path), preset="univtac", val=0).recordings("train")))
    one.frames.read([2])
    with pytest.raises(
        DataError, match=r"0.hdf5, tactile/left_tactile/rgb, frame 3: not a readable"
    ):
        one.frames.read([3])


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({"preset": "htt", "map": "x.yaml"}, "data.map=FILE.yaml, not both"),
        ({"preset": "htt", "val": 1.0}, "val is 1.0; give the share that is held out"),
        ({"preset": "htt", "fps": 0}, "give values above 0"),
        ({"preset": "htt", "span": -1.0}, "give values above 0"),
    ],
)
def test_options_that_make_no_sense(options, wanted, tmp_path):
    with pytest.raises(ConfigError, match=wanted):
        Episodes(str(tmp_path), **options)


def test_names_that_are_not_known(tmp_path):
    refused(
        tmp_path, "unknown data.preset 'univtak'; did you mean 'univtac'", ConfigError, "univtak"
    )
    univtac(tmp_path)
    refused(
        tmp_path,
        "unknown data.large 'deph'; did you mean 'depth'",
        ConfigError,
        "univtac",
        large=["deph"],
    )
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        next(Episodes(str(tmp_path), preset="univtac").recordings("test"))


def test_columns_and_channels_that_are_not_there(tmp_path):
    touch_in_the_wild(tmp_path)
    path = tmp_path / "cup.zarr/data/camera0_tactile"
    shutil.rmtree(path)
    zarr.open_group(tmp_path / "cup.zarr")["data"].create_array(
        "camera0_tactile", data=np.zeros((12, 12, 40), "f4")
    )
    refused(
        tmp_path,
        r"\(12, 12, 40\) has no columns 32 to 63 \(part 'right'\)",
        preset="touch_in_the_wild",
        span=1.0,
    )


def test_no_package_is_imported_before_it_is_used():
    code = (
        "import sys; from tactileforge_episodes.dataset import Episodes; "
        "Episodes('x', preset='htt').keys; sys.exit(bool({'zarr', 'h5py'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.parametrize(
    ("package", "preset"), [("zarr", "reactive_diffusion"), ("h5py", "univtac")]
)
def test_a_package_that_is_absent_is_named(package, preset, tmp_path, monkeypatch):
    {"zarr": reactive_diffusion, "h5py": univtac}[package](tmp_path)
    monkeypatch.setitem(sys.modules, package, None)
    refused(tmp_path, f"pip install {package}", ConfigError, preset=preset)


def test_a_zip_that_is_encrypted_is_named(tmp_path):
    path = tmp_path / "a.zarr.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(".zgroup", "{}")
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"PK\1\2") + 8] |= 1  # the flag of encryption
    path.write_bytes(raw)
    refused(tmp_path, "no file that ends like.*is encrypted; unpack it", DataNotFoundError)


def test_npz_with_a_header_that_is_no_literal(tmp_path):
    htt(tmp_path)
    path = tmp_path / "force/gsmini/processed/p1_sphere/a.npz"
    content = dict(np.load(path))
    del content["6d_force"]
    np.savez(path, **content)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("6d_force.npy", b"\x93NUMPY\x01\0\x20\0" + b"(" * 32)
    data = Episodes(str(tmp_path), preset="htt", fps=25, val=0)
    assert len(list(data.recordings("train"))) == 1
    assert "EOF in multi-line statement" in data.skipped[0]
