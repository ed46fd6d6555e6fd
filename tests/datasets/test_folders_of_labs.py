"""Folders as labs have them, read to the value or told: no key typed."""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from videos import write_video

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError
from tactileforge.reading.guessing.layout import guess_layout
from tactileforge.util.untrusted import load_yaml

RNG = np.random.default_rng(3)
COUNT = 20


def touch(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(RNG.integers(90, 150, (24, 32, 3)).astype(np.uint8)).save(path)


def film(path: Path, size: tuple[int, int] = (24, 32)) -> None:
    write_video(path, [np.full((*size, 3), 60 + n, np.uint8) for n in range(COUNT)])


def images(folder: Path, names: Sequence[str]) -> None:
    folder.mkdir(parents=True)
    for n, name in enumerate(names):
        Image.fromarray(np.full((24, 32, 3), 60 + n, np.uint8)).save(folder / f"{name}.png")


def forces(path: Path, first: float, rest: float = 0, start: float = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{start + n / 25:.3f},0,0,{rest + first + n / 10}" for n in range(COUNT)]
    path.write_text("\n".join(["t,fx,fy,fz", *rows]) + "\n")


def read(root: Path) -> tuple[dict[str, dict[str, Recording]], Sequence[str]]:
    """Recordings by their paths, of each split, and the lines of the guess."""
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = {
        split: {one.key.partition("/")[2]: one for one in data.recordings(split)}
        for split in ("train", "val")
    }
    assert not data.skipped
    return found, guess.doubts


def table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    path.write_text("\n".join(map(",".join, [header, *rows])) + "\n")


def told(doubts: Sequence[str], *words: str) -> str:
    (line,) = [line for line in doubts if all(word in line for word in words)]
    return line


def whole(found: Mapping[str, Mapping[str, Recording]]) -> dict[str, Recording]:
    return {**found["train"], **found["val"]}


LISTS = {
    "csv": lambda names: "file,label\n" + "".join(f"{one},{one[-5]}\n" for one in names),
    "json": lambda names: json.dumps([{"file": one, "label": one[-5]} for one in names]),
    "txt": lambda names: "".join(f"{one} {one[-5]}\n" for one in names),
}


@pytest.mark.parametrize("ending", LISTS)
def test_lists_of_splits_are_followed(ending: str, tmp_path: Path) -> None:
    names = [f"touch/{n}.png" for n in range(8)]
    for name in names:
        touch(tmp_path / name)
    touch(tmp_path / "bg.png")
    parts = {"train": names[::2], "test": names[1::2]}
    for word, own in parts.items():
        (tmp_path / f"{word}_list.{ending}").write_text(LISTS[ending](own))
    (tmp_path / "notes.txt").write_text("of the first day\n")
    found, doubts = read(tmp_path)
    assert [*found["train"]] == parts["train"]
    assert [*found["val"]] == parts["test"]
    column = "1" if ending == "txt" else "label"
    for name, one in whole(found).items():
        assert one.labels[column] == float(name[-5])
        assert one.no_contact is not None
    assert told(doubts, "hold_out", f"train_list.{ending} names the recordings for train")


def test_lists_of_folders_are_followed(tmp_path: Path) -> None:
    names = [f"{item}/trial_{n}" for item in ("mug", "can") for n in range(3)]
    for name in names:
        images(tmp_path / name, [f"{n:03d}" for n in range(COUNT)])
    parts = {"train": names[:2] + names[3:5], "val": [names[2], names[5]]}
    for word, own in parts.items():
        (tmp_path / f"{word}.txt").write_text("\n".join(own) + "\n")
    found, _ = read(tmp_path)
    assert {one.object for one in found["val"].values()} == {"mug", "can"}
    assert {split: sorted(own) for split, own in found.items()} == {
        split: sorted(own) for split, own in parts.items()
    }


def test_lists_of_one_split_are_no_split(tmp_path: Path) -> None:
    for n in range(8):
        touch(tmp_path / f"touch/{n}.png")
    for word in ("train", "training"):
        (tmp_path / f"{word}.csv").write_text("file\n" + "".join(f"{n}.png\n" for n in range(8)))
    found, _ = read(tmp_path)
    assert len(whole(found)) == 8
    assert found["val"]


def test_a_column_of_splits_is_followed(tmp_path: Path) -> None:
    sides = ["train", "train", "Test"] * 3
    for n in range(9):
        touch(tmp_path / f"touch/{n}.png")
    rows = [f"{n}.png,{side},{n % 2}" for n, side in enumerate(sides)]
    (tmp_path / "metadata.csv").write_text("\n".join(["file,subset,worn", *rows]) + "\n")
    found, doubts = read(tmp_path)
    assert sorted(found["val"]) == [f"touch/{n}.png" for n in (2, 5, 8)]
    assert told(doubts, "hold_out: what subset of metadata.csv says")


def test_a_column_of_one_split_holds_out_as_ever(tmp_path: Path) -> None:
    for n in range(9):
        touch(tmp_path / f"touch/{n}.png")
    rows = [f"{n}.png,train" for n in range(9)]
    (tmp_path / "metadata.csv").write_text("\n".join(["file,subset", *rows]) + "\n")
    found, doubts = read(tmp_path)
    assert not any(line.startswith("hold_out") for line in doubts)
    assert found["val"]


def test_the_column_of_touch_is_the_key_beside_those_of_other_pictures(tmp_path: Path) -> None:
    rows = ["image,touch,caption"]
    for n in range(8):
        touch(tmp_path / f"touch/{n}.png")
        touch(tmp_path / f"vision/{n}.png")
        rows.append(f"vision/{n}.png,touch/{n}.png,edge {n}")
    (tmp_path / "captions.csv").write_text("\n".join(rows) + "\n")
    found, _ = read(tmp_path)
    assert {name: one.text for name, one in whole(found).items()} == {
        f"touch/{n}.png": f"edge {n}" for n in range(8)
    }


def test_one_log_by_dates_has_the_forces_of_all(tmp_path: Path) -> None:
    rows = ["stamp,fx,fy,fz"]
    for trial in range(3):
        start = 1_700_000_000 + 100 * trial
        images(tmp_path / f"trial_{trial}/gel", [f"{start + n / 25:.3f}" for n in range(COUNT)])
        rows += [f"{start + n / 25:.3f},0,0,{trial + n / 100}" for n in range(COUNT)]
    (tmp_path / "ft_log.csv").write_text("\n".join(rows) + "\n")
    found, _ = read(tmp_path)
    for name, one in whole(found).items():
        assert one.force is not None
        wanted = int(name[6]) + np.arange(COUNT) / 100
        np.testing.assert_allclose(one.force[:, 2], wanted, atol=1e-3)


def test_takes_of_one_folder_have_the_rows_of_their_names(tmp_path: Path) -> None:
    names = [
        f"{item}_{take}_{n:04d}" for item in ("mug", "can") for take in (1, 2) for n in range(8)
    ]
    images(tmp_path / "images", names)
    rows = [
        f"{item},{take},{int(n)},{len(item) + int(take) + int(n) / 10}"
        for item, take, n in (name.split("_") for name in names)
    ]
    (tmp_path / "metadata.csv").write_text("\n".join(["object,take,frame,fz", *rows]) + "\n")
    found, _ = read(tmp_path)
    assert sorted(whole(found)) == [f"images/{one}" for one in ("can_1", "can_2", "mug_1", "mug_2")]
    for name, one in whole(found).items():
        assert one.force is not None
        wanted = 3 + int(name[-1]) + np.arange(8) / 10
        np.testing.assert_allclose(one.force[:, 2], wanted, atol=1e-6)


def test_lists_within_a_json_are_columns(tmp_path: Path) -> None:
    images(tmp_path / "trial_0/gel", [f"{n:03d}" for n in range(COUNT)])
    images(tmp_path / "trial_1/gel", [f"{n:03d}" for n in range(COUNT)])
    times = [n / 10 for n in range(COUNT)]
    ft = {"force": [[0, 0, n / 4] for n in range(COUNT)], "rate": 10, "bias": [0.1, 0.2]}
    for trial in range(2):
        text = json.dumps({"t": times, "ft": ft, "about": {"object": "mug"}})
        (tmp_path / f"trial_{trial}/data.json").write_text(text)
    found, _ = read(tmp_path)
    for one in whole(found).values():
        np.testing.assert_allclose(one.times, times)
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], np.arange(COUNT) / 4, atol=1e-6)


