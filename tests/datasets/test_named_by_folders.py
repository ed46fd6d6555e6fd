"""Videos in a folder for each trial, with tables of the folders' names: no key typed."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError, DataNotFoundError

TRIALS, COUNT = 5, 20
OBJECTS = ["mug", "bolt", "key", "mug", "bolt"]


def video(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 20, (64, 48))
    for n in range(COUNT):
        writer.write(np.full((48, 64, 3), grey + n, np.uint8))
    writer.release()


def read(root: Path) -> dict[str, Recording]:
    guess = Recordings.recognise(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return {one.key.removeprefix("guessed/"): one for one in found}


def table(root: Path, named: str) -> None:
    """Forces of all trials in one table; their z is the trial and the number of the row."""
    rows = [f"{named},time,fx,fy,fz"]
    for trial in range(TRIALS):
        name = trial if named == "trial" else f"t{trial}"
        rows += [f"{name},{n / 20},0,0,{trial + n / 100}" for n in range(COUNT)]
    (root / "forces.csv").write_text("\n".join(rows) + "\n")


def check_forces(one: Recording, trial: int) -> None:
    assert one.force is not None
    np.testing.assert_allclose(one.force[:, 2], trial + np.arange(COUNT) / 100, atol=1e-6)


@pytest.mark.parametrize("sides", [["video"], ["left", "right"]])
@pytest.mark.parametrize("named", ["recording", "trial"])
def test_forces_of_all_by_folder_or_number(tmp_path: Path, sides: list[str], named: str) -> None:
    for trial in range(TRIALS):
        for side in sides:
            video(tmp_path / f"t{trial}/{side}.mp4", 30 + 20 * trial)
    table(tmp_path, named)
    found = read(tmp_path)
    assert len(found) == TRIALS * len(sides)
    for trial in range(TRIALS):
        for side in sides:
            check_forces(found[f"t{trial}/{side}.mp4"], trial)


@pytest.mark.parametrize("sides", [["video"], ["left", "right"]])
def test_labels_by_folder(tmp_path: Path, sides: list[str]) -> None:
    rows = ["take,object,grasped"]
    for trial, name in enumerate(OBJECTS):
        for side in sides:
            video(tmp_path / f"t{trial}/{side}.mp4", 30 + 20 * trial)
        rows.append(f"t{trial},{name},{trial % 2}")
    (tmp_path / "labels.csv").write_text("\n".join(rows) + "\n")
    found = read(tmp_path)
    for key, one in found.items():
        trial = int(key[1])
        assert (one.object, one.labels["grasped"]) == (OBJECTS[trial], trial % 2)


def test_columns_that_say_nothing_known_are_labels_too(tmp_path: Path) -> None:
    for trial in range(TRIALS):
        video(tmp_path / f"t{trial}.mp4", 30 + 20 * trial)
    rows = [f"t{trial}.mp4,{trial % 2}" for trial in range(TRIALS)]
    (tmp_path / "labels.csv").write_text("\n".join(["video,grasped", *rows]) + "\n")
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    assert "labels: grasped by labels.csv" in guess.doubts
    assert {key: one.labels["grasped"] for key, one in read(tmp_path).items()} == {
        f"t{trial}.mp4": trial % 2 for trial in range(TRIALS)
    }


def test_a_folder_s_name_in_each_row_of_its_own_table_is_no_key(tmp_path: Path) -> None:
    for trial, name in enumerate(OBJECTS[:3]):
        video(tmp_path / f"{name}/video.mp4", 30 + 20 * trial)
        rows = [f"{name},{n / 20},0,0,{trial + n / 100}" for n in range(COUNT)]
        (tmp_path / f"{name}/forces.csv").write_text(
            "\n".join(["object,time,fx,fy,fz", *rows]) + "\n"
        )
    found = read(tmp_path)
    for trial, name in enumerate(OBJECTS[:3]):
        check_forces(found[f"{name}/video.mp4"], trial)


def test_a_folder_without_a_layout_is_read_by_the_guess_and_says_so(tmp_path: Path) -> None:
    for trial in range(TRIALS):
        video(tmp_path / f"t{trial}.mp4", 30 + 20 * trial)
    data = Recordings(str(tmp_path))
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert {one.sensor for one in found} == {"gelsight_mini"}
    assert len(found) == TRIALS
    assert any(line.startswith("guessed, to be checked: sensor:") for line in data.notes)
    how = f"tactileforge data inspect {tmp_path} shows each guess"
    (line,) = [line for line in data.notes if how in line]
    assert f"{TRIALS} recordings were found, 1 of them held out" in line
    assert f"to keep as {tmp_path / 'tactileforge.yaml'}" in line
    with pytest.raises(DataNotFoundError, match="no layouts are given"):
        list(Recordings(str(tmp_path), guess=False).recordings("train"))
    (tmp_path / "tactileforge.yml").write_text("layouts: {}\n")
    with pytest.raises(DataNotFoundError, match=r"rename tactileforge\.yml"):
        list(Recordings(str(tmp_path)).recordings("train"))
    (tmp_path / "tactileforge.yml").unlink()
    (tmp_path / "tactileforge.yaml").write_text(
        "layouts: {own: {videos: '*.mp4', sensor: digit, background: none}}\n"
    )
    data = Recordings(str(tmp_path))
    assert {one.sensor for one in data.recordings("train")} == {"digit"}
    assert not data.notes


def test_numbers_stand_for_names_that_count(tmp_path: Path) -> None:
    """Labels by number, and forces in arrays with the names of the videos."""
    (tmp_path / "forces").mkdir()
    for trial in range(TRIALS):
        video(tmp_path / f"videos/{trial:04d}.mp4", 30 + 20 * trial)
        force = np.zeros((COUNT, 3))
        force[:, 2] = trial + np.arange(COUNT) / 100
        np.save(tmp_path / f"forces/{trial:04d}.npy", force)
    rows = [f"{trial},{OBJECTS[trial]}" for trial in reversed(range(TRIALS))]
    (tmp_path / "labels.csv").write_text("\n".join(["id,material", *rows]) + "\n")
    found = read(tmp_path)
    for trial in range(TRIALS):
        one = found[f"videos/{trial:04d}.mp4"]
        assert one.object == OBJECTS[trial]
        check_forces(one, trial)


def test_a_number_of_no_recording_is_an_error(tmp_path: Path) -> None:
    for trial in range(TRIALS):
        video(tmp_path / f"{trial:04d}.mp4", 30 + 20 * trial)
    (tmp_path / "labels.csv").write_text("id,object\n0,mug\n7,key\n")
    layout = {"videos": "*.mp4", "sensor": "digit", "background": "none"}
    labels = {"labels": {"file": "labels.csv", "key": "id"}, "object": "{object}"}
    data = Recordings(str(tmp_path), {"a": layout | labels})
    with pytest.raises(DataError, match="'7' names no file"):
        list(data.recordings("train"))
