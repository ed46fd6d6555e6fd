"""Every preset on a small file made after the description of its format: every field."""

import pickle

import cv2
import h5py
import numpy as np
import pytest
import zarr
from made_episodes import (
    FORMATS,
    freetacman,
    htt,
    jpegs,
    omnisharing,
    open_x_tactile,
    pictures,
    touch_in_the_wild,
    univtac,
    write_hdf5,
)
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.map_files import preset_names, read_preset

from tactileforge.errors import DataError
from tactileforge.plugin import TaxelLayout
from tactileforge.testing import check


def read(root, preset, **options):
    data = Episodes(str(root), preset=preset, val=0, **options)
    recordings = {one.key: one for one in data.recordings("train")}
    assert data.skipped == []
    return recordings


def made(root, preset, **options):
    make, given = FORMATS[preset]
    make(root)
    return read(root, preset, **{**given, **options})


def colours(frames):
    return np.round(frames.mean((0, 1, 2)), -1).tolist()


#: Mean of red, green and blue of `pictures`, to tens.
RGB = [170.0, 70.0, 70.0]


def test_every_preset_has_a_made_file():
    assert preset_names() == sorted(FORMATS)


@pytest.mark.parametrize("preset", FORMATS)
def test_a_preset_reads_its_format_and_conforms(preset, tmp_path):
    make, options = FORMATS[preset]
    make(tmp_path)
    results = check("dataset", Episodes, root=str(tmp_path), preset=preset, val=0, **options)
    wrong = [one for one in results if one.status == "failed"]
    assert not wrong, wrong
    one = next(iter(read(tmp_path, preset, **options).values()))
    there = pickle.loads(pickle.dumps(one))
    np.testing.assert_array_equal(there.frames.read([1, 0]), one.frames.read([1, 0]))
    assert {"episode", "finger"} <= set(one.labels)
    if preset not in ("touch_in_the_wild", "omnisharing"):
        assert colours(one.frames.read(range(len(one.frames)))) == RGB


@pytest.mark.parametrize("preset", [name for name in FORMATS if read_preset(name).signature])
def test_a_format_is_recognised_and_its_doubts_are_said(preset, tmp_path):
    make, options = FORMATS[preset]
    make(tmp_path)
    guess = Episodes.recognise(tmp_path)
    assert guess.options == {"root": str(tmp_path), "preset": preset}
    assert guess.format == read_preset(preset).about
    assert 0.5 < guess.score < 1
    said = " ".join(guess.doubts)
    assert ("data.fps" in said) == ("fps" in options)
    assert ("data.span" in said) == ("span" in options)


def test_other_files_are_not_recognised(tmp_path):
    assert Episodes.recognise(tmp_path) is None
    (tmp_path / "x.hdf5").write_bytes(b"no such file")
    with pytest.raises(DataError, match="not a readable HDF5 file"):
        Episodes.recognise(tmp_path)
    write_hdf5(tmp_path / "x.hdf5", {"a/b": np.zeros((4, 3))})
    with pytest.raises(DataError, match=r"no array of pictures or touch\. It has a/b float64"):
        Episodes.recognise(tmp_path)
    images = {
        "observations/images/front": pictures(3, 8, 8, 3),
        "observations/qpos": np.ones((3, 2)),
    }
    write_hdf5(tmp_path / "x.hdf5", {**images, "action": np.ones((3, 2))})
    with pytest.raises(DataError, match="no array is called touch"):  # ALOHA
        Episodes.recognise(tmp_path)


def test_open_x_tactile(tmp_path):
    found = made(tmp_path, "open_x_tactile", fps=10)
    assert len(found) == 6
    one = found["toy/000001/right_gripper_1"]
    assert one.sensor == "gelsight_mini"
    np.testing.assert_allclose(one.times, np.arange(15) / 10)
    np.testing.assert_array_equal(one.frames.read([0, 14]), pictures(40, 2, 32, 32, 3)[[10, 24], 1])
    np.testing.assert_array_equal(one.image.read([3]), pictures(40, 32, 32, 3, seed=2)[[13]])
    np.testing.assert_array_equal(one.image_times, one.times)
    assert one.text == "press the cup"
    assert one.labels == {
        "episode": "toy_000001",
        "finger": "right_gripper_1",
        "task": "toy",
        "area": 1.0,
        "type": "image",
        "device": "GelSightMini",
    }
    data = zarr.open_group(tmp_path / "toy.zarr", mode="r")["data"]
    force = data["right_tactile_data_force"][10:25, 1]
    np.testing.assert_allclose(one.force, force * [1, 1, -1], rtol=1e-6)  # pressing is positive
    assert one.tier == 1
    names = ("right_arm_joints", "right_hand_joints", "right_wrist_pose")
    state = np.concatenate([data[name][10:25] for name in names], 1)
    np.testing.assert_array_equal(one.tracks["state"], state)
    np.testing.assert_array_equal(one.tracks["robot_action"], [*state[1:], state[-1]])
    assert (one.tracks["right_hand_slots"] == 28).all()
    first = found["toy/000000/right_gripper_0"].tracks["state"]
    assert np.isnan(first[3, 2])  # 1e30 is not a value
    assert np.isfinite(np.delete(first.ravel(), 3 * 14 + 2)).all()


