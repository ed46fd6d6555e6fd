"""One table for all recordings, with the trial and the frame of each row and no names of files."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.datasets import Recordings
from tactileforge.errors import DataError
from tactileforge.reading.guessing.layout import guess_layout

COUNT, TRIALS = 12, 3


def level(trial: int, n: int) -> int:
    return 60 + 50 * trial + 4 * n


def force(trial: int, n: int) -> list[float]:
    return [0.1 * n + trial, -0.05 * n, 0.25 * n * (trial + 1)]


def images(
    root: Path, folder: Callable[[int], str], first: int = 0, jump: bool = False, each: int = 1
) -> None:
    for trial in range(TRIALS):
        for n in range(COUNT):
            path = root / folder(trial) / f"{each * n + first:05d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            grey = level(trial, n)
            picture = np.full((12, 16, 3), grey, np.uint8)
            if jump:  # neighbouring images differ: each is a touch
                picture[:, :8] = 255 * (n % 2)
                picture[:4] = grey
            Image.fromarray(picture).save(path)


def table(path: Path, header: str, row: Callable[[int, int], Sequence[object]]) -> None:
    rows = [row(trial, n) for n in range(COUNT) for trial in range(TRIALS)]  # not one by one
    lines = [header, *(",".join(map(str, one)) for one in rows)]
    path.write_text("\n".join(lines) + "\n")


def read(root: Path) -> tuple[list[Recording], str]:
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return found, "\n".join(guess.doubts)


def check(found: Sequence[Recording]) -> None:
    seen = []
    for one in found:
        greys = one.frames.read(range(len(one.frames)))[:, 0, 0, 0].astype(int)
        at = [((grey - 60 + 2) // 50, ((grey - 60 + 2) % 50) // 4) for grey in greys]
        assert one.force is not None
        wanted = np.array([force(*place) for place in at], np.float32)
        np.testing.assert_allclose(one.force, wanted, rtol=1e-6)
        seen += at
    assert sorted(seen) == [(trial, n) for trial in range(TRIALS) for n in range(COUNT)]


NAMES: dict[str, tuple[Callable[[int], str], Callable[[int], object], str]] = {
    "names": (lambda i: f"trial_{i:02d}", lambda i: f"trial_{i:02d}", "trial"),
    "numbers": (lambda i: f"images/trial_{i + 3:02d}", lambda i: i + 3, "trial"),
    "bare numbers": (lambda i: str(9 + i), lambda i: 9 + i, "episode_index"),
    "words": (lambda i: f"data/{'abc'[i]}_press", lambda i: f"{'abc'[i]}_press", "sequence"),
    "another header": (lambda i: f"run{i}", lambda i: f"run{i}", "where"),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("jump", [False, True])
def test_rows_by_trial_and_frame(name: str, jump: bool, tmp_path: Path) -> None:
    folder, cell, header = NAMES[name]
    images(tmp_path, folder, jump=jump)
    table(
        tmp_path / "labels.csv",
        f"{header},frame,fx,fy,fz",
        lambda trial, n: [cell(trial), n, *force(trial, n)],
    )
    found, doubts = read(tmp_path)
    check(found)
    assert len(found) == (TRIALS * COUNT if jump else TRIALS)
    assert f"key: rows of labels.csv are of the recording that {header} names" in doubts


def test_frames_are_the_numbers_in_the_names(tmp_path: Path) -> None:
    images(tmp_path, lambda i: f"t{i}", first=7, each=3)
    table(
        tmp_path / "labels.csv",
        "trial,frame,fx,fy,fz",
        lambda trial, n: [f"t{trial}", 3 * n + 7, *force(trial, n)],
    )
    check(read(tmp_path)[0])


def test_rows_by_trial_and_time(tmp_path: Path) -> None:
    images(tmp_path, lambda i: f"t{i}")
    table(
        tmp_path / "labels.csv",
        "trial,time,fx,fy,fz",
        lambda trial, n: [f"t{trial}", n / 30, *force(trial, n)],
    )
    check(read(tmp_path)[0])


def test_films_by_trial_and_frame(tmp_path: Path) -> None:
    for trial in range(TRIALS):
        writer = cv2.VideoWriter(
            str(tmp_path / f"press_{trial}.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 30, (16, 12)
        )
        for n in range(COUNT):
            writer.write(np.full((12, 16, 3), level(trial, n), np.uint8))
        writer.release()
    table(
        tmp_path / "forces.csv",
        "trial,frame,fx,fy,fz",
        lambda trial, n: [trial, n, *force(trial, n)],
    )
    check(read(tmp_path)[0])


def test_a_trial_that_is_not_there_is_named(tmp_path: Path) -> None:
    images(tmp_path, lambda i: f"trial_{i}")
    layout = {"images": "*/*.png", "each": "sequence", "fps": 30, "sensor": "digit"}
    layout |= {"background": "none", "hold_out": "none"}
    layout |= {
        "force": {
            "file": "f.csv",
            "key": "trial",
            "frame": "frame",
            "columns": ["fx", "fy", "fz"],
        }
    }
    rows = ["trial,frame,fx,fy,fz", "trial_0,0,0,0,1", "trial_7,0,0,0,1"]
    (tmp_path / "f.csv").write_text("\n".join(rows) + "\n")
    data = Recordings(str(tmp_path), {"x": layout})
    with pytest.raises(DataError, match=r"row 3: trial 'trial_7' names no recording.*'trial_\d'"):
        list(data.recordings("train"))
    (tmp_path / "f.csv").write_text("\n".join(rows[:2]) + "\n")
    found = {
        one.key: one.force for one in Recordings(str(tmp_path), {"x": layout}).recordings("train")
    }
    force = found["x/trial_0"]
    assert force is not None
    np.testing.assert_array_equal(force[0], [0, 0, 1])
    assert np.isnan(force[1:]).all()
    assert all(
        np.isnan(own).all()
        for name, own in found.items()
        if name != "x/trial_0" and own is not None
    )


@pytest.mark.parametrize("clock", ["frame", "t"])
@pytest.mark.parametrize("inner", ["", "/images"])
def test_a_table_of_a_trial_names_the_side_of_each_row(
    clock: str, inner: str, tmp_path: Path
) -> None:
    sides = ["left", "right"]
    for trial in range(TRIALS):
        lines = [f"{clock},finger,fx,fy,fz"]
        for n in range(COUNT):
            for k, side in enumerate(sides):
                folder = tmp_path / f"trial_{trial}/{side}{inner}"
                folder.mkdir(parents=True, exist_ok=True)
                grey = 20 + 100 * k + 20 * trial + n
                Image.fromarray(np.full((12, 16, 3), grey, np.uint8)).save(folder / f"{n:03d}.png")
                at = n if clock == "frame" else f"{n / 20:.2f}"
                lines.append(f"{at},{side},{0.1 * k},{0.1 * trial},{0.25 * n * (k + 1)}")
        (tmp_path / f"trial_{trial}/forces.csv").write_text("\n".join(lines) + "\n")
    found, doubts = read(tmp_path)
    assert "forces.csv are of the recording that finger names" in doubts
    assert len(found) == 2 * TRIALS
    for one in found:
        k, trial = sides.index(one.key.split("/")[2]), int(one.key.split("/")[1][-1])
        rows = np.arange(COUNT)
        wanted = np.stack([0 * rows + 0.1 * k, 0 * rows + 0.1 * trial, 0.25 * rows * (k + 1)], 1)
        assert one.force is not None
        np.testing.assert_allclose(one.force, wanted, atol=1e-6)
        assert one.frames.read([3])[0, 0, 0, 0] == 23 + 100 * k + 20 * trial
        if clock == "t":  # as long as the forces
            np.testing.assert_allclose(one.times, rows / 20)
