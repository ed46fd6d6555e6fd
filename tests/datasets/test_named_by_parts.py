"""Files that share a part of their names: tables and pictures of one take."""

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
    ],
)
def test_a_table_is_named_by_what_follows_the_first_word(
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
        k = int(Path(key).stem[-1])
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