def test_open_x_tactile_with_times_in_seconds_needs_no_rate(tmp_path):
    open_x_tactile(tmp_path, seconds=True)
    one = read(tmp_path, "open_x_tactile")["toy/000002/right_gripper_0"]
    np.testing.assert_allclose(one.times, np.arange(15) / 30)


def test_open_x_tactile_draws_a_matrix_and_its_vectors_are_tracks(tmp_path):
    open_x_tactile(tmp_path, matrix=True)
    options = {"fps": 10, "span": 4.0, "licence": "CC0-1.0"}
    one = read(tmp_path, "open_x_tactile", **options)["toy/000000/right_skin_4"]
    assert (one.sensor, one.frames.shape, one.licence) == ("serial_array", (4, 6), "CC0-1.0")
    raw = zarr.open_group(tmp_path / "toy.zarr", mode="r")["data/right_tactile_data_skin"][:10, 4]
    np.testing.assert_allclose(one.tracks["taxels"], raw.reshape(10, 24, 1), rtol=1e-6)
    drawn = TaxelLayout((4, 6), channels=[0], span=4.0).draw(
        raw[7].reshape(24, 1), np.zeros((24, 1))
    )
    np.testing.assert_array_equal(one.frames.read([7])[0], drawn)
    assert one.force.shape == (10, 3)
    assert "right_skin_4" in one.key


def test_open_x_tactile_draws_vectors_where_asked(tmp_path):
    open_x_tactile(tmp_path)
    found = read(tmp_path, "open_x_tactile", fps=10, span=4.0, draw="all")
    drawn = found["toy/000000/right_force_0"]
    assert drawn.frames.shape == (2, 2)  # three numbers, in the order of the file
    assert len(found) == 12


@pytest.mark.parametrize(
    "pads", [("left_tactile", "right_tactile"), ("left_gsmini", "right_gsmini")]
)
def test_univtac(pads, tmp_path):
    univtac(tmp_path, *pads)
    found = read(tmp_path, "univtac", large=["depth"])
    one = found[f"insert_hole/clean/0/{pads[0]}"]
    assert len(found) == 2
    assert one.sensor == "gelsight_mini"
    # red and blue are exchanged in the file, and put right
    decoded = one.frames.read([2])[0].astype(int)
    assert np.abs(decoded - pictures(6, 24, 32, 3, seed=4)[2]).mean() < 12
    assert colours(one.image.read(range(6))) == RGB
    np.testing.assert_allclose(one.times, np.arange(6) / 30)
    with h5py.File(tmp_path / "insert_hole/clean/0.hdf5") as file:
        tactile = f"tactile/{pads[0]}"
        wanted = {
            "state": file["embodiment/joint"][:],
            "ee": file["embodiment/ee"][:],
            "step": np.arange(6) * 5,
            "atom": file["atom/id"][:],
            "actor_plug": file["actor/plug"][:],
            "marker": file[f"{tactile}/marker"][:],
            "pad_pose": file[f"{tactile}/pose"][:],
            "depth": file[f"{tactile}/depth"][:],
        }
    for name, values in wanted.items():
        np.testing.assert_array_equal(one.tracks[name], values, err_msg=name)
    np.testing.assert_array_equal(one.tracks["robot_action"][:-1], wanted["state"][1:])
    assert one.labels["task"] == "insert_hole"
    assert "depth" not in read(tmp_path, "univtac")[one.key].tracks  # large: only where asked