def test_deep_colours_are_read_after_the_command_of_the_error(tmp_path: Path) -> None:
    pixels, folder = RNG.integers(90, 150, (COUNT, 24, 32, 3)), tmp_path / "set"
    folder.mkdir()
    for n, one in enumerate(pixels):
        cv2.imwrite(str(folder / f"{n}.png"), (one[..., ::-1] * 257).astype(np.uint16))
    rows = [f"{n}.png,{n}" for n in range(COUNT)]
    table(folder / "forces.csv", ["file", "fz"], [row.split(",") for row in rows])
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(DataError, match="16 bits a channel") as error:
        read(folder)
    made = str(error.value)[str(error.value).index("python -c") :]
    subprocess.run(["sh", "-c", made.replace("python", sys.executable, 1)], cwd=folder, check=True)
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}
    assert (tmp_path / "8bit/forces.csv").read_bytes() == before["forces.csv"]
    found, _ = read(tmp_path / "8bit")
    for name, one in whole(found).items():
        np.testing.assert_array_equal(one.frames.read([0])[0], pixels[int(name[:-4])])
        assert one.force is not None
        assert one.force[0, 2] == int(name[:-4])


def test_single_touches_of_one_array_are_read_with_the_keys_of_the_line(tmp_path: Path) -> None:
    grey = 60 + np.arange(COUNT)[:, None, None, None]
    pixels = (grey + np.zeros((24, 32, 3))).astype(np.uint8)
    felt = np.arange(3 * COUNT).reshape(COUNT, 3) / 8
    np.save(tmp_path / "images.npy", pixels)
    np.save(tmp_path / "forces.npy", felt)
    guess = guess_layout(tmp_path)
    assert guess is not None
    fix = told(guess.doubts, "each: images.npy is taken for one film").partition("own: ")[2]
    layout = guess.options["layouts"]["guessed"] | load_yaml(f"{{{fix}}}")
    data = Recordings(str(tmp_path), {"mine": layout})
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == COUNT
    assert all(len([*data.recordings(x)]) for x in ("train", "val"))
    for one in found:
        row = int(one.key.rpartition("/")[2])
        np.testing.assert_array_equal(one.frames.read([0])[0], pixels[row])
        assert one.force is not None
        np.testing.assert_allclose(one.force[0], felt[row])
        assert one.times.tolist() == [0]
        assert one.action is not None
        assert one.no_contact is None
    with pytest.raises(ConfigError, match="each: touch takes each frame"):
        Recordings(str(tmp_path), {"mine": layout | {"every": 2}})


