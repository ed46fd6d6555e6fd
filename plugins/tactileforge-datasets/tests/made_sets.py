"""Small data sets of each form, as they are published; every picture is of level 7 i."""

import csv
import json
import tarfile
from io import BytesIO
from pathlib import Path

import av
import numpy as np
import pyarrow as arrow
from PIL import Image
from pyarrow import parquet
from videos import greys, write_video

SIZE = (24, 32)


def picture(i: int) -> np.ndarray:
    return np.full((*SIZE, 3), min(7 * i, 255), np.uint8)


def encoded(i: int, kind: str = "PNG") -> bytes:
    buffer = BytesIO()
    Image.fromarray(picture(i)).save(buffer, kind)
    return buffer.getvalue()


def save_picture(path: Path, i: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encoded(i))


def save_avi(path: Path, count: int, size: tuple[int, int] = SIZE, fps: float = 25) -> None:
    write_video(path, greys(count, 7, size), fps)


def mp4(count: int, first: int = 0) -> bytes:
    buffer = BytesIO()
    with av.open(buffer, "w", format="mp4") as file:
        stream = file.add_stream("mpeg4", rate=25)
        stream.height, stream.width = SIZE
        stream.pix_fmt = "yuv420p"
        stream.bit_rate = 2_000_000
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(picture(first + i), format="rgb24")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return buffer.getvalue()


def feats(root: Path) -> Path:
    for number, (side, name) in enumerate(
        [("train", "sphere_0"), ("train", "cross_1"), ("val", "ring_2"), ("test", "sphere_3")]
    ):
        rng = np.random.default_rng(number)
        grids = dict(
            zip(("grid_x", "grid_y", "grid_z"), rng.normal(0, 0.1, (3, 6, 8)), strict=True)
        )
        grids["grid_z"] = -np.abs(grids["grid_z"])
        save_press(root / f"labels/{side}/{name}.npy", number, grids)
    (root / "labels/.gitignore").write_text("*")
    np.save(root / "labels/normalization_01012025_000000.npy", {"f_x": {"min": 0.0}})
    np.save(root / "labels/train/normalization_01012025_000000.npy", {"f_x": {"min": 0.0}})
    return root


def save_press(path: Path, i: int, grids: dict[str, np.ndarray], **other: object) -> None:
    sums = {f"f_{name[-1]}": grid.sum() for name, grid in grids.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, {"gs_img": picture(i), **grids, **sums, **other})  # type: ignore[arg-type]


def feelanyforce(root: Path) -> Path:
    for side, name, sign in (("train", "toy", 1), ("val", "ball_7", 1), ("test", "nut", 1)):
        rows = [",,"]
        save_picture(root / f"records/{name}/background.png", 20)
        for i in range(3):
            tactile = f"records/{name}/tactile/{1000 + i}.png"
            depth = f"records/{name}/depth/{1000 + i}.npy"
            save_picture(root / tactile, i)
            (root / depth).parent.mkdir(exist_ok=True)
            np.save(root / depth, np.full(SIZE, i / 2))
            rows.insert(i, f"{tactile},{depth},{0.1 * i:.6f} -0.200000 {sign * 1.5:.6f} 0 0 0.25")
        (root / f"TacForce_{side}_set.csv").write_text(
            "\n".join(["tactile,depth,FT", *rows]) + "\n"
        )
    return root


def tactile_tracking(root: Path) -> Path:
    for name in ("avocado1", "avocado2", "nut1"):
        save_avi(root / name / "gelsight.avi", 8)
        save_avi(root / name / "webcam.avi", 4, (36, 48))
        poses = np.tile(np.eye(4), (8, 1, 1))
        poses[:, 0, 3] = np.arange(8) / 1000
        np.save(root / name / "true_start_T_currs.npy", poses)
        np.save(root / name / "contact_masks.npy", np.zeros((8, *SIZE), bool))
        np.save(root / name / "gradient_maps.npy", np.zeros((8, *SIZE, 2), np.float32))
    return root


def gelslam(root: Path) -> Path:
    for name in ("rock", "peanut"):
        place = root / "reconstruction_dataset" / name
        save_avi(place / "gelsight.avi", 14)
        (place / "config.yaml").write_text(
            "device_name: GelSight Mini\nppmm: 0.0634\nimgh: 240\nimgw: 320\nframerate: 25\n"
        )
    cells = ["experiment_reldir,diameter(mm)"]
    for i in range(3):
        save_picture(root / f"calibration/6.310mm/{i}/gelsight.png", i)
        cells.append(f"6.310mm/{i},6.31")
    save_picture(root / "calibration/background.png", 9)
    (root / "calibration/catalog.csv").write_text("\n".join(cells) + "\n")
    return root


def tactile_mnist(root: Path) -> Path:
    rows = [single_row(number) for number in range(3)]
    save_table(root / "data/train-00000-of-00001.parquet", rows[:2])
    save_table(root / "data/test-00000-of-00001.parquet", rows[2:])
    return root


def single_row(number: int, touches: int = 4) -> dict[str, object]:
    return {
        "id": f"print_{number}",
        "label": number,
        "object_id": number,
        "pos_in_cell": [[0.01 * i, 0.02] for i in range(touches)],
        "gel_pose_cell_frame": {
            "position": [[0.0, 0.1, 0.01 * i] for i in range(touches)],
            "quaternion": [[0.0, 0.0, 0.0, 1.0]] * touches,
        },
        "sensor_image": [
            {"bytes": encoded(4 * number + i), "path": f"{i}.png"} for i in range(touches)
        ],
    }


