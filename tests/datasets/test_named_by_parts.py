"""Files with a common part in their names: tables and pictures of one take."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.datasets import Recordings

COUNT = 10


def film(path: Path, grey: int) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (64, 48))
    for n in range(COUNT):
        writer.write(np.full((48, 64, 3), grey + n, np.uint8))
    writer.release()


def forces(path: Path, factor: float) -> None:
    rows = [f"{n / 20},0,0,{factor * n:.4f}" for n in range(COUNT)]
    path.write_text("\n".join(["t,fx,fy,fz", *rows]) + "\n")


def read(root: Path) -> tuple[dict[str, Recording], Sequence[str]]:
    guess = Recordings.recognise(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return {one.key.partition("/")[2]: one for one in found}, guess.doubts


@pytest.mark.parametrize(
    ("names", "table"),
    [
        (("Left_trial{}", "Right_trial{}"), "trial{}"),
        (("Left_trial{}", "Right_trial{}"), "trial{}_ft"),
        (("video_{}",), "forces_{}"),
        (("trial{}_left", "trial{}_right"), "trial{}"),
    ],
)
def test_a_table_has_a_part_of_the_names_of_its_films(
    names: tuple[str, ...], table: str, tmp_path: Path
) -> None:
    for k in (1, 2, 3):
        for name in names:
            film(tmp_path / f"{name.format(k)}.avi", 60 * k)
        forces(tmp_path / f"{table.format(k)}.csv", 0.1 * k)
    found, _ = read(tmp_path)
    assert sorted(found) == sorted(f"{name.format(k)}.avi" for name in names for k in (1, 2, 3))
    for key, one in found.items():
        assert one.force is not None
        (k,) = (int(letter) for letter in Path(key).stem if letter.isdecimal())
        np.testing.assert_allclose(one.force[:, 2], 0.1 * k * np.arange(COUNT), atol=1e-6)


def test_a_table_of_two_objects_is_of_neither(tmp_path: Path) -> None:
    for k in (1, 2):
        for name in ("mug", "can"):
            film(tmp_path / f"{name}_{k}.avi", 60 * k)
        forces(tmp_path / f"forces_{k}.csv", 0.1 * k)
    found, doubts = read(tmp_path)
    assert len(found) == 4
    assert all(one.force is None for one in found.values())
    assert any("forces_1.csv and 1 more are left out" in line for line in doubts)


def test_forces_of_two_sides_of_a_table_are_of_their_films(tmp_path: Path) -> None:
    for k in (1, 2, 3):
        film(tmp_path / f"trial{k}_left.avi", 60 * k)
        film(tmp_path / f"trial{k}_right.avi", 60 * k)
        rows = [f"{n / 20},0,0,{0.1 * n:.4f},0,0,{0.2 * n:.4f}" for n in range(COUNT)]
        header = "t,fx_l,fy_l,fz_l,fx_r,fy_r,fz_r"
        (tmp_path / f"trial{k}.csv").write_text("\n".join([header, *rows]) + "\n")
    found, _ = read(tmp_path)
    assert len(found) == 6
    for key, one in found.items():
        assert one.force is not None
        factor = 0.2 if "right" in key else 0.1
        np.testing.assert_allclose(one.force[:, 2], factor * np.arange(COUNT), atol=1e-6)


@pytest.mark.parametrize("clock", ["t", ""])
def test_a_table_names_the_pictures_of_both_sides_in_its_rows(clock: str, tmp_path: Path) -> None:
    sides = ["left", "right"]
    for k in range(3):
        folder = tmp_path / f"trial_{k}/images"
        folder.mkdir(parents=True)
        lines = [f"{clock},left_image,right_image,fx,fy,fz".lstrip(",")]
        for n in range(COUNT):
            names = [f"{side}_{n:03d}.png" for side in sides]
            for j, name in enumerate(names):
                picture = np.full((48, 64, 3), 100 * j + 30 * k + n, np.uint8)
                cv2.imwrite(str(folder / name), picture)
            at = [f"{n / 20}"] if clock else []
            cells = [*at, *(f"images/{name}" for name in names), "0", "0", f"{0.1 * (k + 1) * n}"]
            lines.append(",".join(cells))
        (tmp_path / f"trial_{k}/data.csv").write_text("\n".join(lines) + "\n")
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    assert not [line for line in guess.doubts if ": labels:" in line]
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 6
    for one in found:
        side, trial, _ = one.key.split("/")
        k = int(trial[-1])
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], 0.1 * (k + 1) * np.arange(COUNT), atol=1e-6)
        assert one.frames.read([3])[0, 0, 0, 0] == 100 * sides.index(side) + 30 * k + 3
    # both sides of a trial are held out together
    held_out = {one.key.split("/")[1] for one in data.recordings("val")}
    assert held_out.isdisjoint(one.key.split("/")[1] for one in data.recordings("train"))


@pytest.mark.parametrize("shape", [(3,), (6,), (1, 3)])
@pytest.mark.parametrize("name", ["force/{}.npy", "force_{}.npy"])
def test_an_array_of_the_force_of_each_picture(
    shape: tuple[int, ...], name: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    pictures = "img/{}.png" if "/" in name else "img_{}.png"
    for n in range(12):
        picture, array = (tmp_path / one.format(f"{n:04d}") for one in (pictures, name))
        for path in (picture, array):
            path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(picture), rng.integers(0, 255, (48, 64, 3), np.uint8))
        force = np.resize([0.1, -0.2, n / 10, 9, 9, 9], shape)
        np.save(array, force)
    found, _ = read(tmp_path)
    assert len(found) == 12
    for key, one in found.items():
        assert one.force is not None
        wanted = [[0.1, -0.2, int(Path(key).stem[-4:]) / 10]]
        np.testing.assert_allclose(one.force, wanted, atol=1e-6)


@pytest.mark.parametrize(
    "name", ["{}_before.png", "Before-{}.png", "press_{}/before.png", "beforehand_{}.png"]
)
@pytest.mark.parametrize("lacking", [0, 1])
def test_a_picture_before_contact_is_the_background_of_that_after_it(
    name: str, lacking: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    for k in range(12):
        before = tmp_path / name.format(k)
        before.parent.mkdir(exist_ok=True)
        picture = rng.integers(50, 150, (48, 64, 3), np.uint8)
        cv2.imwrite(str(before), picture)
        if k >= lacking:
            after = name.replace("before", "after").replace("Before", "After").format(k)
            cv2.imwrite(str(tmp_path / after), picture + np.uint8(40))
    found, doubts = read(tmp_path)
    if lacking or "hand" in name:  # pictures of any kind
        assert len(found) == 24 - lacking
        assert "background: none was found, so nothing is subtracted" in doubts
        return
    assert len(found) == 12
    assert any(line.startswith("background:") and "by its name" in line for line in doubts)
    for key, one in found.items():
        assert "fter" in key
        assert one.no_contact is not None
        np.testing.assert_array_equal(one.frames.read([0]), one.no_contact.read([0]) + 40)
