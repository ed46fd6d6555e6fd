"""One table for all images of a set: read with no key typed, to the bit."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.reading.guessing.layout import guess_layout

COUNT, TRIALS = 10, 3
OBJECTS = ["mug", "bolt", "key"]
START = 1_763_000_000_000_000_123


def level(trial: int, n: int) -> int:
    return 60 + 40 * trial + 3 * n


def forces(trial: int) -> list[list[float]]:
    return [[0.1 * n + trial, -0.05 * n, 0.25 * n * (trial + 1)] for n in range(COUNT)]


def image(path: Path, trial: int, n: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((12, 16, 3), level(trial, n), np.uint8)).save(path)


def write(path: Path, rows: Sequence[Sequence[object]]) -> None:
    path.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))


def read(root: Path) -> tuple[list[Recording], Sequence[str]]:
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return found, guess.doubts


def check(found: Sequence[Recording], are_named: bool = True) -> None:
    """Frames, forces and objects of every recording are those of the images in it."""
    seen = set()
    for one in found:
        levels = one.frames.read(range(len(one.frames)))[:, 0, 0, 0].tolist()
        at = [((grey - 60) // 40, (grey - 60) % 40 // 3) for grey in levels]
        seen |= {*at}
        assert one.force is not None
        wanted = np.array([forces(trial)[n] for trial, n in at], np.float32)
        np.testing.assert_array_equal(one.force, wanted)
        assert not are_named or {one.object} == {OBJECTS[trial] for trial, _ in at}
    assert len(seen) == TRIALS * COUNT == sum(len(one.frames) for one in found)


@pytest.mark.parametrize("ending", ["csv", "jsonl"])
def test_an_image_folder_without_recordings(ending: str, tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = []
    for trial in range(TRIALS):
        for n, force in enumerate(forces(trial)):
            rows.append({"file_name": f"{len(rows):05d}.png", "force": force})
            rows[-1]["label"] = OBJECTS[trial]
            image(tmp_path / "train" / rows[-1]["file_name"], trial, n)
    if ending == "jsonl":
        lines = [json.dumps(row) + "\n" for row in rows]
        (tmp_path / "train/metadata.jsonl").write_text("".join(lines))
    else:
        header = ["file_name", "fx", "fy", "fz", "label"]
        cells = [[row["file_name"], *row["force"], row["label"]] for row in rows]
        write(tmp_path / "train/metadata.csv", [header, *cells])
    found, doubts = read(tmp_path)
    check(found)
    assert len(found) == TRIALS * COUNT
    assert "each: sequence, recording: '{label}'" in "".join(doubts)


def test_an_image_folder_with_episodes_and_splits(tmp_path: Path) -> None:
    header = ["file_name", "fx", "fy", "fz", "label", "episode_index", "timestamp"]
    rows: dict[str, list[Sequence[object]]] = {"train": [header], "test": [header]}
    for trial in range(TRIALS):
        split = "test" if trial == TRIALS - 1 else "train"
        for n, force in enumerate(forces(trial)):
            name = f"{COUNT * trial + n:05d}.png"
            image(tmp_path / split / name, trial, n)
            rows[split].append([name, *force, OBJECTS[trial], trial, n / 20])
    for split, cells in rows.items():
        write(tmp_path / split / "metadata.csv", cells)
    found, _ = read(tmp_path)
    check(found)
    assert len(found) == TRIALS
    for one in found:
        np.testing.assert_allclose(one.times, np.arange(COUNT) / 20)


def test_names_from_a_folder_between(tmp_path: Path) -> None:
    rows: list[list[object]] = [["image", "object", "fx", "fy", "fz"]]
    for trial in range(TRIALS):
        for n, force in enumerate(forces(trial)):
            image(tmp_path / f"images/t{trial}/{n:04d}.png", trial, n)
            rows.append([f"t{trial}/{n:04d}.png", OBJECTS[trial], *force])
    write(tmp_path / "labels.csv", rows)
    found, _ = read(tmp_path)
    check(found)
    assert len(found) == TRIALS


def test_stamps_behind_a_prefix_and_one_table_of_dates(tmp_path: Path) -> None:
    rows: list[list[object]] = [["timestamp", "fx", "fy", "fz"]]
    for trial in range(TRIALS):
        for n, force in enumerate(forces(trial)):
            stamp = START + 10**10 * trial + 33_333_333 * n
            image(tmp_path / f"images/{OBJECTS[trial]}_{stamp}.png", trial, n)
            rows.append([stamp, *force])
    write(tmp_path / "ft.csv", rows)
    found, _ = read(tmp_path)
    check(found, are_named=False)
    assert len(found) == TRIALS


@pytest.mark.parametrize("stamped", [True, False])
def test_an_export_of_rostopic_has_the_force_of_its_stamp(stamped: bool, tmp_path: Path) -> None:
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    header += [f"field.wrench.{what}.{axis}" for what in ("force", "torque") for axis in "xyz"]
    for trial in range(TRIALS):
        stamps = [START + 10**10 * trial + 33_333_333 * n for n in range(COUNT)]
        cells = [
            [stamp + 4000, n, stamp, "ft", *force, 0.1, 0.2, 0.3]
            for n, (stamp, force) in enumerate(zip(stamps, forces(trial), strict=True))
        ]
        for n, stamp in enumerate(stamps):
            name = str(stamp) if stamped else f"{n:04d}"
            image(tmp_path / f"trial_{trial}/digit/{name}.png", trial, n)
        write(tmp_path / f"trial_{trial}/ft_wrench.csv", [header, *cells])
    found, _ = read(tmp_path)
    check(found, are_named=False)
