"""Damaged and contradictory files: named, counted, and the rest is read."""

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from bomb import Bomb
from made_sets import MADE, feats, film_row, save_avi, save_press, save_table, save_tar, single_row
from pyarrow import parquet as arrow_parquet
from tactileforge_datasets.feats import Feats
from tactileforge_datasets.fota import FoTa
from tactileforge_datasets.tactile_mnist import TactileMnist
from tactileforge_datasets.unitac_nv import UniTacNv

from tactileforge.plugin import ConfigError, DataError
from tactileforge.plugins import registry

#: The first file of labels or pictures of each set.
FILES = {
    "feats": "labels/train/cross_1.npy",
    "feelanyforce": "records/toy/tactile/1000.png",
    "fota": "toy_Mini_Wedge_init_pose_1_labeled_left/train/data-000000.tar",
    "gelsight_mini_pretrain": "feats/train-00000-of-00001.parquet",
    "gelslam": "reconstruction_dataset/rock/gelsight.avi",
    "tactile_mnist": "data/train-00000-of-00001.parquet",
    "tactile_tracking": "avocado1/gelsight.avi",
    "unitac_nv": "square_PLA/xela/sensor_data_20250101_120000.csv",
}


def read_all(name: str, root: Path, **options):
    """Recordings of all sides, and the skipped files."""
    reader = registry.get("datasets", name)
    data = reader(str(root), split="all", val=0, **options)
    try:
        return list(data.recordings("train")), data.skipped
    except DataError:
        return [], data.skipped


@pytest.mark.parametrize("damage", ["empty", "half", "noise", "pipe", "folder"])
@pytest.mark.parametrize("name", MADE)
def test_a_damaged_file_is_skipped_and_named_and_the_rest_is_read(name, damage, make) -> None:
    root = make(name)
    whole = {one.key for one in read_all(name, root)[0]}
    path = root / FILES[name]
    content = path.read_bytes()
    damaged = {"empty": b"", "half": content[: len(content) // 2], "noise": os.urandom(500)}
    if damage in ("pipe", "folder"):
        path.unlink()
        (os.mkfifo if damage == "pipe" else os.mkdir)(path)
    else:
        path.write_bytes(damaged[damage])
    recordings, said = read_all(name, root)
    good = set()
    for one in recordings:
        try:
            one.frames.read(range(len(one.frames)))
            good.add(one.key)
        except DataError as error:
            said.append(str(error))
    assert [line for line in said if path.name in line and "\n" not in line]
    assert good
    assert good < whole


def test_a_missing_key_is_named_with_the_nearest(tmp_path: Path) -> None:
    feats(tmp_path)
    save_press(
        tmp_path / "labels/train/bad_9.npy",
        1,
        dict.fromkeys(("grid_x", "grid_y", "grid_zz"), np.zeros((6, 8))),
    )
    data = Feats(str(tmp_path))
    assert len(list(data.recordings("train"))) == 2
    assert "bad_9.npy: unknown key 'grid_z'; did you mean 'grid_zz'?" in data.skipped[0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"grid_z": np.zeros((6, 7))}, r"grid_z has shape \(6, 7\), where \(6, 8\) belongs"),
        ({"grid_x": np.zeros(6)}, r"grid_x has shape \(6,\), where \(any, any\) belongs"),
        ({"gs_img": np.zeros((24, 32, 3))}, r"gs_img is float64 \(24, 32, 3\), where uint8"),
        ({"f_z": -50.0}, "f_x, f_y, f_z are .*the sums of their cells"),
        ({"f_x": float("nan")}, "f_x has values that are not numbers"),
    ],
)
def test_presses_that_contradict_themselves(change, said, tmp_path: Path) -> None:
    feats(tmp_path)
    grids = dict.fromkeys(("grid_x", "grid_y", "grid_z"), np.zeros((6, 8)))
    save_press(tmp_path / "labels/train/bad_9.npy", 1, grids, **change)
    data = Feats(str(tmp_path))
    assert len(list(data.recordings("train"))) == 2
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(data.skipped[0])


