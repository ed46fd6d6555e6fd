"""Unread files are named with a way to read them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge.contracts import Guess
from tactileforge.datasets.recognition import recognise
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.reading.linked import matches
from tactileforge.reading.records import conversion, read_records


def picture(path: Path, grey: int = 60) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((24, 32, 3), grey, np.uint8))


def guessed(root: Path) -> tuple[Guess, Recordings]:
    guess = Recordings.recognise(root)
    assert guess is not None
    return guess, Recordings(**guess.options)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("trial_0.zip", "an archive: unzip trial_0.zip -d trial_0"),
        ("a b.tar.gz", "an archive: mkdir -p 'a b' && tar -xf 'a b.tar.gz' -C 'a b'"),
        ("forces.csv.gz", "compressed: gunzip forces.csv.gz"),
        ("data.h5", "an HDF5: python -c "),
        ("train.pt", "PyTorch's; a dictionary of tensors: python -c "),
        ("run.lvm", "a table of LabVIEW: awk 'n > 1; /End_of_Header/ {n++}' run.lvm > run.tsv"),
        ("run.tdms", "LabVIEW's: pip install nptdms pandas && python -c "),
        ("x-train.tfrecord-00000-of-00001", "records of TensorFlow"),
        ("train.lmdb/data.mdb", "an LMDB: python -c "),
        ("train.lmdb/lock.mdb", ""),
        ("film.mp4", ""),
    ],
)
def test_each_kind_has_its_command(name: str, says: str) -> None:
    found = conversion(Path(name))
    assert found.startswith(says) if says else not found


def test_an_archive_that_nobody_reads_is_named_with_its_command(tmp_path: Path) -> None:
    for i in range(3):
        (tmp_path / f"trial_{i}.zip").write_bytes(b"PK\x03\x04")
    with pytest.raises(
        DataNotFoundError,
        match=r"trial_0.zip is an archive: unzip trial_0.zip -d trial_0 \(and 2 more files\)",
    ):
        recognise(tmp_path)


def test_arrays_of_another_form_are_named_with_theirs(tmp_path: Path) -> None:
    np.save(tmp_path / "force.npy", np.zeros((5, 3)))
    np.save(tmp_path / "tactile.npy", np.full((5, 24, 32, 3), 0.5, np.float32))
    with pytest.raises(DataNotFoundError, match=r"tactile.npy: float32 values from 0.5"):
        recognise(tmp_path)


def test_a_dictionary_in_an_array_is_named_with_its_conversion(tmp_path: Path) -> None:
    np.save(tmp_path / "trial.npy", {"a": np.zeros(3)}, allow_pickle=True)  # type: ignore[arg-type]
    with pytest.raises(DataNotFoundError, match=r"objects of Python, .*numpy.savez\('trial.npz'"):
        recognise(tmp_path)


def test_files_beside_pictures_are_named(tmp_path: Path) -> None:
    for i in range(4):
        picture(tmp_path / f"images/{i}.png", 40 * i)
    (tmp_path / "forces.zip").write_bytes(b"PK\x03\x04")
    (tmp_path / "data.h5").write_bytes(b"\x89HDF")
    (tmp_path / "labels.txt").write_text("all are rough\n")
    (tmp_path / "README.txt").write_text("5 touches\n")
    doubts = "\n".join(guessed(tmp_path)[0].doubts)
    for name in ("forces.zip is left out: an archive", "data.h5 is left out", "labels.txt is left"):
        assert name in doubts
    assert "README" not in doubts
    (tmp_path / "labels.txt").write_text("0.png 0.1 0.2 0.3\n")
    assert "labels: 1, 2, 3 by labels.txt" in guessed(tmp_path)[0].doubts


def test_a_link_to_a_folder_beside_it_counts_once(tmp_path: Path) -> None:
    for i in range(3):
        for n in range(4):
            picture(tmp_path / f"trial_{i}/{n}.png", 40 + 10 * n)
    (tmp_path / "latest").symlink_to(tmp_path / "trial_2")
    left_out: list[Path] = []
    found = matches(tmp_path, "*/*.png", left_out.append)
    assert {path.parent.name for path in found} == {f"trial_{i}" for i in range(3)}
    assert left_out == [tmp_path / "latest"]


def test_the_object_is_named_above_the_trial(tmp_path: Path) -> None:
    for name in ("mug", "bolt"):
        for side in ("left", "right"):
            for n in range(8):
                picture(tmp_path / f"user01/{name}/trial3/{side}/{n}.png", 40 + 10 * n)
    guess, data = guessed(tmp_path)
    found = {one.key: one.object for one in data.recordings("train")}
    found |= {one.key: one.object for one in data.recordings("val")}
    assert all(of == key.split("/")[-3] for key, of in found.items())
    assert len(found) == 4
    assert "object: named by the folder above that of a trial" in guess.doubts


def test_a_value_is_no_name_of_an_object(tmp_path: Path) -> None:
    for value in ("0.5N", "1.0N"):
        for n in range(3):
            picture(tmp_path / f"{value}/{n}.png", 40 * n)
    guess, data = guessed(tmp_path)
    assert {one.object for one in data.recordings("train")} == {None}
    assert any("folders are named by a value (0.5N)" in line for line in guess.doubts)


def test_a_word_of_touch_is_no_name_of_an_object(tmp_path: Path) -> None:
    for take in range(3):
        for moment in ("before", "after"):
            picture(tmp_path / f"{take}/touch_{moment}/0.png", 40 + 60 * take)
    guess, data = guessed(tmp_path)
    assert {one.object for one in data.recordings("train")} == {None}
    assert not any(line.startswith("object") for line in guess.doubts)


def test_categories_of_coco_are_labels_of_images(tmp_path: Path) -> None:
    names = [f"{i:03d}.png" for i in range(4)]
    for i, name in enumerate(names):
        picture(tmp_path / f"images/{name}", 40 * i)
    content = {
        "info": {},
        "images": [{"id": i + 7, "file_name": name} for i, name in enumerate(names)],
        "annotations": [{"id": i, "image_id": i + 7, "category_id": i % 2} for i in range(4)],
        "categories": [{"id": 0, "name": "crack"}, {"id": 1, "name": "bump"}],
    }
    path = tmp_path / "annotations.json"
    path.write_text(json.dumps(content))
    _, data = guessed(tmp_path)
    found = {one.key[-7:]: one.labels["category"] for one in data.recordings("train")}
    found |= {one.key[-7:]: one.labels["category"] for one in data.recordings("val")}
    assert found == dict(zip(names, ["crack", "bump"] * 2, strict=True))
    content["annotations"].append({"id": 9, "image_id": 7, "category_id": 1})  # type: ignore[attr-defined]
    path.write_text(json.dumps(content))
    assert [cells for _, cells in read_records(path)] == [{"file_name": name} for name in names]


def test_a_folder_of_a_trial_without_pictures_is_named(tmp_path: Path) -> None:
    for k in range(3):
        for n in range(8):
            picture(tmp_path / f"trial_{k}/gel/{n}.png", 60 + n)
    (tmp_path / "notes_3").mkdir()
    (tmp_path / "trial").mkdir()

    def lines() -> list[str]:
        guess = Recordings.recognise(tmp_path)
        assert guess is not None
        return [line for line in guess.doubts if line.startswith("touch:")]

    assert lines() == []
    (tmp_path / "trial_3/gel").mkdir(parents=True)
    there = "no picture or film of touch, and no recording is there"
    assert lines() == [f"touch: trial_3 has {there}"]
    (tmp_path / "trial_12").mkdir()
    (tmp_path / "trial_12/forces.csv").write_text("frame,fz\n0,1\n")
    assert lines() == [f"touch: trial_12 and 1 more have {there}"]


@pytest.mark.parametrize("ending", ["json", "yaml"])
def test_lists_of_numbers_are_columns_like_those_of_an_array(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"times.{ending}"
    path.write_text(str([n / 4 for n in range(9)]))
    assert [cells for _, cells in read_records(path)] == [{"0": str(n / 4)} for n in range(9)]
    path.write_text(str([[n, 2 * n] for n in range(9)]))
    wanted = [{"0": str(n), "1": str(2 * n)} for n in range(9)]
    assert [cells for _, cells in read_records(path)] == wanted
    # a vector, rows of other lengths, and a picture
    for content in ([0.1, 0.2, 2], [*([[1, 2]] * 8), [1]], [[0] * 320] * 9):
        path.write_text(str(content))
        with pytest.raises(DataError, match="where a row of named values is wanted"):
            read_records(path)