def test_univtac_takes_the_command_of_newer_files_and_pictures_with_markers(tmp_path):
    path = univtac(tmp_path)
    with h5py.File(path, "r+") as file:
        file["embodiment/command"] = np.arange(48, dtype="f4").reshape(6, 8)
        file["control/phase"] = np.arange(6) % 4
        file["atom/tag"] = np.array([b"reach"] * 6)
        for pad in ("left", "right"):
            del file[f"tactile/{pad}_tactile/rgb"]
    one = read(tmp_path, "univtac")["insert_hole/clean/0/left_tactile"]
    np.testing.assert_array_equal(one.tracks["robot_action"][1], np.arange(8, 16))
    assert one.tracks["phase"].tolist() == [0, 1, 2, 3, 0, 1]
    assert one.labels["atom"] == "reach"
    decoded = one.frames.read([2])[0].astype(int)
    assert np.abs(decoded - pictures(6, 24, 32, 3, seed=5)[2]).mean() < 12


@pytest.mark.parametrize(
    ("path", "task"),
    [
        ("OpenViTac/wipe/hdf5/episode_000123.hdf5", "wipe"),
        ("data/wipe/plain/hdf5/3.hdf5", "wipe"),
        ("wipe/demo/hdf5/3.hdf5", "wipe"),
    ],
)
def test_univtac_in_its_other_folders(path, task, tmp_path):
    (tmp_path / path).parent.mkdir(parents=True)
    univtac(tmp_path).rename(tmp_path / path)
    found = read(tmp_path, "univtac")
    assert {one.labels["task"] for one in found.values()} == {task}


def test_reactive_diffusion(tmp_path):
    found = made(tmp_path, "reactive_diffusion")
    one = found["peel_zarr/replay_buffer/000001/left_gripper1"]
    assert (one.sensor, one.labels["task"], one.licence) == ("gelsight_mini", "peel", "MIT")
    assert found["peel_zarr/replay_buffer/000001/left_gripper2"].sensor == "digit"
    np.testing.assert_allclose(one.times, np.arange(6) / 24)
    np.testing.assert_array_equal(one.frames.read([0]), pictures(12, 24, 32, 3)[[6]])
    np.testing.assert_array_equal(one.image.read([5]), pictures(12, 24, 32, 3, seed=2)[[11]])
    assert one.force is None  # of the flange
    data = zarr.open_group(tmp_path / "peel_zarr/replay_buffer.zarr", mode="r")["data"]
    for name, key in {
        "wrench": "left_robot_tcp_wrench",
        "robot_action": "action",
        "left_tcp_velocity": "left_robot_tcp_vel",
        "marker_offset": "left_gripper1_marker_offset",
        "initial_marker": "left_gripper1_initial_marker",
    }.items():
        np.testing.assert_array_equal(one.tracks[name], data[key][6:], err_msg=name)
    state = np.hstack([data["left_robot_tcp_pose"][6:], data["left_robot_gripper_width"][6:]])
    np.testing.assert_array_equal(one.tracks["state"], state)


def test_a_sensor_of_an_unknown_type_is_left_out_and_named(tmp_path):
    FORMATS["reactive_diffusion"][0](tmp_path)
    data = Episodes(str(tmp_path), preset="reactive_diffusion", val=0)
    assert [one.labels["finger"] for one in data.recordings("train")] == ["left_gripper1"] * 2
    assert len(data.skipped) == 1
    assert "left_gripper2: its sensor 'mctac' is not a known type" in data.skipped[0]
    assert "'data.sensors={mctac: NAME}'" in data.skipped[0]


def test_vitamin_b(tmp_path):
    found = made(tmp_path, "vitamin_b")
    assert len(found) == 8
    one = found["pour/000001/hand1_right"]
    assert one.tracks["state"].shape == (6, 14)
    assert one.tracks["points"].shape == (6, 16, 3)
    assert one.tracks["start_pose_1"].shape == (6, 7)
    np.testing.assert_array_equal(one.frames.read([1]), pictures(12, 24, 24, 3, seed=3)[[7]])
    np.testing.assert_array_equal(one.image.read([1]), pictures(12, 24, 24, 3, seed=0)[[7]])
    np.testing.assert_allclose(one.times[1], 1 / 30)


