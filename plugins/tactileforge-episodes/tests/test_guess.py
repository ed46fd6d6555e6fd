"""Arrays with a lab's own names: no key is typed, and values are those of the writer to the bit."""

import html
import json
import re
import shlex

import cv2
import h5py
import numpy as np
import pytest
import zarr
from made_episodes import jpegs, pictures, write_hdf5, write_zarr, zipped
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.packages import need

from tactileforge import cli
from tactileforge.datasets import recognise
from tactileforge.errors import ConfigError, DataError, DataNotFoundError

ENDS = (12, 30)


def write_npz(path, arrays):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)


WRITERS = {
    "zarr2": lambda root, arrays: write_zarr(root / "lab.zarr", arrays),
    "zarr3": lambda root, arrays: write_zarr(root / "lab.zarr", arrays, version=3),
    "hdf5": lambda root, arrays: write_hdf5(root / "lab.hdf5", arrays),
    "npz": lambda root, arrays: write_npz(root / "lab.npz", arrays),
}


def buffer(seed=0):
    """Replay buffer of two episodes, two sensors, each with its force, and a camera."""
    rng = np.random.default_rng(seed)
    return {
        "meta/episode_ends": np.array(ENDS),
        "data/tactile_left": pictures(30, 24, 32, 3, seed=1),
        "data/tactile_right": pictures(30, 24, 32, 3, seed=2),
        "data/wrist_rgb": pictures(30, 16, 16, 3, seed=3),
        "data/force_left": rng.normal(0, 1, (30, 3)).astype("f4"),
        "data/force_right": rng.normal(0, 1, (30, 3)).astype("f4"),
        "data/state": rng.normal(0, 1, (30, 7)).astype("f4"),
        "data/action": rng.normal(0, 1, (30, 7)).astype("f4"),
        "data/temperature": rng.normal(0, 1, 30).astype("f4"),
        "data/timestamp": np.concatenate([np.arange(12), np.arange(18)]) / 25,
    }


def read(root, split="train", **options):
    data = Episodes(str(root), **{"val": 0, **options})
    found = {one.key: one for one in data.recordings(split)}
    assert data.skipped == []
    return found, data.notes


def pixels(one):
    return one.frames.read(range(len(one.frames)))


@pytest.mark.parametrize("writer", WRITERS)
def test_a_replay_buffer_with_names_of_its_own(writer, tmp_path):
    arrays = buffer()
    WRITERS[writer](tmp_path, arrays)
    found, notes = read(tmp_path)
    sides = ("left", "right")
    assert [*found] == [f"lab/00000{i}/tactile_{side}" for i in (0, 1) for side in sides]
    for i, rows in enumerate((slice(0, 12), slice(12, 30))):
        for side in sides:
            one = found[f"lab/00000{i}/tactile_{side}"]
            np.testing.assert_array_equal(pixels(one), arrays[f"data/tactile_{side}"][rows])
            np.testing.assert_array_equal(one.force, arrays[f"data/force_{side}"][rows])
            np.testing.assert_array_equal(one.times, arrays["data/timestamp"][rows])
            np.testing.assert_array_equal(one.tracks["state"], arrays["data/state"][rows])
            np.testing.assert_array_equal(one.tracks["robot_action"], arrays["data/action"][rows])
            heat = arrays["data/temperature"][rows]
            np.testing.assert_array_equal(one.tracks["temperature"], heat)
            view = one.image.read(range(len(one.frames)))
            np.testing.assert_array_equal(view, arrays["data/wrist_rgb"][rows])
    said = "\n".join(notes)
    for word in (
        "sensor: no name",
        "times: data/timestamp in s",
        "force: data/force_left is taken",
    ):
        assert said.count(word) >= 1, word
    assert "camera: data/wrist_rgb" in said


def test_streams_of_one_take_are_held_out_together(tmp_path):
    arrays = buffer() | {"meta/episode_ends": np.arange(3, 31, 3)}
    arrays["data/timestamp"] = np.tile(np.arange(3) / 25, 10)
    WRITERS["zarr2"](tmp_path, arrays)
    train, _ = read(tmp_path, val=0.5)
    held, _ = read(tmp_path, "val", val=0.5)
    assert len(train) + len(held) == 20
    takes = [{key.rpartition("/")[0] for key in found} for found in (train, held)]
    assert all(takes)
    assert not takes[0] & takes[1]


@pytest.mark.parametrize(
    ("unit", "values", "seconds"),
    [
        ("s", np.arange(30) / 25, 1.0),
        ("ms", np.arange(30) * 40, 1e-3),
        ("ms", np.arange(30) * 40.0 + 17, 1e-3),
        ("us", np.arange(30) * 40_000, 1e-6),
        ("ns", np.arange(30) * 40_000_000, 1e-9),
        ("s", 1_700_000_000 + np.arange(30) / 25, 1.0),
        ("ms", 1_700_000_000_000 + np.arange(30) * 40, 1e-3),
        ("us", 1_700_000_000_000_000 + np.arange(30) * 40_000, 1e-6),
        ("ns", 1_700_000_000_000_000_000 + np.arange(30) * 40_000_000, 1e-9),
        (
            "ns",
            np.arange(17 * 10**17, 1_700_000_001_200_000_000, 40_000_000, "u8"),
            1e-9,
        ),
    ],
)
@pytest.mark.parametrize("name", ["timestamp", "t", "time", "stamps"])
def test_units_of_time(name, unit, values, seconds, tmp_path):
    arrays = {"gelsight": pictures(30, 24, 32, 3), name: values}
    write_npz(tmp_path / "a.npz", arrays)
    found, notes = read(tmp_path)
    (one,) = found.values()
    wanted = (values - values[0]).astype(np.float64) * seconds
    np.testing.assert_array_equal(one.times, wanted)
    assert f"times: {name} in {unit}" in "\n".join(notes)


