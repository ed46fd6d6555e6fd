"""Every field of every set, against the written values."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from made_sets import film_row, gelsight_mini_pretrain, save_table, tactile_mnist
from tactileforge_datasets.feats import Feats
from tactileforge_datasets.feelanyforce import FeelAnyForce
from tactileforge_datasets.fota import FoTa
from tactileforge_datasets.gelsight_mini_pretrain import GelSightMiniPretrain
from tactileforge_datasets.gelslam import GelSlam
from tactileforge_datasets.tactile_mnist import TactileMnist
from tactileforge_datasets.tactile_tracking import TactileTracking
from tactileforge_datasets.unitac_nv import UniTacNv

from tactileforge.plugin import load_pickled_array


def sides(data):
    return {side: list(data.recordings(side)) for side in ("train", "val", "test")}


def test_feats(make, levels) -> None:
    root = make("feats")
    found = sides(Feats(str(root)))
    assert {side: [one.key for one in all_] for side, all_ in found.items()} == {
        "train": ["feats/train/cross_1", "feats/train/sphere_0"],
        "val": ["feats/val/ring_2"],
        "test": ["feats/test/sphere_3"],
    }
    cross = found["train"][0]
    sample = load_pickled_array(root / "labels/train/cross_1.npy")
    wanted = [sample["grid_x"].sum(), sample["grid_y"].sum(), -sample["grid_z"].sum()]
    np.testing.assert_allclose(cross.force, [wanted], rtol=1e-6)
    assert cross.force[0, 2] > 0
    assert cross.tracks["force_map"].shape == (1, 6, 8, 3)
    np.testing.assert_allclose(cross.tracks["force_map"][0].sum((0, 1)), wanted, rtol=1e-5)
    np.testing.assert_allclose(cross.tracks["force_map"][0, ..., 2], -sample["grid_z"], rtol=1e-6)
    assert (cross.object, cross.sensor, cross.tier) == ("feats_cross", "gelsight_mini", 1)
    assert levels(cross.frames) == [1]
    assert cross.no_contact is None
    assert len(list(Feats(str(root / "labels"), "all", val=0).recordings("train"))) == 4


def test_feelanyforce(make, levels) -> None:
    root = make("feelanyforce")
    found = sides(FeelAnyForce(str(root), depth=True))
    assert {side: len(all_) for side, all_ in found.items()} == {"train": 3, "val": 3, "test": 3}
    press = found["train"][2]
    assert press.key == "feelanyforce/records/toy/tactile/1002"
    np.testing.assert_allclose(press.force, [[0.2, -0.2, 1.5]], rtol=1e-6)
    np.testing.assert_allclose(press.tracks["torque"], [[0, 0, 0.25]])
    np.testing.assert_allclose(press.tracks["depth"], np.ones((1, 24, 32)))
    assert press.labels == {"unix_ms": 1002}
    assert (press.object, levels(press.frames)) == ("feelanyforce_toy", [2])
    assert levels(press.no_contact) == [20]
    assert found["val"][0].object == "feelanyforce_ball"
    assert "depth" not in next(iter(FeelAnyForce(str(root)).recordings("train"))).tracks


def test_a_source_that_pulls_is_turned(make) -> None:
    root = make("feelanyforce")
    for path in root.glob("*.csv"):
        path.write_text(path.read_text().replace(" 1.500000", " -1.500000"))
    press = next(iter(FeelAnyForce(str(root)).recordings("train")))
    np.testing.assert_allclose(press.force, [[0, -0.2, 1.5]], rtol=1e-6)


def test_tactile_tracking(make, levels) -> None:
    data = TactileTracking(str(make("tactile_tracking")), val=0)
    trials = list(data.recordings("train"))
    assert [trial.object for trial in trials] == ["avocado", "avocado", "nut"]
    trial = trials[0]
    assert trial.key == "tactile_tracking/avocado1"
    assert levels(trial.frames) == list(range(8))
    np.testing.assert_allclose(trial.times, np.arange(8) / 25, atol=1e-6)
    assert trial.tracks["pose"].shape == (8, 4, 4)
    np.testing.assert_allclose(trial.tracks["pose"][:, 0, 3], np.arange(8) / 1000)
    assert (len(trial.image), trial.image.shape) == (4, (36, 48))
    assert (trial.no_contact, trial.licence) == (None, "MIT")


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_trials_of_one_object_are_held_out_together(make, share) -> None:
    root = make("tactile_tracking")
    for i in range(6):
        shutil.copytree(root / "nut1", root / f"part{'abcdef'[i]}1")
        shutil.copytree(root / "nut1", root / f"part{'abcdef'[i]}2")
    train, val = (
        {one.object for one in TactileTracking(str(root), val=share).recordings(side)}
        for side in ("train", "val")
    )
    assert train
    assert val
    assert not train & val
    assert len(train | val) == 8


def test_gelslam(make, levels) -> None:
    recordings = {one.key: one for one in GelSlam(str(make("gelslam")), val=0).recordings("train")}
    assert [key.removeprefix("gelslam/") for key in recordings] == [
        "reconstruction_dataset/peanut",
        "reconstruction_dataset/rock",
        *(f"calibration/6.310mm/{i}" for i in range(3)),
    ]
    rock = recordings["gelslam/reconstruction_dataset/rock"]
    assert (rock.object, rock.labels) == ("rock", {"mm_per_pixel": 0.0634})
    assert levels(rock.frames) == list(range(14))
    assert levels(rock.no_contact) == list(range(10))
    np.testing.assert_allclose(rock.times, np.arange(14) / 25, atol=1e-6)
    press = recordings["gelslam/calibration/6.310mm/2"]
    assert (press.object, press.labels) == ("ball_6.31_mm", {"ball_diameter_mm": 6.31})
    assert (levels(press.frames), levels(press.no_contact)) == ([2], [9])


def test_tactile_mnist(make, levels) -> None:
    found = sides(TactileMnist(str(make("tactile_mnist")), val=0))
    assert {side: len(all_) for side, all_ in found.items()} == {"train": 8, "val": 0, "test": 4}
    touch = found["train"][6]
    assert touch.key == "tactile_mnist/train/print_1/2"
    assert (touch.object, touch.labels) == ("tactile_mnist_1", {"digit": 1})
    assert levels(touch.frames) == [6]
    np.testing.assert_allclose(touch.tracks["pose"], [[0, 0.1, 0.02, 0, 0, 0, 1]], rtol=1e-6)
    np.testing.assert_allclose(touch.tracks["pos_in_cell"], [[0.02, 0.02]], rtol=1e-6)
    assert touch.no_contact is None


def test_films_of_tactile_mnist_are_cut_to_their_length(tmp_path: Path, levels) -> None:
    save_table(tmp_path / "train-00000.parquet", [film_row(3)])
    short, long = TactileMnist(str(tmp_path), val=0).recordings("train")
    assert (len(short.frames), len(long.frames)) == (4, 6)
    np.testing.assert_allclose(short.times, np.arange(4) * 0.04)
    assert short.tracks["pose"].shape == (4, 7)
    np.testing.assert_allclose(short.tracks["pose"][3], [0, 0.1, 0.2, 0, 0, 0, 1], rtol=1e-6)
    assert levels(short.frames) == [0, 1, 2, 3]
    assert levels(short.no_contact) == [0, 1], "the frames before the touch"
    assert short.object == "tactile_mnist_3"


def test_gelsight_mini_pretrain(make, levels) -> None:
    root = make("gelsight_mini_pretrain")
    found = sides(GelSightMiniPretrain(str(root), val=0))
    assert {side: len(all_) for side, all_ in found.items()} == {"train": 8, "val": 0, "test": 2}
    press, pen = found["train"][3], found["train"][6]
    assert press.key == "gelsight_mini_pretrain/feats/train-00000-of-00001/3"
    np.testing.assert_allclose(press.force, [[0.1, -0.2, 4]], rtol=1e-6)
    assert press.object == "feats_cube"
    assert press.labels == {
        "source": "feats",
        "domain": "real",
        "indenter_param": "5mm",
        "markered": 1.0,
    }
    assert (press.licence, press.tracks, levels(press.frames)) == ("MIT", {}, [3])
    np.testing.assert_allclose(pen.tracks["pose"], [[0.001, 0.002, -0.003, 0, 0, 0, 1]], rtol=1e-6)
    assert (pen.force, pen.object, pen.labels["side"]) == (None, "fota_labeled_pen_1", "left")


def test_the_order_of_colours_is_an_option_by_source(tmp_path: Path) -> None:
    from io import BytesIO

    from PIL import Image

    root = gelsight_mini_pretrain(tmp_path)
    buffer = BytesIO()
    Image.new("RGB", (32, 24), (200, 100, 0)).save(buffer, "PNG")
    row = {"image": buffer.getvalue(), "source": "unit", "obj_name": "a", "markered": True}
    save_table(root / "unit/train-0.parquet", [row])
    for bgr, wanted in (([], [200, 100, 0]), (["unit"], [0, 100, 200])):
        data = GelSightMiniPretrain(str(root), val=0, sources=["unit"], bgr=bgr)
        (one,) = data.recordings("train")
        assert one.frames.read([0])[0, 0, 0].tolist() == wanted
        assert one.licence == "BSD-3-Clause style"


def test_fota(make, levels) -> None:
    root = make("fota")
    data = FoTa(str(root))
    found = sides_of(data)
    assert {side: len(all_) for side, all_ in found.items()} == {"train": 3, "val": 3}
    frame = found["train"][1]
    assert frame.key == "fota/toy_Mini_Wedge_init_pose_1_labeled_left/train/data-000000/000001"
    assert (frame.sensor, frame.object) == ("gelsight_mini", "toy")
    np.testing.assert_allclose(
        frame.tracks["pose"], [[0.001, 0.002, -0.003, 0, 0, 0, 1]], rtol=1e-6
    )
    assert levels(frame.frames) == [1]
    assert data.skipped == [
        f"{root}/toy_Mini_Wedge_init_pose_1_labeled_right: the sensor 'Wedge' has no type here; "
        "give data.types.Wedge=TYPE"
    ]
    typed = FoTa(str(root), types={"Wedge": "gelsight"})
    assert [one.sensor for one in typed.recordings("train")].count("gelsight") == 3
    assert typed.skipped == []


def test_what_frames_of_fota_show(tmp_path: Path) -> None:
    from made_sets import save_tar

    said = [
        {"has_contact": True, "contact_class": 3, "contact_name": "nut"},
        {"is_gripping": False, "object_name": "cup"},
        {"desc": "smooth"},
    ]
    save_tar(tmp_path / "a_Mini_Mini_init_pose_0_left/train/data_000000.tar", said)
    one, two, three = FoTa(str(tmp_path)).recordings("train")
    assert (one.object, one.labels) == ("nut", {"has_contact": 1, "contact_class": 3})
    assert (two.object, two.labels, two.tracks) == ("cup", {"is_gripping": 0}, {})
    assert (three.object, three.text) == ("a", "smooth")


def sides_of(data):
    return {side: list(data.recordings(side)) for side in ("train", "val")}


def test_unitac_nv(make) -> None:
    recordings = list(UniTacNv(str(make("unitac_nv")), val=0, drop=10).recordings("train"))
    assert [one.key.split("/")[1:3] for one in recordings] == [
        ["hexagonal_TPU", "papillarray"],
        ["hexagonal_TPU", "xela"],
        ["square_PLA", "papillarray"],
        ["square_PLA", "xela"],
    ]
    tip, pad = recordings[2:]
    assert (tip.object, tip.labels) == (
        "unitac_square",
        {"material": "PLA", "array": "papillarray"},
    )
    np.testing.assert_allclose(tip.times, np.arange(14) / 100, atol=1e-9)
    assert (tip.frames.shape, pad.frames.shape) == ((24, 24), (32, 48))
    press = np.maximum(0, np.arange(10, 24) - 17)
    np.testing.assert_allclose(tip.tracks["taxels"][:, 1, 2], press[:, None] * [-0.1, -0.1, 0.1])
    np.testing.assert_allclose(pad.tracks["taxels"][:, 3, 5], np.outer(press, [200] * 3), rtol=1e-6)
    np.testing.assert_allclose(tip.tracks["displacement"][:, 0, 0, 2], 0.01 * press, rtol=1e-6)
    assert "displacement" not in pad.tracks
    np.testing.assert_allclose(tip.force[:, 2], 3.0 * press, rtol=1e-5)
    shear = press / np.sqrt(2)
    np.testing.assert_allclose(tip.force[:, :2], np.stack([shear, shear], 1), rtol=1e-5)
    assert tip.tracks["torque"].shape == (14, 3)
    np.testing.assert_allclose(tip.tracks["pose"][:, 2], 0.2 - 0.001 * np.arange(10, 24), rtol=1e-6)
    assert len(tip.no_contact) == 3
    colours = tip.frames.read([0, 13])[:, 0, 0].astype(int)
    assert (np.sign(colours[1] - colours[0]) == [-1, -1, 1]).all(), "red, green, blue are x, y, z"


def test_a_row_of_touches_is_read_once(make, monkeypatch) -> None:
    from tactileforge_datasets import parquet

    root = make("tactile_mnist")
    made = tactile_mnist(root)
    assert made == root
    converted = []
    original = parquet._Cursor.cell

    def counted(self, row):
        before = self.last
        value = original(self, row)
        converted.append(row != before)
        return value

    monkeypatch.setattr(parquet._Cursor, "cell", counted)
    for touch in TactileMnist(str(root), val=0).recordings("train"):
        touch.frames.read([0])
    assert sum(converted) == 2


@pytest.mark.realdata
def test_real_ball_presses_of_gelslam(realdata: Path) -> None:
    data = GelSlam(str(realdata / "gelslam_mini"), val=0)
    assert GelSlam.recognise(realdata / "gelslam_mini") is not None
    presses = list(data.recordings("train"))
    assert data.skipped == []
    assert len(presses) == 67
    assert {one.labels["ball_diameter_mm"] for one in presses} == {6.31, 9.5}
    for one in presses[::10]:
        assert one.frames.shape == (240, 320)
        change = np.abs(one.frames.read([0])[0].astype(int) - one.background())
        assert change.max() > 30, "a ball is seen against the background"