def test_touch_in_the_wild(tmp_path):
    found = made(tmp_path, "touch_in_the_wild")
    raw = zarr.open_group(tmp_path / "cup.zarr", mode="r")["data/camera0_tactile"][6:]
    for part, columns in {"left": slice(0, 32), "right": slice(32, 64)}.items():
        one = found[f"cup/000001/hand0_{part}"]
        assert (one.frames.shape, one.sensor) == ((12, 32), "serial_array")
        flat = raw[:, :, columns].reshape(6, 384, 1)
        np.testing.assert_array_equal(one.tracks["taxels"], flat)
        blue = np.rint(128 + 127 * flat[2, :, 0].astype(float)).clip(1, 255).reshape(12, 32)
        np.testing.assert_array_equal(one.frames.read([2])[0, ..., 2], blue)
        assert one.no_contact is None
    np.testing.assert_allclose(one.times[5], 5 / 60)


def test_touch_in_the_wild_asks_for_the_span(tmp_path):
    touch_in_the_wild(tmp_path)
    data = Episodes(str(tmp_path), preset="touch_in_the_wild", val=0)
    with pytest.raises(Exception, match=r"give the value of full colour: data.span=.*up to 0\.9"):
        list(data.recordings("train"))


def test_manifeel(tmp_path):
    found = made(tmp_path, "manifeel")
    one = found["usb_quan_Aug05/000001/right"]
    assert (one.sensor, one.frames.shape) == ("gelsight", (32, 24))
    np.testing.assert_array_equal(one.frames.read([0]), pictures(12, 32, 24, 3, seed=1)[[6]])
    np.testing.assert_array_equal(one.image.read([0]), pictures(12, 24, 24, 3)[[6]])
    assert one.tracks["force_field"].shape == (6, 10, 14, 3)
    assert one.tracks["depth"].shape == (6, 10, 14)
    assert (one.tracks["state"].shape, one.tracks["robot_action"].shape) == ((6, 7), (6, 6))
    assert one.force is None
    np.testing.assert_allclose(one.times[1], 0.1)


def test_freetacman(tmp_path):
    one = made(tmp_path, "freetacman")["DensePacking/episode_0/tactile"]
    np.testing.assert_array_equal(one.frames.read([4]), pictures(6, 24, 32, 3)[[4]])
    assert one.tracks["end_pose"].shape == (6, 7)
    np.testing.assert_array_equal(one.tracks["state"], one.tracks["robot_action"])
    assert (one.labels["task"], one.labels["sim"], one.labels["compress"]) == ("DensePacking", 0, 0)


def test_freetacman_with_two_pads_and_the_order_of_the_channels_given(tmp_path):
    path = freetacman(tmp_path)
    with h5py.File(path, "r+") as file:
        for side in ("left", "right"):
            file[f"observations/images/tactile_{side}"] = pictures(6, 24, 32, 3)
        del file["observations/images/tactile"]
    found = read(tmp_path, "freetacman", sensors={"any": "digit"}, channels="rgb")
    assert sorted(one.labels["finger"] for one in found.values()) == [
        "tactile_left",
        "tactile_right",
    ]
    one = found["DensePacking/episode_0/tactile_left"]
    np.testing.assert_array_equal(one.frames.read([4]), pictures(6, 24, 32, 3)[[4]])


def test_aloha(tmp_path):
    one = made(tmp_path, "aloha")["plug/episode_0/left_tactile"]
    raw = cv2.imdecode(np.frombuffer(jpegs(pictures(6, 24, 32, 3))[3], np.uint8), 1)[..., ::-1]
    assert np.abs(one.frames.read([3])[0].astype(int) - raw).max() <= 2  # two decoders of JPEG
    assert colours(one.image.read([0])) == RGB
    assert one.tracks["velocity"].shape == (6, 14)
    np.testing.assert_allclose(one.times[1], 1 / 50)


def test_vtouch(tmp_path):
    found = made(tmp_path, "vtouch")
    one = found["episode_7/left_right"]
    np.testing.assert_allclose(one.times[1], 1 / 20)  # from the text in the file
    assert one.tracks["arm_effort"].shape == (5, 7)
    assert not np.array_equal(one.tracks["state"], one.tracks["robot_action"])
    np.testing.assert_array_equal(one.image.read([0]), pictures(5, 24, 32, 3, seed=2)[[0]])