def test_units_of_time_named_are_as_named(tmp_path):
    arrays = {"gelsight": pictures(30, 24, 32, 3), "time_ms": np.arange(30) * 2.0}
    write_npz(tmp_path / "a.npz", arrays)
    np.testing.assert_array_equal(
        next(iter(read(tmp_path)[0].values())).times, np.arange(30) * 2e-3
    )
    arrays["time_ms"] = 1_700_000_000 + np.arange(30) / 25
    write_npz(tmp_path / "a.npz", arrays)
    with pytest.raises(DataError, match="its name says ms, and its values are dates in s"):
        Episodes.recognise(tmp_path)


def test_times_that_do_not_rise_or_count_frames_leave_the_rate(tmp_path):
    flat = np.full(30, 1.7e9, "f4")
    for name, values, said in (
        ("timestamp", flat, "timestamp is left out, as its values do not rise"),
        ("timestamp", np.arange(30), "fps: 30 is assumed"),
    ):
        write_npz(tmp_path / "a.npz", {"gelsight": pictures(30, 24, 32, 3), name: values})
        found, notes = read(tmp_path)
        (one,) = found.values()
        np.testing.assert_array_equal(one.times, np.arange(30) / 30)
        assert said in "\n".join(notes)
        assert next(iter(read(tmp_path, fps=10)[0].values())).times[1] == 0.1


@pytest.mark.parametrize("name", ["meta/episode_ends", "episode_end_idx", "meta/trajectory_ends"])
def test_episode_ends_by_other_names(name, tmp_path):
    WRITERS["hdf5"](tmp_path, {name: np.array(ENDS), "tactile": pictures(30, 24, 32, 3)})
    assert [len(one.frames) for one in read(tmp_path)[0].values()] == [12, 18]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("meta/episode_lengths", np.array([12, 18])),
        ("meta/episode_starts", np.array([0, 12])),
        ("data/episode_index", np.repeat([3, 7], [12, 18])),
        ("data/episode_id", np.repeat([0, 1], [12, 18])[:, None]),
        ("traj_len", np.array([[12], [18]])),
    ],
)
def test_episodes_said_in_other_ways(name, values, tmp_path):
    shown = pictures(30, 24, 32, 3)
    WRITERS["zarr2"](tmp_path, {name: values, "data/tactile": shown})
    found = [*read(tmp_path)[0].values()]
    assert len(found) == 2
    np.testing.assert_array_equal(pixels(found[0]), shown[:12])
    np.testing.assert_array_equal(pixels(found[1]), shown[12:])


