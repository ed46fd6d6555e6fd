"""Small files of every format, made after its description."""

from __future__ import annotations

import json
import shutil
import tarfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import zarr


def pictures(*shape: int, seed: int = 0) -> np.ndarray:
    """Smooth, different pictures, uint8; red is brighter than blue."""
    rng = np.random.default_rng(seed)
    out = rng.integers(60, 90, shape).astype(np.uint8)
    out[..., 0] += 100
    return out


def jpegs(frames: np.ndarray, swapped: bool = False) -> np.ndarray:
    """JPEG files of RGB frames, as byte strings of one width; red and blue exchanged if asked."""
    coded = [cv2.imencode(".jpg", frame if swapped else frame[..., ::-1])[1] for frame in frames]
    return np.array([one.tobytes() for one in coded])


def write_zarr(path: Path, arrays: Mapping[str, Any], version: int = 2, chunk: int = 10) -> Path:
    """A zarr group; rows in chunks."""
    root = zarr.open_group(path, mode="w", zarr_format=version)
    for key, values in arrays.items():
        values = np.asarray(values)
        chunks = (min(chunk, max(1, len(values))), *values.shape[1:])
        made = root.create_array(key, shape=values.shape, dtype=values.dtype, chunks=chunks)
        made[:] = values
    return path


def write_hdf5(path: Path, arrays: Mapping[str, Any], **attributes: Any) -> Path:
    """An HDF5 file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for key, values in arrays.items():
            file.create_dataset(key, data=values)
        for name, value in attributes.items():
            file.attrs[name] = value
    return path


def zipped(folder: Path, archive: Path, top: str = "") -> Path:
    """A zip without compression of a folder; its root, or a folder ``top`` in it."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                file.write(path, Path(top) / path.relative_to(folder))
    return archive


def open_x_tactile(
    root: Path, seconds: bool = False, matrix: bool = False, version: int = 2
) -> Path:
    """``toy.zarr``: three episodes of one hand with two pads."""
    rng = np.random.default_rng(1)
    group, type_name = ("skin", "matrix") if matrix else ("gripper", "image")
    touch = rng.normal(0, 2, (40, 5, 4, 6)).astype("f4") if matrix else pictures(40, 2, 32, 32, 3)
    pads = touch.shape[1]
    joints = rng.normal(0, 1, (40, 7)).astype("f4")
    joints[3, 2] = 1e30  # no value
    force = rng.normal(0, 0.3, (40, pads, 3)).astype("f4") - [0, 0, 4]
    arrays: dict[str, Any] = {
        "meta/episode_ends": np.array([10, 25, 40]),
        "data/timestamps": np.arange(40) / 30 if seconds else np.arange(40),
        "data/camera_main_rgb": pictures(40, 32, 32, 3, seed=2),
        "data/right_arm_joints": joints,
        "data/right_hand_joints": rng.random((40, 1)).astype("f4"),
        "data/right_hand_joints_idx": np.full((40, 1), 28, "i4"),
        "data/right_wrist_pose": rng.normal(0, 1, (40, 6)).astype("f4"),
        f"data/right_tactile_data_{group}": touch,
        f"data/right_tactile_area_{group}": np.tile(np.arange(pads), (40, 1)),
        f"data/right_tactile_sensor_{group}": np.full(40, "GelSightMini", "<U12"),
        f"data/right_tactile_type_{group}": np.full(40, type_name, "<U6"),
        "data/right_tactile_data_force": force.astype("f4"),
        "data/right_tactile_type_force": np.full(40, "state", "<U5"),
        "data/sub_task_instruction": np.full(40, "press the cup   ", "<U16"),
    }
    return write_zarr(root / "toy.zarr", arrays, version)