def film_row(number: int, lengths: tuple[int, ...] = (4, 6)) -> dict[str, object]:
    longest = max(lengths)
    return {
        "id": f"print_{number}",
        "label": number,
        "object_id": number,
        "sensor_video": [{"bytes": mp4(longest), "path": f"{i}.mp4"} for i in range(len(lengths))],
        "video_length_frames": list(lengths),
        "time_stamp_rel_seq": [
            [0.04 * i if i < length else 0.0 for i in range(longest)] for length in lengths
        ],
        "gel_pose_cell_frame_seq.position": [[[0.0, 0.1, 0.2]] * longest for _ in lengths],
        "gel_pose_cell_frame_seq.quaternion": [[[0.0, 0.0, 0.0, 1.0]] * longest for _ in lengths],
        "touch_start_time_rel": [0.08] * len(lengths),
        "touch_end_time_rel": [0.12] * len(lengths),
    }


def save_table(path: Path, rows: list[dict[str, object]], group: int = 2) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.Table.from_pylist(rows), path, row_group_size=group)


def gelsight_mini_pretrain(root: Path) -> Path:
    empty = dict.fromkeys(("f_x", "f_y", "f_z", "x_mm", "y_mm", "z_mm"), None)
    common = {"image_format": "jpeg", "domain": "real", "markered": False, "split": "train"}
    rows = [
        {
            **common,
            "image": encoded(i, "JPEG"),
            "source": "feats",
            "indenter": ("ring", "cube")[i % 2],
            "indenter_param": "5mm",
            "obj_name": None,
            "markered": True,
            **dict(zip(empty, (0.1, -0.2, -1.0 - i), strict=False)),
        }
        for i in range(5)
    ]
    save_table(root / "feats/train-00000-of-00001.parquet", rows)
    save_table(root / "feats/test_unknown_indenters-00000-of-00001.parquet", rows[:2])
    poses = [
        {
            **common,
            "image": encoded(10 + i, "JPEG"),
            "source": "fota_labeled",
            "obj_name": f"pen_{i}",
            "side": "left",
            "init_pose": i,
            "x_mm": 1.0 * i,
            "y_mm": 2.0,
            "z_mm": -3.0,
            **dict.fromkeys(("quat_x", "quat_y", "quat_z"), 0.0),
            "quat_w": 1.0,
        }
        for i in range(3)
    ]
    save_table(root / "fota_labeled/train-00000-of-00001.parquet", poses)
    return root


def fota(root: Path) -> Path:
    place = {"desc": "smooth", "x_mm": 1.0, "y_mm": 2.0, "z_mm": -3.0}
    pose = place | {"quat_x": 0.0, "quat_y": 0.0, "quat_z": 0.0, "quat_w": 1.0}
    for folder, side, text in (
        ("toy_Mini_Wedge_init_pose_1_labeled_left", "train", pose),
        ("nut_Mini_Mini_init_pose_2_labeled_right", "val", pose),
        ("toy_Mini_Wedge_init_pose_1_labeled_right", "train", pose),
    ):
        save_tar(root / folder / side / "data-000000.tar", [text] * 3)
    return root


def save_tar(path: Path, said: list[dict[str, object]], kind: str = "JPEG") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    (path.parent / "count.txt").write_text(str(len(said)))
    with tarfile.open(path, "w") as tar:
        for i, values in enumerate(said):
            for ending, content in (
                ("jpg", encoded(i, kind)),
                ("json", json.dumps(values).encode()),
            ):
                member = tarfile.TarInfo(f"{i:06d}.{ending}")
                member.size = len(content)
                tar.addfile(member, BytesIO(content))


def unitac_nv(root: Path) -> Path:
    for folder in ("square_PLA", "hexagonal_TPU"):
        for array, shape in (("xela", (4, 6, 3)), ("papillarray", (3, 3, 3))):
            save_taxels(root / folder / array / "sensor_data_20250101_120000.csv", shape)
    return root


def save_taxels(path: Path, shape: tuple[int, int, int], count: int = 24) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["time", "n", "force", "disp", "ft", "pose"])
        for i in range(count):
            press = max(0, i - 17)
            lines.writerow(
                [
                    f"2025-01-01 12:00:00.{10_000 * i:06d}",
                    i,
                    np.full(shape, (0.1 if shape[0] == 3 else 200) * press).round(3).tolist(),
                    np.full(shape, 0.01 * press).round(3).tolist(),
                    [0.5 + press, 0.0, -2.0 - 3.0 * press, 0.1, 0.0, 0.0],
                    [0.3, 0.1, 0.2 - 0.001 * i, 0.0, 3.14, 0.0],
                ]
            )


MADE = {
    "feats": feats,
    "feelanyforce": feelanyforce,
    "fota": fota,
    "gelsight_mini_pretrain": gelsight_mini_pretrain,
    "gelslam": gelslam,
    "tactile_mnist": tactile_mnist,
    "tactile_tracking": tactile_tracking,
    "unitac_nv": unitac_nv,
}