def robomimic(path, rows=(12, 9, 10), rate=None, masks=None, views=("agentview_image",), **attrs):
    """robomimic, LIBERO and MimicGen: one file, one group a demonstration."""
    rng = np.random.default_rng(5)
    written = {}
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(rows)
        args = {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": rate} if rate else {}}
        data.attrs["env_args"] = json.dumps(args)
        for name, value in attrs.items():
            data.attrs[name] = value
        for i, count in enumerate(rows):
            number = i + 8  # demo_10 comes after demo_9
            group = data.create_group(f"demo_{number}")
            group.attrs["num_samples"] = count
            one = {
                "actions": rng.normal(0, 1, (count, 7)),
                "dones": np.zeros(count, "i8"),
                "states": rng.normal(0, 1, (count, 45)),
                "obs/robot0_eef_pos": rng.normal(0, 1, (count, 3)),
                "obs/robot0_gripper_qpos": rng.normal(0, 1, (count, 2)),
                "obs/tactile_left_image": pictures(count, 24, 32, 3, seed=i),
                "obs/tactile_right_image": pictures(count, 24, 32, 3, seed=i + 9),
                "next_obs/tactile_left_image": pictures(count, 24, 32, 3, seed=i + 50),
                **{f"obs/{view}": pictures(count, 16, 16, 3, seed=i + 20) for view in views},
            }
            for key, values in one.items():
                group[key] = values
            written[f"demo_{number}"] = one
        for name, demos in (masks or {}).items():
            file[f"mask/{name}"] = np.array(demos, "S")
    return written


def test_robomimic(tmp_path):
    masks = {"train": ["demo_8", "demo_10"], "valid": ["demo_9"], "20_percent": ["demo_8"]}
    written = robomimic(tmp_path / "demo.hdf5", rate=25, masks=masks)
    train, notes = read(tmp_path)
    held, _ = read(tmp_path, "val")
    sides = ("left", "right")
    assert [*train] == [f"demo/demo_{i}/tactile_{s}_image" for i in (8, 10) for s in sides]
    assert [*held] == [f"demo/demo_9/tactile_{s}_image" for s in sides]
    for key, one in {**train, **held}.items():
        _, demo, finger = key.split("/")
        own = written[demo]
        np.testing.assert_array_equal(pixels(one), own[f"obs/{finger}"])
        np.testing.assert_array_equal(one.times, np.arange(len(one.frames)) / 25)
        view = one.image.read(range(len(one.frames)))
        np.testing.assert_array_equal(view, own["obs/agentview_image"])
        np.testing.assert_array_equal(one.tracks["robot_action"], own["actions"].astype("f4"))
        arm = [own["obs/robot0_eef_pos"], own["obs/robot0_gripper_qpos"]]
        np.testing.assert_array_equal(one.tracks["state"], np.concatenate(arm, 1).astype("f4"))
    said = "\n".join(notes)
    assert "splits: as mask/train and mask/valid of the file say" in said
    assert "left out: next_obs/tactile_left_image" in said


def test_robomimic_with_one_mask_or_none(tmp_path):
    robomimic(tmp_path / "demo.hdf5", masks={"train": ["demo_9"]})
    train, notes = read(tmp_path)
    assert {key.split("/")[1] for key in train} == {"demo_9"}
    assert {key.split("/")[1] for key in read(tmp_path, "val")[0]} == {"demo_8", "demo_10"}
    assert "fps: 20 is assumed" in "\n".join(notes)
    robomimic(tmp_path / "demo.hdf5", masks={"valid": ["demo_9"]})
    assert {key.split("/")[1] for key in read(tmp_path)[0]} == {"demo_8", "demo_10"}
    robomimic(tmp_path / "demo.hdf5")
    assert len(read(tmp_path)[0]) == 6
    assert len(read(tmp_path, val=0.9)[0]) < 6  # a share is held out
    robomimic(tmp_path / "demo.hdf5", masks={"train": ["demo_8"], "valid": ["demo_9"]})
    assert "1 episodes, such as demo_10, are in no split" in "\n".join(read(tmp_path)[1])
    robomimic(tmp_path / "demo.hdf5", masks={"train": ["demo_8"], "valid": ["demo_8"]})
    data = Episodes(str(tmp_path))
    with pytest.raises(DataError, match="demo_8 is both in mask/train and in mask/valid"):
        list(data.recordings("train"))


def test_libero_says_the_task(tmp_path):
    info = json.dumps({"language_instruction": "put the bowl on the plate"})
    views = ("agentview_rgb", "eye_in_hand_rgb")
    written = robomimic(tmp_path / "a_demo.hdf5", views=views, problem_info=info)
    found, notes = read(tmp_path)
    one = found["a_demo/demo_8/tactile_left_image"]
    assert one.text == "put the bowl on the plate"
    view = one.image.read(range(12))
    np.testing.assert_array_equal(view, written["demo_8"]["obs/agentview_rgb"])
    assert "left out: " in "\n".join(notes)


def test_libero_says_how_its_simulator_draws(tmp_path):
    robomimic(tmp_path / "a_demo.hdf5", macros_image_convention="opengl")
    assert "mirror: the file says that its simulator draws" in "\n".join(read(tmp_path)[1])


def test_mimicgen_keeps_its_plans_out_of_the_state(tmp_path):
    written = robomimic(tmp_path / "demo.hdf5")
    with h5py.File(tmp_path / "demo.hdf5", "a") as file:
        for name, one in written.items():
            rows, group = len(one["actions"]), file[f"data/{name}"]
            group["src_demo_inds"] = np.array([3, 1])
            for key in ("eef_pose", "target_pose", "object_poses/nut"):
                group[f"datagen_info/{key}"] = np.full((rows, 4, 4), 7.0)
            group["datagen_info/gripper_action"] = np.ones((rows, 1))
    found, _ = read(tmp_path)
    one, own = found["demo/demo_8/tactile_left_image"], written["demo_8"]
    arm = [own["obs/robot0_eef_pos"], own["obs/robot0_gripper_qpos"]]
    np.testing.assert_array_equal(one.tracks["state"], np.concatenate(arm, 1).astype("f4"))
    np.testing.assert_array_equal(one.tracks["robot_action"], own["actions"].astype("f4"))
    np.testing.assert_array_equal(one.tracks["target_pose"], np.full((12, 4, 4), 7, "f4"))


def test_a_zarr_with_a_group_an_episode(tmp_path):
    shown = {f"episode_{i}/tactile": pictures(6 + i, 24, 32, 3, seed=i) for i in range(3)}
    write_zarr(tmp_path / "lab.zarr", shown)
    found, _ = read(tmp_path)
    assert [*found] == [f"lab/episode_{i}/tactile" for i in range(3)]
    for i, one in enumerate(found.values()):
        np.testing.assert_array_equal(pixels(one), shown[f"episode_{i}/tactile"])


def test_numbered_sensors_are_no_episodes(tmp_path):
    shown = {f"tactile/{i}/rgb": pictures(6, 24, 32, 3, seed=i) for i in range(3)}
    write_hdf5(tmp_path / "lab.hdf5", shown)
    found, _ = read(tmp_path)
    assert [*found] == [f"lab/{i}" for i in range(3)]


def test_aloha(tmp_path):
    rng = np.random.default_rng(4)
    arrays = {
        "observations/images/cam_high": pictures(8, 24, 32, 3),
        "observations/images/cam_left_wrist": pictures(8, 24, 32, 3, seed=1),
        "observations/images/gelsight_left": pictures(8, 24, 32, 3, seed=2),
        "observations/images/gelsight_right": pictures(8, 24, 32, 3, seed=3),
        "observations/qpos": rng.normal(0, 1, (8, 14)).astype("f4"),
        "observations/qvel": rng.normal(0, 1, (8, 14)).astype("f4"),
        "action": rng.normal(0, 1, (8, 14)).astype("f4"),
    }
    for i in range(3):
        write_hdf5(tmp_path / f"episode_{i}.hdf5", arrays, sim=False)
    found, notes = read(tmp_path)
    assert len(found) == 6
    one = found["episode_1/gelsight_right"]
    assert one.sensor == "gelsight"
    np.testing.assert_array_equal(pixels(one), arrays["observations/images/gelsight_right"])
    np.testing.assert_array_equal(one.times, np.arange(8) / 50)
    np.testing.assert_array_equal(one.tracks["state"], arrays["observations/qpos"])
    np.testing.assert_array_equal(one.tracks["qvel"], arrays["observations/qvel"])
    np.testing.assert_array_equal(one.tracks["robot_action"], arrays["action"])
    view = one.image.read(range(8))
    np.testing.assert_array_equal(view, arrays["observations/images/cam_high"])
    assert "fps: 50 is assumed" in "\n".join(notes)


def test_aloha_with_encoded_images(tmp_path):
    images = jpegs(pictures(8, 24, 32, 3, seed=2))
    padded = np.zeros((8, max(map(len, images))), np.uint8)
    for row, image in zip(padded, images, strict=True):
        row[: len(image)] = np.frombuffer(image, np.uint8)
    top = {"observations/images/front": images, "observations/qpos": np.zeros((8, 14))}
    write_hdf5(tmp_path / "a.hdf5", {**top, "observations/images/tactile": padded})
    (one,) = read(tmp_path)[0].values()
    wanted = [cv2.imdecode(np.frombuffer(image, np.uint8), 1)[..., ::-1] for image in images]
    np.testing.assert_array_equal(pixels(one), wanted)


@pytest.mark.parametrize(("shape", "sensor"), [((32, 24), "digit"), ((24, 32), "gelsight_mini")])
def test_the_sensor_of_encoded_images_is_by_their_shape(shape, sensor, tmp_path):
    images = jpegs(pictures(8, *shape, 3, seed=2))
    write_hdf5(tmp_path / "a.hdf5", {"observations/images/tactile": images})
    found, notes = read(tmp_path)
    assert [one.sensor for one in found.values()] == [sensor]
    assert f"only by the shape {shape[0]} x {shape[1]}" in "\n".join(notes)


def grey(frames):
    return np.repeat(frames[..., None], 3, -1)


SHAPES = {
    "channels first": (lambda a: np.moveaxis(a, -1, 1), lambda a: a),
    "grey": (lambda a: a[..., 0], lambda a: grey(a[..., 0])),
    "one channel": (lambda a: a[..., :1], lambda a: grey(a[..., 0])),
    "alpha": (lambda a: np.concatenate([a, a[..., :1] * 0 + 255], -1), lambda a: a),
    "fractions": (lambda a: (a / 255).astype("f4"), lambda a: a),
    "floats": (lambda a: a.astype("f4"), lambda a: a),
    "one grey channel first": (lambda a: a[:, None, :, :, 0], lambda a: grey(a[..., 0])),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_of_pictures(shape, tmp_path):
    stored, wanted = SHAPES[shape]
    shown = pictures(9, 24, 32, 3)
    write_npz(tmp_path / "a.npz", {"digit": stored(shown)})
    (one,) = read(tmp_path)[0].values()
    assert one.frames.shape == (24, 32)
    np.testing.assert_array_equal(pixels(one), wanted(shown))
    assert one.sensor == "digit"


def test_two_sensors_in_one_array(tmp_path):
    shown = pictures(9, 2, 24, 32, 3)
    write_npz(tmp_path / "a.npz", {"tactile": shown})
    found, _ = read(tmp_path)
    assert [*found] == ["a/tactile_0", "a/tactile_1"]
    for i, one in enumerate(found.values()):
        np.testing.assert_array_equal(pixels(one), shown[:, i])


FORCES = {
    "ft": (6, [0, 1, 2], 1.0),
    "wrench": (6, [0, 1, 2], 1.0),
    "forces": (3, [0, 1, 2], 1.0),
    "tactile_force": (3, [0, 1, 2], 1.0),
    "force_mN": (3, [0, 1, 2], 1e-3),
    "normal_force": (1, [None, None, 0], 1.0),
    "force_z": (0, [None, None, 0], 1.0),
}


@pytest.mark.parametrize("name", FORCES)
def test_names_of_forces(name, tmp_path):
    width, columns, newton = FORCES[name]
    values = np.random.default_rng(3).normal(0, 1, (9, width) if width else 9).astype("f4")
    WRITERS["zarr2"](tmp_path, {"data/gelsight": pictures(9, 24, 32, 3), f"data/{name}": values})
    found, notes = read(tmp_path)
    (one,) = found.values()
    table = values.reshape(9, -1)
    for axis, column in enumerate(columns):
        if column is None:
            assert np.isnan(one.force[:, axis]).all()
        else:
            wanted = (table[:, column].astype("f8") * newton).astype("f4")
            np.testing.assert_array_equal(one.force[:, axis], wanted)
    assert f"force: data/{name} is taken for that on data/gelsight" in "\n".join(notes)
    if width == 6:
        np.testing.assert_array_equal(one.tracks[name], values)


@pytest.mark.parametrize("name", ["robot_tcp_wrench", "joint_torque_force", "force_counts"])
def test_forces_of_the_robot_are_tracks(name, tmp_path):
    values = np.random.default_rng(3).normal(0, 1, (9, 6)).astype("f4")
    WRITERS["zarr2"](tmp_path, {"data/gelsight": pictures(9, 24, 32, 3), f"data/{name}": values})
    (one,) = read(tmp_path)[0].values()
    assert one.force is None
    np.testing.assert_array_equal(next(iter(one.tracks.values())), values)


@pytest.mark.parametrize(
    ("touch", "times", "force", "clock"),
    [
        ("digit/image", "digit/timestamp", "ati/wrench", "ati/timestamp"),
        ("tactile", "tactile_time_ms", "force", "force_time_ms"),
    ],
)
@pytest.mark.parametrize("writer", ["hdf5", "npz"])
def test_a_force_with_a_clock_of_its_own(writer, touch, times, force, clock, tmp_path):
    step = 33_000_000 if times.startswith("digit") else 33
    start = 1_700_000_000_000_000_000 if times.startswith("digit") else 0
    own = np.arange(0, 12 * step, step // 8) + start - step  # begins before the first frame
    felt = np.stack([np.zeros(len(own)), own - start, -3.0 * (own - start)], 1) / step
    arrays = {
        touch: pictures(9, 24, 32, 3),
        times: start + step * np.arange(9),
        force: np.c_[felt, np.zeros_like(felt)],
        clock: own,
    }
    WRITERS[writer](tmp_path, arrays)
    (one,) = read(tmp_path)[0].values()
    assert len(one.times) == 9
    np.testing.assert_allclose(one.force[:, 1], np.arange(9), atol=1e-5)
    np.testing.assert_allclose(one.force[:, 2], 3.0 * np.arange(9), atol=1e-5)  # z was turned


@pytest.mark.parametrize(("unit", "factor"), [("mN", 1e-3), (b"N", 1), ("V", None)])
def test_an_attribute_says_the_unit_of_a_force(unit, factor, tmp_path):
    force = np.arange(36.0).reshape(12, 3)
    arrays = {"digit/image": pictures(12, 24, 32, 3), "digit/force": force}
    write_hdf5(tmp_path / "take.hdf5", arrays)
    with h5py.File(tmp_path / "take.hdf5", "r+") as file:
        file["digit/force"].attrs["unit"] = unit
    ((_, guess),) = recognise(tmp_path)
    found, notes = read(tmp_path, **{k: v for k, v in guess.options.items() if k != "root"})
    (one,) = found.values()
    if factor is None:
        assert one.force is None
        assert any("digit/force is in v by its attribute, so it is a track" in x for x in notes)
    else:
        np.testing.assert_allclose(one.force, factor * force, rtol=1e-6)


def test_the_name_of_an_array_says_the_order_of_channels(tmp_path):
    colour = pictures(12, 24, 32, 3)
    write_npz(tmp_path / "take.npz", {"tactile_bgr": colour})
    found, notes = read(tmp_path)
    (one,) = found.values()
    np.testing.assert_array_equal(one.frames.read(range(12)), colour[..., ::-1])
    assert any("channels: bgr, as the name tactile_bgr says" in note for note in notes)


@pytest.mark.parametrize(("said", "flipped"), [("BGR", True), ("rgb8", False), ("jpeg", False)])
def test_an_attribute_says_the_order_of_channels(said, flipped, tmp_path):
    shown = pictures(9, 24, 32, 3)
    WRITERS["hdf5"](tmp_path, {"digit/image": shown})
    with h5py.File(tmp_path / "lab.hdf5", "r+") as file:
        file["digit/image"].attrs["color_order"] = said
    found, notes = read(tmp_path)
    (one,) = found.values()
    np.testing.assert_array_equal(pixels(one), shown[..., ::-1] if flipped else shown)
    assert ("red is taken to be the first" in "".join(notes)) == (said == "jpeg")


def test_clocks_that_do_not_meet_are_named(tmp_path):
    arrays = {"digit/image": pictures(9, 24, 32, 3), "digit/t": np.arange(9) / 30}
    arrays |= {"ati/wrench": np.ones((90, 6)), "ati/t": np.arange(90) / 300 + 50}
    WRITERS["hdf5"](tmp_path, arrays)
    with pytest.raises(DataError, match="do not overlap those of the frames"):
        read(tmp_path)


def test_one_force_of_two_sensors_is_a_track(tmp_path):
    arrays = buffer()
    values = arrays.pop("data/force_left")
    arrays.pop("data/force_right")
    WRITERS["zarr2"](tmp_path, {**arrays, "data/ft": values})
    found, notes = read(tmp_path)
    assert {one.force is None for one in found.values()} == {True}
    np.testing.assert_array_equal(found["lab/000000/tactile_left"].tracks["ft"], values[:12])
    assert "force: data/ft is a track" in "\n".join(notes)


def test_numbers_of_taxels(tmp_path):
    values = np.random.default_rng(3).normal(0, 1, (9, 4, 6)).astype("f4")
    write_npz(tmp_path / "a.npz", {"tactile_left": values, "pressure_skin": values[:, 0]})
    found, notes = read(tmp_path)
    assert [*found] == ["a/pressure_skin", "a/tactile_left"]
    one = found["a/tactile_left"]
    assert one.frames.shape == (4, 6)
    np.testing.assert_array_equal(one.tracks["taxels"].reshape(9, 4, 6), values)
    assert "span: tactile_left is drawn" in "\n".join(notes)


def test_a_still_picture_is_the_background(tmp_path):
    still = pictures(24, 32, 3, seed=9)
    arrays = {"gelsight_left": pictures(9, 24, 32, 3), "gelsight_left_reference": still}
    write_npz(tmp_path / "a.npz", arrays)
    (one,) = read(tmp_path)[0].values()
    np.testing.assert_array_equal(one.no_contact.read([0])[0], still)


def test_rates_that_files_state(tmp_path):
    shown = {"tactile": pictures(9, 24, 32, 3)}
    write_hdf5(tmp_path / "a.hdf5", shown, fps=12)
    assert next(iter(read(tmp_path)[0].values())).times[1] == 1 / 12
    (tmp_path / "a.hdf5").unlink()
    write_npz(tmp_path / "a.npz", {**shown, "fps": np.array(12)})
    assert next(iter(read(tmp_path)[0].values())).times[1] == 1 / 12
    (tmp_path / "a.npz").unlink()
    write_zarr(tmp_path / "a.zarr", shown)
    zarr.open_group(tmp_path / "a.zarr", mode="r+").attrs["frame_rate"] = 12
    assert next(iter(read(tmp_path)[0].values())).times[1] == 1 / 12


def test_where_names_say_no_touch_it_is_asked_for(tmp_path, capsys):
    shown = pictures(9, 24, 32, 3)
    arrays = {"data/img": shown, "data/left": shown[::-1], "data/x": np.zeros((9, 2), "f4")}
    write_zarr(tmp_path / "lab" / "a.zarr", arrays)
    page = tmp_path / "page.html"
    assert cli.run(["data", "inspect", str(tmp_path / "lab"), f"out={page}"]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "lab/a.zarr: no array is called touch" in said
    for word in ("data/img uint8 (9, 24, 32, 3)", "data/x float32 (9, 2)", "data.map={about: mine"):
        assert word in said
    word = re.search(r"'data\.touch=\[(.*?)\]'", said)[1]
    found, _ = read(tmp_path / "lab", touch=[word])
    np.testing.assert_array_equal(pixels(found["a/img"]), shown)
    found, _ = read(tmp_path / "lab", touch="data/left")
    np.testing.assert_array_equal(pixels(found["a/left"]), shown[::-1])
    with pytest.raises(DataError, match=r"key of data.touch 'data/imgs'"):
        read(tmp_path / "lab", touch=["data/imgs"])
    with pytest.raises(DataNotFoundError, match="data/img uint8"):
        recognise(tmp_path / "lab")


def test_without_guesses_keys_are_listed(tmp_path):
    WRITERS["zarr2"](tmp_path, buffer())
    listed = r"data.guess=false.*data/tactile_left uint8 \(30,"
    with pytest.raises(DataNotFoundError, match=listed):
        read(tmp_path, guess=False)
    with pytest.raises(ConfigError, match=r"data.touch is for a guess"):
        Episodes(str(tmp_path), preset="aloha", touch=["x"])


def test_a_guessed_map_is_kept_and_read_again(tmp_path):
    WRITERS["zarr2"](tmp_path / "lab", buffer())
    guess = Episodes.recognise(tmp_path / "lab")
    assert guess.score == 0.5
    again = Episodes(**guess.options, val=0)
    assert len([*again.recordings("train")]) == 4


@pytest.mark.slow
def test_the_page_has_each_guess_once_and_the_map_beside_it(tmp_path, capsys):
    WRITERS["zarr2"](tmp_path / "lab", buffer())
    page = tmp_path / "page.html"
    assert cli.run(["data", "inspect", str(tmp_path / "lab"), f"out={page}"]) == 0
    said = capsys.readouterr().out
    assert said.count("times: data/timestamp in s") == 1
    assert "times: data/timestamp in s" in page.read_text()
    kept = (tmp_path / "page.yaml").read_text()
    assert "array: data/tactile_left" in kept
    assert kept in html.unescape(page.read_text()), "as YAML to copy"


def test_numbers_of_episodes_with_a_lost_chunk_are_refused(tmp_path):
    numbers = np.repeat([0, 1, 2], 10)
    arrays = {"episode_index": numbers, "tactile": pictures(30, 24, 32, 3)}
    write_zarr(tmp_path / "lab.zarr", arrays, chunk=5)
    assert len(read(tmp_path)[0]) == 3
    options = Episodes.recognise(tmp_path).options
    (tmp_path / "lab.zarr/episode_index/5").unlink()
    data = Episodes(**options, val=0)
    with pytest.raises(DataError, match="the rows of an episode are apart"):
        list(data.recordings("train"))


def test_times_of_each_sensor(tmp_path):
    shown = {side: pictures(9, 24, 32, 3, seed=i) for i, side in enumerate(("thumb", "index"))}
    arrays = {f"tactile/{side}/rgb": frames for side, frames in shown.items()}
    arrays |= {"tactile/thumb/stamp": np.arange(9) * 40, "tactile/index/stamp": np.arange(9) * 50}
    arrays |= {"robot/time": np.arange(9) / 7, "tactile/index/force": np.ones((9, 3), "f4")}
    write_hdf5(tmp_path / "a.h5", arrays)
    found, _ = read(tmp_path)
    for side, step in (("thumb", 40), ("index", 50)):
        one = found[f"a/{side}"]
        np.testing.assert_array_equal(pixels(one), shown[side])
        np.testing.assert_array_equal(one.times, np.arange(9) * step * 1e-3)
    assert found["a/thumb"].force is None
    np.testing.assert_array_equal(found["a/index"].force, arrays["tactile/index/force"])


def test_groups_of_a_split(tmp_path):
    shown = {
        f"{split}/episode_{i}/tactile": pictures(6, 24, 32, 3, seed=i)
        for split, i in (("train", 0), ("train", 1), ("val", 0))
    }
    write_hdf5(tmp_path / "a.h5", shown)
    assert [*read(tmp_path)[0]] == ["a/train/episode_0/tactile", "a/train/episode_1/tactile"]
    assert [*read(tmp_path, "val")[0]] == ["a/val/episode_0/tactile"]


def test_the_only_pictures_are_touch(tmp_path):
    """The names of a data review: ``frames``, ``times`` and ``forces``."""
    arrays = {
        "frames": pictures(9, 24, 32, 3),
        "times": np.arange(9) / 20,
        "forces": np.random.default_rng(1).normal(0, 1, (9, 3)).astype("f4"),
    }
    for i in range(3):
        write_npz(tmp_path / f"trial_{i}.npz", arrays)
    found, notes = read(tmp_path)
    assert [*found] == [f"trial_{i}/frames" for i in range(3)]
    one = found["trial_2/frames"]
    np.testing.assert_array_equal(pixels(one), arrays["frames"])
    np.testing.assert_array_equal(one.force, arrays["forces"])
    np.testing.assert_array_equal(one.times, arrays["times"])
    assert "touch: frames is the only array of pictures" in "\n".join(notes)


def test_forces_of_pads(tmp_path):
    force = np.random.default_rng(1).normal(0, 1, (9, 2, 3)).astype("f4")
    arrays = {"tactile": pictures(9, 2, 24, 32, 3), "tactile_force": force}
    write_npz(tmp_path / "a.npz", arrays)
    found, _ = read(tmp_path)
    for i in range(2):
        np.testing.assert_array_equal(found[f"a/tactile_{i}"].force, force[:, i])


@pytest.mark.parametrize("side", ["left", "l"])
def test_the_force_of_its_own_side(side, tmp_path):
    force = np.random.default_rng(1).normal(0, 1, (9, 6)).astype("f4")
    arrays = {
        "obs/gelsight_mini_left": pictures(9, 24, 32, 3),
        f"obs/{side}_force_torque": force,
        "obs/right_force_torque": -force,
    }
    write_npz(tmp_path / "gelslim_rig/a.npz", arrays)
    (one,) = read(tmp_path)[0].values()
    assert one.sensor == "gelsight_mini"  # its own name before that of its folder
    np.testing.assert_array_equal(one.force, force[:, :3])
    np.testing.assert_array_equal(one.tracks["right_force_torque"], -force)


def test_a_zip_of_zarr(tmp_path):
    arrays = buffer()
    zipped(write_zarr(tmp_path / "made/x.zarr", arrays), tmp_path / "replay_buffer.zarr.zip")
    found, _ = read(tmp_path / "replay_buffer.zarr.zip")
    assert len(found) == 4
    one = found["replay_buffer/000001/tactile_right"]
    np.testing.assert_array_equal(pixels(one), arrays["data/tactile_right"][12:])


@pytest.mark.parametrize("name", ["force_{}", "f{}", "F{}", "force_{}_mN"])
def test_forces_of_an_array_an_axis(name, tmp_path):
    force = np.random.default_rng(1).normal(0, 1, (9, 3)).astype("f4")
    arrays = {f"data/{name.format(axis)}": force[:, i] for i, axis in enumerate("xyz")}
    write_hdf5(tmp_path / "a.h5", {**arrays, "data/digit": pictures(9, 24, 32, 3)})
    (one,) = read(tmp_path)[0].values()
    newton = 1e-3 if "mN" in name else 1.0
    np.testing.assert_array_equal(one.force, (force.astype("f8") * newton).astype("f4"))


@pytest.mark.slow
def test_the_words_of_an_error_work_as_typed(tmp_path, capsys):
    """Both the key and the map of an error's fix, through a shell."""
    (tmp_path / "lab").mkdir()
    robomimic(tmp_path / "lab/demo.hdf5")
    with h5py.File(tmp_path / "lab/demo.hdf5", "r+") as file:
        for demo in file["data"].values():
            for side in ("left", "right"):
                demo[f"obs/view_{side}"] = demo.pop(f"obs/tactile_{side}_image")[:]
    with pytest.raises(DataError) as error:
        Episodes.recognise(tmp_path / "lab")
    words = shlex.split(str(error.value).partition("Say which is touch: ")[2])
    typed = [word.rstrip(";") for word in words if word.startswith("data")]
    names = [word.partition("=")[0] for word in typed]
    assert names == ["data", "data.root", "data.touch", "data.map"]
    for last in typed[2:]:
        out = tmp_path / "page.html"
        assert cli.run(["data", "inspect", *typed[:2], last, f"out={out}"]) == 0, last
        assert "3 recordings" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["object", "material", "object_name"])
def test_the_object_of_an_attribute_and_one_of_few_is_held_out(name, tmp_path):
    objects = ["mug", "bolt", "key"]
    with h5py.File(tmp_path / "lab.h5", "w") as file:
        for i, said in enumerate(objects):
            group = file.create_group(f"trial_{i}")
            group["tactile"] = pictures(12, 24, 32, 3, seed=i)
            group.attrs[name] = said
    sides = {split: read(tmp_path, split, val=0.01)[0] for split in ("train", "val")}
    assert {split: len(found) for split, found in sides.items()} == {"train": 2, "val": 1}
    whole = sides["train"] | sides["val"]
    assert [one.object for _, one in sorted(whole.items())] == objects
    assert len(read(tmp_path, "val", val=0)[0]) == 0


@pytest.mark.parametrize(
    ("name", "read_as"), [("object_id", ["1", "2", "3"]), ("label", [None] * 3)]
)
def test_the_number_of_an_object_is_its_name(name, read_as, tmp_path):
    for i, number in enumerate([1, "2", np.int64(3)]):
        with h5py.File(tmp_path / f"{i}.h5", "w") as file:
            file["tactile"] = pictures(12, 24, 32, 3, seed=i)
            file.attrs[name] = number if name == "object_id" else i
    assert [one.object for _, one in sorted(read(tmp_path)[0].items())] == read_as


def test_the_object_of_an_array_of_texts(tmp_path):
    with h5py.File(tmp_path / "lab.h5", "w") as file:
        file["tactile"] = pictures(12, 24, 32, 3)
        file["object"] = "mug"
    (one,) = read(tmp_path)[0].values()
    assert one.object == "mug"


def grouped(*groups):
    """A touch and its force in each group, by the number of the group."""
    arrays = {}
    for number, group in enumerate(groups):
        arrays[f"{group}/tactile"] = pictures(8, 24, 32, 3, seed=number)
        arrays[f"{group}/force"] = np.full((8, 3), number, np.float32)
    return arrays


@pytest.mark.parametrize(
    ("groups", "objects"),
    [
        (
            ["mug/trial_0", "mug/trial_1", "can/trial_0", "can/trial_1"],
            ["mug", "mug", "can", "can"],
        ),
        (["mug", "can", "box"], ["mug", "can", "box"]),
        (["20240513_142205", "20240513_142507", "20240514_090000"], [None] * 3),
        (["day_1/trial_0", "day_2/trial_0"], [None] * 2),
    ],
)
def test_groups_of_one_file_are_recordings_each(groups, objects, tmp_path):
    write_hdf5(tmp_path / "all.h5", grouped(*groups))
    [(_, guess), *_] = recognise(tmp_path)
    found, _ = read(tmp_path, map=guess.options["map"])
    assert {key.split("/", 1)[1].rpartition("/")[0] for key in found} == {*groups}
    for key, one in found.items():
        number = groups.index(key.split("/", 1)[1].rpartition("/")[0])
        assert one.object == objects[number]
        np.testing.assert_array_equal(pixels(one), pictures(8, 24, 32, 3, seed=number))
        np.testing.assert_array_equal(one.force, np.full((8, 3), number, np.float32))


@pytest.mark.parametrize("groups", [["left", "right"], ["index", "thumb"], ["gsmini0", "gsmini1"]])
def test_groups_of_sides_and_sensors_are_one_recording(groups, tmp_path):
    write_hdf5(tmp_path / "all.h5", grouped(*groups))
    [(_, guess), *_] = recognise(tmp_path)
    assert "within" not in guess.options["map"]
    assert [one["array"] for one in guess.options["map"]["touch"]] == [
        f"{x}/tactile" for x in groups
    ]


@pytest.mark.parametrize("name", ["image", "tactile"])
def test_a_picture_in_each_file_is_no_recording_of_taxels(name, tmp_path):
    for number in range(3):
        picture = pictures(1, 40, 60, 3, seed=number)[0]
        write_npz(tmp_path / f"{number:04d}.npz", {name: picture, "force": np.zeros(3)})
    with pytest.raises(DataNotFoundError, match=rf"{name} uint8 \(40, 60, 3\) .*np\.stack"):
        recognise(tmp_path)
    with pytest.raises(DataError, match="is one picture"):
        list(Episodes(str(tmp_path), touch=[name]).recordings("train"))


def test_a_table_in_an_array_is_named_with_its_columns(tmp_path):
    write_hdf5(tmp_path / "all.h5", {"tactile": pictures(8, 24, 32, 3, seed=0)})
    with h5py.File(tmp_path / "all.h5", "a") as file:
        file["ft"] = np.zeros(8, [("t", "f8"), ("fx", "f4"), ("fz", "f4")])
    [(_, guess), *_] = recognise(tmp_path)
    line = "ft: a table of t, fx, fz, which is not read; write each column as an array of its own"
    assert any(line in doubt for doubt in guess.options["map"]["doubts"])


@pytest.mark.parametrize("factor", [1, -1])
def test_forces_of_the_only_body_of_a_simulator_are_on_the_only_touch(tmp_path, factor):
    force = np.zeros((9, 1, 3), "f4")
    force[:, 0] = np.arange(27).reshape(9, 3) * [0.1, -0.1, factor * 0.1]
    arrays = {"obs/tactile_rgb": pictures(9, 24, 32, 3), "obs/contact_forces": force}
    WRITERS["hdf5"](tmp_path, arrays)
    (one,) = read(tmp_path)[0].values()
    np.testing.assert_array_equal(one.force, force[:, 0] * np.float32([1, 1, factor]))
    assert "contact_forces" not in one.tracks


def test_forces_of_several_bodies_are_a_track(tmp_path):
    force = np.ones((9, 2, 3), "f4")
    arrays = {"obs/tactile_rgb": pictures(9, 24, 32, 3), "obs/contact_forces": force}
    WRITERS["hdf5"](tmp_path, arrays)
    (one,) = read(tmp_path)[0].values()
    assert one.force is None
    np.testing.assert_array_equal(one.tracks["contact_forces"], force)


def test_a_missing_module_is_installed_by_the_name_of_its_package():
    with pytest.raises(ConfigError, match=r"is read by nowhere\.io: pip install nowhere "):
        need("nowhere.io", "a.mat")


@pytest.mark.parametrize("name", WRITERS)
def test_rows_of_single_touches_are_read_with_the_keys_of_the_line(tmp_path, name):
    felt = np.arange(36).reshape(12, 3) / 8
    WRITERS[name](tmp_path, {"images": (shown := pictures(12, 24, 32, 3)), "force": felt})
    [(_, guess), *_] = recognise(tmp_path)
    (line,) = [one for one in guess.options["map"]["doubts"] if one.startswith("ends: images")]
    fix = dict(one.split(": ") for one in line.partition("the map has: ")[2].split(", "))
    data = Episodes(str(tmp_path), map=guess.options["map"] | fix)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 12
    for one in found:
        row = int(one.key.split("/")[-2])
        np.testing.assert_array_equal(one.frames.read([0])[0], shown[row])
        np.testing.assert_allclose(one.force, felt[[row]])
        assert one.times.tolist() == [0]
        assert one.no_contact is None