def univtac(root: Path, pad: str = "left_tactile", other: str = "right_tactile") -> Path:
    """Simulated episode: JPEG with red and blue exchanged."""
    rng = np.random.default_rng(3)
    arrays: dict[str, Any] = {
        "step": np.arange(6) * 5,
        "embodiment/joint": rng.normal(0, 1, (6, 9)).astype("f4"),
        "embodiment/ee": rng.normal(0, 1, (6, 7)).astype("f4"),
        "observation/head/rgb": jpegs(pictures(6, 24, 32, 3), swapped=True),
        "actor/plug": rng.normal(0, 1, (6, 7)).astype("f4"),
        "atom/id": np.array([0, 0, 1, 1, 1, 2]),
    }
    for name in (pad, other):
        depth = np.full((6, 24, 32), 34.0, "f4")
        depth[:, 8:16, 10:20] = 33.2
        arrays |= {
            f"tactile/{name}/rgb": jpegs(pictures(6, 24, 32, 3, seed=4), swapped=True),
            f"tactile/{name}/rgb_marker": jpegs(pictures(6, 24, 32, 3, seed=5), swapped=True),
            f"tactile/{name}/depth": depth,
            f"tactile/{name}/marker": rng.random((6, 2, 9, 2)).astype("f4"),
            f"tactile/{name}/pose": rng.normal(0, 1, (6, 7)).astype("f4"),
        }
    return write_hdf5(root / "insert_hole/clean/0.hdf5", arrays)


def reactive_diffusion(root: Path) -> Path:
    """Replay buffer with the pictures and markers of one gripper."""
    rng = np.random.default_rng(6)
    arrays = {
        "meta/episode_ends": np.array([6, 12]),
        "data/timestamp": (1.7e9 + np.arange(12) / 24).astype("f4"),
        "data/left_gripper1_img": pictures(12, 24, 32, 3),
        "data/left_gripper2_img": pictures(12, 24, 32, 3, seed=1),
        "data/left_gripper1_marker_offset": rng.normal(0, 1, (12, 9, 2)).astype("f4"),
        "data/left_gripper1_initial_marker": rng.random((12, 9, 2)).astype("f4"),
        "data/external_img": pictures(12, 24, 32, 3, seed=2),
        "data/left_robot_tcp_pose": rng.normal(0, 1, (12, 9)).astype("f4"),
        "data/left_robot_tcp_vel": rng.normal(0, 1, (12, 6)).astype("f4"),
        "data/left_robot_tcp_wrench": rng.normal(0, 1, (12, 6)).astype("f4"),
        "data/left_robot_gripper_width": rng.random((12, 1)).astype("f4"),
        "data/action": rng.normal(0, 1, (12, 4)).astype("f4"),
    }
    return write_zarr(root / "peel_zarr/replay_buffer.zarr", arrays, chunk=5)


def vitamin_b(root: Path) -> Path:
    """Replay buffer of two hands, in a zip; JPEG XL is left out."""
    rng = np.random.default_rng(7)
    arrays: dict[str, Any] = {"meta/episode_ends": np.array([6, 12])}
    for hand in (0, 1):
        arrays |= {
            f"data/robot{hand}_eef_pos": rng.normal(0, 1, (12, 3)).astype("f4"),
            f"data/robot{hand}_eef_rot_axis_angle": rng.normal(0, 1, (12, 3)).astype("f4"),
            f"data/robot{hand}_gripper_width": rng.random((12, 1)).astype("f4"),
            f"data/robot{hand}_demo_start_pose": rng.normal(0, 1, (12, 7)).astype("f4"),
            f"data/camera{hand}_rgb": pictures(12, 24, 24, 3, seed=hand),
        }
        for side in ("left", "right"):
            name = f"data/camera{hand}_{side}_tactile"
            arrays[name] = pictures(12, 24, 24, 3, seed=hand + 2)
            arrays[f"{name}_points"] = rng.normal(0, 1, (12, 16, 3)).astype("f4")
    folder = write_zarr(root / "work/pour.zarr", arrays)
    archive = zipped(folder, root / "pour.zarr.zip")
    shutil.rmtree(root / "work")
    return archive


def touch_in_the_wild(root: Path) -> Path:
    """Replay buffer with two pads of taxels side by side."""
    rng = np.random.default_rng(8)
    arrays = {
        "meta/episode_ends": np.array([6, 12]),
        "data/camera0_rgb": pictures(12, 24, 24, 3),
        "data/camera0_tactile": rng.random((12, 12, 64)).astype("f4"),
        "data/robot0_eef_pos": rng.normal(0, 1, (12, 3)).astype("f4"),
        "data/robot0_eef_rot_axis_angle": rng.normal(0, 1, (12, 3)).astype("f4"),
        "data/robot0_gripper_width": rng.random((12, 1)).astype("f4"),
    }
    return write_zarr(root / "cup.zarr", arrays)