def test_nothing_in_a_pickle_is_executed(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    feats(tmp_path)
    np.save("labels/train/bad_9.npy", {"gs_img": Bomb(Path("bomb"))})
    Path("labels/train/worse_9.npy").write_bytes(pickle.dumps(Bomb(Path("bomb"))))
    data = Feats(str(tmp_path))
    assert len(list(data.recordings("train"))) == 2
    assert len(data.skipped) == 2
    assert "nothing in the file was executed" in data.skipped[0]
    assert not Path("bomb").exists()


def test_paths_that_lead_out_are_refused(make) -> None:
    root = make("feelanyforce")
    table = root / "TacForce_train_set.csv"
    table.write_text(table.read_text().replace("records/toy/tactile/1000.png", "../secret.png"))
    rest, skipped = read_all("feelanyforce", root)
    assert len(rest) == 8
    assert "'../secret.png' is not a path inside of" in skipped[0]


@pytest.mark.parametrize("cell", ["1 2 3", "1 2 x 0 0 0", "", "nan 0 1 0 0 0"])
def test_a_wrench_that_is_none_is_named(cell, make) -> None:
    root = make("feelanyforce")
    table = root / "TacForce_train_set.csv"
    table.write_text(table.read_text().replace("0.100000 -0.200000 1.500000 0 0 0.25", cell))
    rest, skipped = read_all("feelanyforce", root)
    assert len(rest) == 8
    assert "TacForce_train_set.csv, row 3: FT" in skipped[0]


def test_a_missing_column_names_the_nearest(make, tmp_path: Path) -> None:
    root = make("feelanyforce")
    table = root / "TacForce_train_set.csv"
    table.write_text(table.read_text().replace("tactile,depth,FT", "tactil,depth,FT"))
    with pytest.raises(ConfigError, match="unknown column 'tactile'; did you mean 'tactil'"):
        read_all("feelanyforce", root)
    row = single_row(0)
    row["labell"] = row.pop("label")
    save_table(tmp_path / "m/train-0.parquet", [row])
    assert (
        "unknown column 'label'; did you mean 'labell'?"
        in read_all("tactile_mnist", tmp_path / "m")[1][0]
    )


def test_other_numbers_of_poses_and_frames(make) -> None:
    root = make("tactile_tracking")
    np.save(root / "avocado1/true_start_T_currs.npy", np.zeros((7, 4, 4)))
    np.save(root / "avocado2/true_start_T_currs.npy", np.zeros((8, 3, 4)))
    rest, skipped = read_all("tactile_tracking", root)
    assert [one.object for one in rest] == ["nut"]
    assert "8 frames of gelsight.avi, 7 poses" in skipped[0]
    assert "has shape (8, 3, 4), where (any, 4, 4) belongs" in skipped[1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"time_stamp_rel_seq": [[0.0, 0.04, 0.04, 0.08]]},
            "the time of row 2, 0.040000 s, is not after",
        ),
        ({"time_stamp_rel_seq": [[0.0, 0.08, 0.04, 0.12]]}, "the time of row 2"),
        ({"video_length_frames": [5]}, "video_length_frames is 5, with 4 times"),
        ({"video_length_frames": [0]}, "video_length_frames is 0"),
        (
            {"gel_pose_cell_frame_seq.position": [[[0.0, 0.0]] * 4]},
            "has shape (4, 2), where (4, 3)",
        ),
    ],
)
def test_films_that_contradict_themselves(change, said, tmp_path: Path) -> None:
    save_table(tmp_path / "train-0.parquet", [film_row(0, (4,)), film_row(1, (4,)) | change])
    rest, skipped = read_all("tactile_mnist", tmp_path)
    assert len(rest) == 1
    assert said in skipped[0]


def test_a_film_shorter_than_its_table_is_named_when_it_is_read(tmp_path: Path) -> None:
    row = film_row(0, (4,))
    row["sensor_video"] = film_row(0, (3,))["sensor_video"]
    save_table(tmp_path / "train-0.parquet", [row])
    (one,) = read_all("tactile_mnist", tmp_path)[0]
    with pytest.raises(DataError, match="the video has 3 frames, the table 4"):
        one.frames.read([0])


