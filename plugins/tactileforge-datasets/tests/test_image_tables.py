"""Tables with images in their cells: parquet, and the folders of ``save_to_disk``."""

import io
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pytest
from PIL import Image
from pyarrow import parquet
from tactileforge_datasets.image_tables import ImageTables

from tactileforge.contracts import Recording
from tactileforge.datasets.recognition import recognise
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.testing import check

COUNT, TRIALS = 8, 3
OBJECTS = ["mug", "bolt", "key"]


def picture(trial: int, n: int, side: int = 0) -> np.ndarray[Any, np.dtype[np.uint8]]:
    out = np.full((12, 16, 3), (60 + 40 * trial + 3 * n, 90, 120 + 30 * side), np.uint8)
    out[3:5, n : n + 3] = 200
    return out


def encoded(trial: int, n: int, side: int = 0) -> dict[str, Any]:
    file = io.BytesIO()
    Image.fromarray(picture(trial, n, side)).save(file, "png")
    return {"bytes": file.getvalue(), "path": f"{trial}_{n}.png"}


def force(trial: int, n: int) -> list[float]:
    return [0.1 * n + trial, -0.05 * n, 0.25 * n * (trial + 1)]


def rows(*names: str) -> list[dict[str, Any]]:
    """Rows of all images, with the columns of some names."""
    out = []
    for trial in range(TRIALS):
        for n in range(COUNT):
            row = {
                "image": encoded(trial, n),
                "force": force(trial, n),
                "fx": force(trial, n)[0],
                "fy": force(trial, n)[1],
                "fz": force(trial, n)[2],
                "object": OBJECTS[trial],
                "label": trial,
                "episode_index": trial,
                "timestamp": n / 20,
                "tactile_left": encoded(trial, n),
                "tactile_right": encoded(trial, n, 1),
                "wrist": encoded(trial, n, 2),
            }
            out.append({name: row[name] for name in names})
    return out