def manifeel(root: Path) -> Path:
    """Replay buffer of the simulator: pictures as fractions."""
    rng = np.random.default_rng(9)
    arrays: dict[str, Any] = {
        "meta/episode_ends": np.array([6, 12]),
        "data/front": pictures(12, 24, 24, 3) / np.float32(255),
        "data/state": rng.normal(0, 1, (12, 7)).astype("f4"),
        "data/action": rng.normal(0, 1, (12, 6)).astype("f4"),
    }
    for seed, side in enumerate(("left", "right")):
        taxim = pictures(12, 32, 24, 3, seed=seed) / np.float32(255)
        arrays[f"data/{side}_tactile_camera_taxim"] = taxim
        field = rng.normal(0, 1, (12, 10, 14, 3)).astype("f4")
        arrays[f"data/tactile_force_field_{side}"] = field
        arrays[f"data/tactile_depth_{side}"] = rng.random((12, 10, 14)).astype("f4")
    return write_zarr(root / "usb_quan_Aug05.zarr", arrays)


def freetacman(root: Path) -> Path:
    """Processed episode: blue first in the pictures."""
    rng = np.random.default_rng(10)
    qpos = rng.normal(0, 1, (6, 7)).astype("f4")
    arrays = {
        "observations/images/front": pictures(6, 24, 32, 3, seed=1)[..., ::-1],
        "observations/images/tactile": pictures(6, 24, 32, 3)[..., ::-1],
        "observations/qpos": qpos,
        "observations/end_pose": rng.normal(0, 1, (6, 7)).astype("f4"),
        "action": qpos,
    }
    path = root / "DensePacking/episode_0.hdf5"
    return write_hdf5(path, arrays, sim=False, compress=False)


def aloha(root: Path) -> Path:
    """Episode of another lab, with encoded images padded by zeros."""
    rng = np.random.default_rng(11)
    coded = [np.frombuffer(one, np.uint8) for one in jpegs(pictures(6, 24, 32, 3))]
    padded = np.zeros((6, max(map(len, coded)) + 5), np.uint8)
    for row, one in zip(padded, coded, strict=True):
        row[: len(one)] = one
    arrays = {
        "observations/images/cam_high": padded,
        "observations/images/left_tactile": padded,
        "observations/qpos": rng.normal(0, 1, (6, 14)).astype("f4"),
        "observations/qvel": rng.normal(0, 1, (6, 14)).astype("f4"),
        "action": rng.normal(0, 1, (6, 14)).astype("f4"),
    }
    return write_hdf5(root / "plug/episode_0.hdf5", arrays, sim=False, compress=True)


def vtouch(root: Path) -> Path:
    """Episode of a humanoid; its rate is in a text."""
    rng = np.random.default_rng(12)
    arrays = {
        "cameras/head/data": pictures(5, 24, 32, 3, seed=2),
        "tactile/hand_left/left/data": pictures(5, 24, 32, 3),
        "tactile/hand_left/right/data": pictures(5, 24, 32, 3, seed=1),
        "joints/state/arm/position": rng.normal(0, 1, (5, 7)).astype("f4"),
        "joints/state/arm/effort": rng.normal(0, 1, (5, 7)).astype("f4"),
        "joints/action/arm/position": rng.normal(0, 1, (5, 7)).astype("f4"),
        "metadata.json": json.dumps({"camera_fps": 20}),
    }
    return write_hdf5(root / "episode_7.hdf5", arrays)


def omnisharing(root: Path, top: str = "dataset/") -> Path:
    """Episode of one hand with two pads of taxels, x, y and z each."""
    rng = np.random.default_rng(13)
    arrays = {
        f"{top}observation/aligned_timestamp": 1_733_000_000_000_000 + np.arange(5) * 33_000,
        f"{top}observation/audio": np.zeros((20, 1)),
        f"{top}observation/obj1/data": rng.normal(0, 1, (5, 17)).astype("f4"),
    }
    for group in ("observation", "action"):
        joints = rng.normal(0, 1, (5, 29)).astype("f4")
        arrays[f"{top}{group}/lefthand/joints/data"] = joints
        arrays[f"{top}{group}/lefthand/handpose/data"] = rng.normal(0, 1, (5, 7)).astype("f4")
    tactile = f"{top}observation/lefthand/tactile/data"
    arrays[tactile] = rng.normal(0, 1, (5, 9)).astype("f4")
    path = write_hdf5(root / "episode_3_0101_12_4_glove.hdf5", arrays)
    with h5py.File(path, "r+") as file:
        file[tactile].attrs["sensor_names"] = ["palm_sensor1", "M6L"]
        file[tactile].attrs["sensor_lengths"] = [6, 3]
        file[f"{top}observation/audio"].attrs["txt"] = "lift the can"
        file[f"{top}observation/obj1/data"].attrs["obj_name"] = "can"
        (file[top] if top else file).attrs["data_id"] = "id7"
    return path