def test_a_row_without_a_picture_is_named(tmp_path: Path) -> None:
    row = single_row(0)
    row["sensor_image"] = [None, *row["sensor_image"][1:]]
    save_table(tmp_path / "train-0.parquet", [row])
    one = read_all("tactile_mnist", tmp_path)[0][0]
    with pytest.raises(DataError, match=r"row 0, touch 0: no bytes of a picture"):
        one.frames.read([0])


def test_a_damaged_column_is_named_when_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "train-0.parquet"
    save_table(path, [single_row(i) for i in range(4)])
    group = arrow_parquet.ParquetFile(path).metadata.row_group(1)
    columns = [group.column(i) for i in range(group.num_columns)]
    start = next(c.data_page_offset for c in columns if c.path_in_schema.endswith("bytes"))
    content = bytearray(path.read_bytes())
    content[start : start + 40] = b"\xff" * 40
    path.write_bytes(content)
    touches = read_all("tactile_mnist", tmp_path)[0]
    assert touches[0].frames.read([0]).shape == (1, 24, 32, 3)
    with pytest.raises(DataError, match=r"train-0\.parquet: no parquet file, or damaged"):
        touches[-1].frames.read([0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("12:00:00.150000", "12:00:00.140000", "is not after that of the row before"),
        ("12:00:00.150000", "12:00:00.100001", "is not after that of the row before"),
        ("2025-01-01 12:00:00.150000", "yesterday", "row 15: not a time and four lists"),
        ('"[0.3, 0.1, 0.185', '"[__import__(1), 0.1, 0.185', "row 15: not a time and four lists"),
        ('"[0.3, 0.1, 0.185', '"[0.3, 0.185', "pose is not numbers of one shape"),
        (",15,", ",", "row 15: 5 cells, where 6 belong"),
    ],
)
def test_rows_of_taxels_that_are_wrong(old, new, said, make) -> None:
    root = make("unitac_nv")
    path = root / FILES["unitac_nv"]
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    rest, skipped = read_all("unitac_nv", root)
    assert len(rest) == 3
    assert said in skipped[0]


def test_taxels_of_another_array(make) -> None:
    root = make("unitac_nv")
    other = root / "square_PLA/papillarray/sensor_data_20250101_120000.csv"
    (root / FILES["unitac_nv"]).write_bytes(other.read_bytes())
    skipped = read_all("unitac_nv", root)[1]
    assert "force has shape (14, 3, 3, 3), where (14, 4, 6, 3) belongs" in skipped[0]
    with pytest.raises(ConfigError, match="drop is -1"):
        UniTacNv(".", drop=-1)
    assert "no row after the first 99" in read_all("unitac_nv", root, drop=99)[1][0]


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"x_mm": 1.0}, "a pose without y_mm, z_mm"),
        (
            dict.fromkeys(("x_mm", "y_mm", "z_mm", "quat_x", "quat_y", "quat_z", "quat_w"), "a"),
            "the pose is not numbers",
        ),
        ([1], "a json of list"),
    ],
)
def test_descriptions_of_fota_that_are_none(said, why, tmp_path: Path) -> None:
    save_tar(tmp_path / "a_Mini_Mini_init_pose_0_left/train/data-0.tar", [{}, said])
    data = FoTa(str(tmp_path))
    assert len(list(data.recordings("train"))) == 1
    assert why in data.skipped[0]


def test_an_unknown_source_is_named(make) -> None:
    root = make("gelsight_mini_pretrain")
    with pytest.raises(ConfigError, match="unknown source 'feat'; did you mean 'feats'"):
        read_all("gelsight_mini_pretrain", root, sources=["feat"])


def test_an_empty_film_is_skipped(make) -> None:
    root = make("gelslam")
    save_avi(root / "reconstruction_dataset/rock/gelsight.avi", 0)
    (root / "reconstruction_dataset/peanut/config.yaml").write_text("ppmm: wide\n")
    rest, skipped = read_all("gelslam", root)
    assert [one.object for one in rest] == ["ball_6.31_mm"] * 3
    assert "peanut/config.yaml: ppmm is 'wide'" in skipped[0]
    assert "rock/gelsight.avi" in skipped[1]


def test_every_form_is_here() -> None:
    assert set(FILES) == set(MADE)
    assert TactileMnist.name in FILES