def write(path: Path, table: Sequence[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.Table.from_pylist([*table]), path)


def saved(path: Path, table: Sequence[dict[str, Any]], **features: Any) -> Any:
    """A data set of Hugging Face, if the library is installed."""
    datasets = pytest.importorskip("datasets")
    known = {"image": datasets.Image(), "object": datasets.Value("string")}
    known["force"] = datasets.Sequence(datasets.Value("float32"), length=3)
    known |= {"episode_index": datasets.Value("int64"), "timestamp": datasets.Value("float64")}
    known |= {"label": datasets.ClassLabel(names=OBJECTS)}
    made = datasets.Dataset.from_list(
        [*table], features=datasets.Features({name: known[name] for name in table[0]})
    )
    return datasets, made


def read(root: Path) -> tuple[list[Recording], ImageTables, Sequence[str]]:
    name, guess = recognise(root)[0]
    assert name == "image_tables"
    data = ImageTables(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return found, data, guess.doubts


def matches(found: Sequence[Recording]) -> None:
    """All images are there once, each with its force and object."""
    seen = set()
    for one in found:
        frames = one.frames.read(range(len(one.frames)))
        at = [((grey - 60) // 40, (grey - 60) % 40 // 3) for grey in frames[:, 0, 0, 0].tolist()]
        seen |= {*at}
        np.testing.assert_array_equal(frames, np.stack([picture(*place) for place in at]))
        wanted = np.array([force(*place) for place in at], np.float32)
        np.testing.assert_array_equal(one.force, wanted)
        assert {one.object} == {OBJECTS[trial] for trial, _ in at}
    assert len(seen) == TRIALS * COUNT


def test_parquet_with_episodes(tmp_path: Path) -> None:
    table = rows("image", "force", "object", "episode_index", "timestamp")
    write(tmp_path / "data/train-00000-of-00002.parquet", table[: COUNT + 3])
    write(tmp_path / "data/train-00001-of-00002.parquet", table[COUNT + 3 :])  # cuts an episode
    found, data, _ = read(tmp_path)
    matches(found)
    assert [len(one.frames) for one in found] == [COUNT] * TRIALS
    np.testing.assert_allclose(found[0].times, np.arange(COUNT) / 20)
    assert data.held_out == ["by recording (episode_index), with all its sensors and cameras"]
    # of few, one is held out, whatever the share is
    assert [len([*data.recordings(side)]) for side in ("train", "val")] == [TRIALS - 1, 1]
    results = check("dataset", data)
    assert {one.status for one in results} <= {"ran", "skipped"}, results


def test_a_file_for_each_recording(tmp_path: Path) -> None:
    table = rows("image", "force", "object", "timestamp")
    for trial in range(TRIALS):
        write(tmp_path / f"run{trial}.parquet", table[trial * COUNT : (trial + 1) * COUNT])
    found, data, doubts = read(tmp_path)
    assert data.recording == "{file}"
    assert data.held_out == ["by recording (file), with all its sensors and cameras"]
    matches(found)
    assert "recording: each file is one, as timestamp rises in it" in doubts
    # parts of one table are no recordings
    (tmp_path / "parts").mkdir()
    for trial in range(TRIALS):
        file = tmp_path / f"run{trial}.parquet"
        file.rename(tmp_path / f"parts/data-0000{trial}-of-00003.parquet")
    assert read(tmp_path / "parts")[1].recording == ""


def test_parquet_without_episodes_keeps_its_splits(tmp_path: Path) -> None:
    table = rows("image", "fx", "fy", "fz", "object")
    write(tmp_path / "data/train-00000-of-00001.parquet", table[COUNT:])
    write(tmp_path / "data/validation-00000-of-00001.parquet", table[:COUNT])
    found, data, doubts = read(tmp_path)
    matches(found)
    assert {one.object for one in data.recordings("val")} == {"mug"}
    assert "each row is one" in "".join(doubts)
    assert data.held_out == ["the files of validation and test"]


def test_two_sensors_and_a_camera(tmp_path: Path) -> None:
    table = rows("tactile_left", "tactile_right", "wrist", "episode_index", "force")
    write(tmp_path / "all.parquet", table)
    found, data, doubts = read(tmp_path)
    assert len(found) == 2 * TRIALS
    assert {one.key for one in found if one.key.startswith("1/")} == {
        "1/tactile_left",
        "1/tactile_right",
    }
    for one in found:
        trial, side = int(one.key[0]), int(one.key.endswith("right"))
        frames = one.frames.read(range(COUNT))
        np.testing.assert_array_equal(frames, [picture(trial, n, side) for n in range(COUNT)])
        assert one.image is not None
        np.testing.assert_array_equal(one.image.read([5])[0], picture(trial, 5, 2))
    assert "camera: wrist is the view of the scene" in doubts
    data.val = 0.5
    held = {one.key[0] for one in data.recordings("val")}
    assert not held & {one.key[0] for one in data.recordings("train")}


def test_a_folder_of_save_to_disk(tmp_path: Path) -> None:
    table = rows("image", "force", "object", "episode_index", "timestamp")
    _, made = saved(tmp_path, table)
    made.save_to_disk(str(tmp_path / "set"))
    found, _, _ = read(tmp_path / "set")
    matches(found)
    assert len(found) == TRIALS


def test_splits_and_classes_of_save_to_disk(tmp_path: Path) -> None:
    datasets, train = saved(tmp_path, rows("image", "force", "label")[COUNT:])
    _, test = saved(tmp_path, rows("image", "force", "label")[:COUNT])
    both = datasets.DatasetDict({"train": train, "test": test})
    both.save_to_disk(str(tmp_path / "set"))
    found, data, _ = read(tmp_path / "set")
    matches(found)
    assert {one.object for one in data.recordings("val")} == {"mug"}


def test_arrow_as_save_to_disk_writes_it(tmp_path: Path) -> None:
    """The same without the package: a stream of batches, and the names of classes beside it."""
    feature = {"names": OBJECTS, "_type": "ClassLabel"}
    about = json.dumps({"info": {"features": {"label": feature}}}).encode()
    table = arrow.Table.from_pylist(rows("image", "force", "label"))
    table = table.replace_schema_metadata({b"huggingface": about})
    path = tmp_path / "train/data-00000-of-00001.arrow"
    path.parent.mkdir()
    with arrow.ipc.new_stream(str(path), table.schema) as file:
        file.write_table(table, max_chunksize=5)
    (tmp_path / "train/state.json").write_text("{}")
    found, _, _ = read(tmp_path)
    matches(found)


def test_images_that_no_name_tells_are_asked_for(tmp_path: Path) -> None:
    table = [{"a": row["image"], "b": row["image"]} for row in rows("image")]
    write(tmp_path / "all.parquet", table)
    with pytest.raises(
        DataNotFoundError, match=r"images in a, b; say which are touch: .*touch=\[a"
    ):
        recognise(tmp_path)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"touch": ["imag"]}, "unknown column of images .* 'imag'; did you mean 'image'"),
        ({"force": [None, None, "fz "]}, "unknown column of .* 'fz '; did you mean 'fz'"),
        ({"force": ["fz"]}, "three columns"),
        ({"sensor": ""}, "data.sensor are missing"),
        ({"time_unit": "h"}, "time_unit=h; give one of s, ms"),
    ],
)
def test_wrong_options_are_named(options: dict[str, Any], words: str, tmp_path: Path) -> None:
    write(tmp_path / "all.parquet", rows("image", "fz"))
    given = {"touch": ["image"], "sensor": "digit", **options}
    with pytest.raises(ConfigError, match=words):
        list(ImageTables(str(tmp_path), **given).recordings("train"))


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def without_images(path: Path) -> None:
    bad = [{**row, "image": {"bytes": b"", "path": "a.png"}} for row in rows("image", "fz")]
    write(path, bad)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(cut_off, "no parquet file, or damaged"), (without_images, "no bytes of a picture")],
)
def test_damage_is_named(spoil: Callable[[Path], None], words: str, tmp_path: Path) -> None:
    path = tmp_path / "all.parquet"
    write(path, rows("image", "fz"))
    spoil(path)
    data = ImageTables(str(tmp_path), touch=["image"], sensor="digit")
    with pytest.raises(DataError, match=words):
        [one.frames.read([0]) for one in data.recordings("train")]


def test_a_pipe_in_the_place_of_a_table_is_named_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "train.parquet")
    with pytest.raises(DataError, match=r"train\.parquet: .*no regular file but a pipe"):
        ImageTables.recognise(tmp_path)