@pytest.mark.parametrize("table", ["npy", "csv"])
def test_arrays_of_unlike_pictures_and_classes_are_single_touches(
    table: str, tmp_path: Path
) -> None:
    pixels = RNG.integers(90, 150, (COUNT, 24, 32, 3)).astype(np.uint8)
    classes = np.arange(COUNT) % 4
    parts = {"train": slice(0, 12), "test": slice(12, COUNT)}
    for word, rows in parts.items():
        np.save(tmp_path / f"X_{word}.npy", pixels[rows])
        if table == "npy":
            np.save(tmp_path / f"y_{word}.npy", classes[rows])
        else:
            cells = "".join(f"{one}\n" for one in classes[rows])
            (tmp_path / f"y_{word}.csv").write_text(f"object\n{cells}")
    found, doubts = read(tmp_path)
    assert told(doubts, "train: each", "classes differ")
    assert [len(own) for own in found.values()] == [12, 8]
    for split, rows in zip(("train", "val"), parts.values(), strict=True):
        for name, one in found[split].items():
            row = int(name.rpartition("/")[2])
            np.testing.assert_array_equal(one.frames.read([0])[0], pixels[rows][row])
            assert one.object == str(classes[rows][row])
    layout = {"videos": "X_train.npy", "each": "touch", "sensor": "digit", "background": "none"}
    layouts = {"mine": layout | {"labels": {"file": f"y_test.{table}"}}}
    with pytest.raises(DataError, match=r"8 rows for the 12 pictures of X_train\.npy"):
        list(Recordings(str(tmp_path), layouts).recordings("train"))


def test_numbered_rows_beside_the_images_of_the_root_are_of_frames(tmp_path: Path) -> None:
    images(tmp_path / "set", [f"{n:03d}" for n in range(COUNT)])
    rows = [[str(7 * n), str(n / 4)] for n in range(COUNT)]
    table(tmp_path / "set/log.csv", ["id", "fz"], rows)
    (one,) = whole(read(tmp_path / "set")[0]).values()
    assert one.force is not None
    assert one.force[:, 2].tolist() == [n / 4 for n in range(COUNT)]


def test_one_table_of_several_trials_is_told(tmp_path: Path) -> None:
    for trial in range(2):
        film(tmp_path / f"mug/trial_{trial}.avi")
    for side in ("left", "right"):
        film(tmp_path / f"can/{side}.avi")
    forces(tmp_path / "mug/ft.csv", 0)
    forces(tmp_path / "can/ft.csv", 0)
    _, doubts = read(tmp_path)
    line = told(doubts, "is taken for that of")
    assert "mug/ft.csv is taken for that of mug/trial_0.avi and of mug/trial_1.avi" in line


def test_a_force_that_is_never_near_zero_is_told(tmp_path: Path) -> None:
    for trial, rest in enumerate((12.3, 12.3)):
        film(tmp_path / f"trial_{trial}.avi")
        forces(tmp_path / f"trial_{trial}.csv", 0, rest)
    _, doubts = read(tmp_path)
    assert "fz of {stem}.csv is never near 0 (12.3 to 14.2)" in told(doubts, "never near")
    for trial in range(2):
        forces(tmp_path / f"trial_{trial}.csv", 0)
    assert not any("never near" in line for line in read(tmp_path)[1])