def robomimic(root: Path) -> Path:
    """Two demonstrations of one file."""
    arrays: dict[str, Any] = {"mask/train": np.array([b"demo_0", b"demo_1"])}
    for i in range(2):
        arrays |= {
            f"data/demo_{i}/actions": np.ones((6, 7)),
            f"data/demo_{i}/obs/robot0_eef_pos": np.ones((6, 3)),
            f"data/demo_{i}/obs/agentview_image": pictures(6, 24, 32, 3, seed=i),
            f"data/demo_{i}/obs/tactile_left": pictures(6, 24, 32, 3, seed=i + 2),
            f"data/demo_{i}/obs/right_tactile_image": pictures(6, 24, 32, 3, seed=i + 4),
        }
    return write_hdf5(root / "demo.hdf5", arrays)


def htt(root: Path) -> Path:
    """A slide with labels of slip, and a press of the same probe without."""
    rng = np.random.default_rng(14)
    for part, mode in (("slip", "sliding"), ("force", "static")):
        folder = root / part / "gsmini/processed/p1_sphere"
        folder.mkdir(parents=True)
        force = rng.normal(0, 0.1, (6, 6)).astype("f4")
        force[:, 2] -= 3
        np.savez(
            folder / "a.npz",
            **{
                "tactile_img": pictures(6, 24, 32, 3, seed=len(part)),
                "6d_force": force,
                "ref_frame": np.full((24, 32, 3), 100.4, "f4"),
                "ref_force": np.arange(6, dtype="f4"),
                "probe": np.int64(1),
                "mode": np.array(mode),
            },
        )
    labels = root / "slip/gsmini/sliding_labeled/p1_sphere"
    labels.mkdir(parents=True)
    np.savez(
        labels / "a.labeled.npz",
        sliding_labels_bracket=np.array([0, 0, 1, 1, 2, 2]),
        sliding_labels=np.array([0, 0, 0, 1, 2, 2]),
        sliding_labels_signature=np.array([0, 1, 1, 1, 2, 2]),
        mus=np.linspace(0, 1, 6),
        fz=np.linspace(1, 2, 6),
        n0=np.float64(3),
        labeling_meta=np.array("{}"),
    )
    return root


def tarred(folder: Path, archive: Path, names: list[str]) -> Path:
    """A tar of a folder, its members in the order of the names backwards."""
    with tarfile.open(archive, "w") as file:
        for path in sorted(folder.rglob("*"), reverse=True):
            if path.is_file():
                file.add(path, "/".join([*names, path.relative_to(folder).as_posix()]))
    return archive


#: Makers of one file or more, by the preset that reads them, and further options.
FORMATS: dict[str, tuple[Callable[[Path], Path], dict[str, Any]]] = {
    "open_x_tactile": (open_x_tactile, {"fps": 10}),
    "univtac": (univtac, {}),
    "reactive_diffusion": (reactive_diffusion, {"sensors": {"mctac": "digit"}}),
    "vitamin_b": (vitamin_b, {"sensors": {"any": "digit"}}),
    "touch_in_the_wild": (touch_in_the_wild, {"span": 1.0}),
    "manifeel": (manifeel, {}),
    "freetacman": (freetacman, {"sensors": {"any": "digit"}}),
    "aloha": (aloha, {"sensors": {"any": "gelsight_mini"}, "fps": 50}),
    "robomimic": (robomimic, {"sensors": {"any": "digit"}}),
    "vtouch": (vtouch, {"sensors": {"any": "digit"}}),
    "omnisharing": (omnisharing, {"span": 2.0}),
    "htt": (htt, {"fps": 25}),
}