def test_vtouch_with_encoded_pictures_and_no_rate(tmp_path):
    FORMATS["vtouch"][0](tmp_path)
    with h5py.File(tmp_path / "episode_7.hdf5", "r+") as file:
        del file["metadata.json"]
        del file["tactile/hand_left/left/data"]
        kind = h5py.vlen_dtype(np.uint8)
        made_set = file.create_dataset("tactile/hand_left/left/data", (5,), dtype=kind)
        for i, one in enumerate(jpegs(pictures(5, 24, 32, 3))):
            made_set[i] = np.frombuffer(one, np.uint8)
    one = read(tmp_path, "vtouch", sensors={"any": "digit"})["episode_7/left_left"]
    assert colours(one.frames.read(range(5))) == RGB
    np.testing.assert_allclose(one.times[1], 1 / 30)


@pytest.mark.parametrize("top", ["dataset/", ""])
def test_omnisharing(top, tmp_path):
    omnisharing(tmp_path, top)
    found = read(tmp_path, "omnisharing", span=2.0)
    one = found["episode_3_0101_12_4_glove/lefthand_palm_sensor1"]
    tip = found["episode_3_0101_12_4_glove/lefthand_M6L"]
    with h5py.File(tmp_path / "episode_3_0101_12_4_glove.hdf5") as file:
        raw = file[f"{top}observation/lefthand/tactile/data"][:]
    np.testing.assert_array_equal(one.tracks["taxels"], raw[:, :6].reshape(5, 2, 3))
    np.testing.assert_array_equal(tip.tracks["taxels"], raw[:, 6:].reshape(5, 1, 3))
    np.testing.assert_allclose(one.times, np.arange(5) * 0.033)  # microseconds
    assert (one.text, one.object, one.labels["data_id"]) == ("lift the can", "can", "id7")
    assert one.tracks["state"].shape == one.tracks["robot_action"].shape == (5, 36)
    assert one.tracks["object_1"].shape == (5, 17)
    shown = one.frames.read([0])[0, 0]
    np.testing.assert_array_equal(
        shown, np.rint(128 + 127 * raw[0, :6].reshape(2, 3) / 2).clip(1, 255)
    )


def test_htt(tmp_path):
    found = made(tmp_path, "htt")
    slide = found["slip/gsmini/processed/p1_sphere/a/gsmini"]
    press = found["force/gsmini/processed/p1_sphere/a/gsmini"]
    assert slide.tracks["slip_stage"].tolist() == [0, 0, 1, 1, 2, 2]
    assert slide.tracks["slip_labels"].tolist() == [0, 0, 0, 1, 2, 2]
    assert slide.tracks["slip_signature"].tolist() == [0, 1, 1, 1, 2, 2]
    np.testing.assert_allclose(slide.tracks["friction"], np.linspace(0, 1, 6), rtol=1e-6)
    np.testing.assert_allclose(slide.tracks["normal_force"], np.linspace(1, 2, 6), rtol=1e-6)
    raw = np.load(tmp_path / "slip/gsmini/processed/p1_sphere/a.npz")
    np.testing.assert_array_equal(slide.tracks["wrench"], raw["6d_force"])
    np.testing.assert_allclose(slide.force, raw["6d_force"][:, :3] * [1, 1, -1])
    np.testing.assert_array_equal(slide.frames.read([5]), raw["tactile_img"][[5]])
    assert (slide.background() == 100).all()
    assert (slide.object, slide.labels["mode"], slide.labels["probe"]) == (
        "p1_sphere",
        "sliding",
        1,
    )
    assert [slide.labels[f"ref_force_{i}"] for i in range(6)] == list(range(6))
    assert slide.labels["n0"] == 3
    assert "slip_stage" not in press.tracks
    assert press.labels["mode"] == "static"


def test_files_of_htt_with_one_name_are_held_out_together(tmp_path):
    htt(tmp_path)
    for val in (0.0, 0.2, 0.5, 0.9):
        data = Episodes(str(tmp_path), preset="htt", fps=25, val=val)
        assert [len(list(data.recordings(split))) for split in ("train", "val")] in ([2, 0], [0, 2])


def test_robomimic_has_every_sensor_of_each_demonstration(tmp_path):
    found = made(tmp_path, "robomimic")
    sides = ("tactile_left", "right_tactile_image")
    assert {*found} == {f"demo/demo_{i}/{side}" for i in (0, 1) for side in sides}
    one = found["demo/demo_1/right_tactile_image"]
    np.testing.assert_array_equal(one.frames.read(range(6)), pictures(6, 24, 32, 3, seed=5))
    np.testing.assert_allclose(one.times, np.arange(6) / 20)