def test_an_unread_table_of_forces_is_told_with_its_key(tmp_path: Path) -> None:
    for trial in range(3):
        film(tmp_path / f"video_{trial}.avi")
        forces(tmp_path / f"force_{trial + 1:03d}.csv", 0)
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in whole(found).values())
    line = told(doubts, "force_001.csv and 2 more are left out")
    assert line.endswith("force: {file: force_001.csv, columns: [fx, fy, fz], times: t}")


def test_wide_pictures_may_be_of_two_sensors(tmp_path: Path) -> None:
    film(tmp_path / "wide.avi", (24, 64))
    _, doubts = read(tmp_path)
    crops = "crops: {left: {box: [0, 0, 32, 24]}, right: {box: [32, 0, 32, 24]}}"
    assert told(doubts, "pictures of 24 x 64").endswith(crops)


def test_computed_pictures_of_a_simulator_are_no_touch(tmp_path: Path) -> None:
    for item in ("mug", "can"):
        for kind in ("tactile_images", "gt_heightmaps", "gt_contactmasks"):
            images(tmp_path / item / kind, [f"{n:03d}" for n in range(COUNT)])
    found, doubts = read(tmp_path)
    assert sorted(whole(found)) == ["can/tactile_images", "mug/tactile_images"]
    assert told(doubts, "left out", "gt_contactmasks")


def test_pictures_before_a_touch_are_its_background_by_folders_too(tmp_path: Path) -> None:
    for grasp in range(4):
        for when in ("touch_before", "touch_during"):
            touch(tmp_path / f"grasp_{grasp}/{when}/left.png")
    found, _ = read(tmp_path)
    assert sorted(whole(found)) == [f"grasp_{n}/touch_during/left.png" for n in range(4)]
    for name, one in whole(found).items():
        before = np.asarray(Image.open(tmp_path / name.replace("during", "before")))
        assert one.no_contact is not None
        np.testing.assert_array_equal(one.no_contact.read([0])[0], before)


def test_versions_of_pictures_are_told_by_words_of_names(tmp_path: Path) -> None:
    for version in ("raw", "cropped"):
        for trial in range(3):
            film(tmp_path / f"trial_{trial}_{version}.avi")
    assert told(read(tmp_path)[1], "cropped and raw may be the same recordings")


@pytest.mark.parametrize(
    ("names", "column", "words"),
    [
        (["cup_00", "cup_01", "bolt_02", "bolt_03"], "object", ["cup", "cup", "bolt", "bolt"]),
        (["grasp_0_ok", "grasp_1_slip", "grasp_2_ok", "grasp_3_slip"], "word", ["ok", "slip"] * 2),
    ],
)
def test_words_in_names_are_told_with_a_command_for_labels(
    names: Sequence[str], column: str, words: Sequence[str], tmp_path: Path
) -> None:
    for name in names:
        film(tmp_path / f"{name}.avi")
    _, doubts = read(tmp_path)
    made = told(doubts, "object: names have words").partition("name it): ")[2]
    subprocess.run(["sh", "-c", made.replace("word", column)], cwd=tmp_path, check=True)
    found, doubts = read(tmp_path)
    assert not any("names have words" in line for line in doubts)
    for name, word in zip(names, words, strict=True):
        one = whole(found)[f"{name}.avi"]
        assert (one.object if column == "object" else one.labels["word"]) == word


@pytest.mark.parametrize(
    "names", [["trial_0", "trial_1"], ["left_0", "right_0"], ["cam0_1", "cam1_1"], ["a_1", "b_2"]]
)
def test_numbers_sides_and_devices_in_names_are_no_words(
    names: Sequence[str], tmp_path: Path
) -> None:
    for name in names:
        film(tmp_path / f"{name}.avi")
    assert not any("names have words" in line for line in read(tmp_path)[1])


def test_outcomes_of_folders_are_labels_by_a_command(tmp_path: Path) -> None:
    for number, outcome in enumerate(["success", "success", "failure", "failure"]):
        images(tmp_path / f"{outcome}/grasp_{number}", [f"{n:03d}" for n in range(COUNT)])
    _, doubts = read(tmp_path)
    made = told(doubts, "named by what came of it").partition("a table of it is: ")[2]
    subprocess.run(["sh", "-c", made], cwd=tmp_path, check=True)
    found, _ = read(tmp_path)
    for name, one in whole(found).items():
        assert one.labels["outcome"] == name.partition("/")[0]
