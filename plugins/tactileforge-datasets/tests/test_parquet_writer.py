"""Any data set as parquet with images: read back to the bit, here and by other programs."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pyarrow import parquet
from tactileforge_datasets.image_tables import ImageTables
from tactileforge_datasets.parquet_writer import write_parquet

from tactileforge import cli
from tactileforge.contracts import ACTIONS, FrameSubset, Recording
from tactileforge.data import ArrayFrames
from tactileforge.datasets import recognise
from tactileforge.errors import ConfigError, DataError
from tactileforge.testing import check

COUNT = 70


def recording(name: str, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    frames = ArrayFrames(rng.integers(0, 256, (COUNT, 12, 16, 3), np.uint8))
    force = rng.normal(0, 1, (COUNT, 3)).astype(np.float32)
    force[3] = np.nan
    return Recording(
        key=name,
        sensor="digit",
        frames=frames,
        times=np.cumsum(rng.uniform(0.01, 0.05, COUNT)),
        no_contact=FrameSubset(frames, [0]),
        force=force,
        action=rng.integers(-1, len(ACTIONS), COUNT),
        object="mug",
        text="touching a mug",
        licence="CC0-1.0",
    )


@pytest.fixture
def written(tmp_path: Path) -> Path:
    parts = {"train": [recording("a/1", 1), recording("a/2", 2)], "val": [recording("b", 3)]}
    assert write_parquet(parts, tmp_path / "set", 500) == {"train": 2 * COUNT, "val": COUNT}
    return tmp_path / "set"


def test_recordings_are_read_back_with_no_key_typed(written: Path) -> None:
    name, guess = recognise(written)[0]
    assert name == "image_tables"
    data = ImageTables(**guess.options)
    found = {split: list(data.recordings(split)) for split in ("train", "val")}
    assert [len(one) for one in found.values()] == [2, 1]
    for seed, one in enumerate([*found["train"], *found["val"]], 1):
        wanted = recording("", seed)
        every = range(COUNT)
        np.testing.assert_array_equal(one.frames.read(every), wanted.frames.read(every))
        np.testing.assert_array_equal(one.force, wanted.force)
        np.testing.assert_array_equal(one.times, wanted.times - wanted.times[0])
        assert (one.sensor, one.object, one.text) == ("digit", "mug", "touching a mug")


def test_pyarrow_reads_each_column(written: Path) -> None:
    wanted = recording("b", 3)
    table = parquet.read_table(written / "validation-00000-of-00001.parquet").to_pylist()
    assert [row["timestamp"] for row in table] == wanted.times.tolist()
    assert table[3]["force_z"] is None
    assert wanted.force is not None
    assert table[5]["force_z"] == float(wanted.force[5, 2])
    actions = [-1 if row["action"] is None else ACTIONS.index(row["action"]) for row in table]
    assert wanted.action is not None
    assert actions == wanted.action.tolist()
    with Image.open(io.BytesIO(table[7]["image"]["bytes"])) as image:
        np.testing.assert_array_equal(np.asarray(image), wanted.frames.read([7])[0])


def test_datasets_of_hugging_face_reads_images(written: Path) -> None:
    datasets = pytest.importorskip("datasets")
    files = {"train": [str(path) for path in sorted(written.glob("train*"))]}
    found = datasets.load_dataset(
        "parquet", data_files=files, cache_dir=str(written.parent / "cache")
    )["train"]
    wanted = recording("a/1", 1)
    np.testing.assert_array_equal(np.asarray(found[7]["image"]), wanted.frames.read([7])[0])


def test_files_end_at_their_size(tmp_path: Path) -> None:
    write_parquet({"train": [recording("a", 1), recording("b", 2)]}, tmp_path / "set", 0.01)
    names = sorted(path.name for path in (tmp_path / "set").iterdir())
    assert len(names) > 1
    assert names[-1] == f"train-{len(names) - 1:05d}-of-{len(names):05d}.parquet"
    assert sum(parquet.read_table(tmp_path / "set" / name).num_rows for name in names) == 2 * COUNT


def test_nothing_is_overwritten_or_empty(written: Path) -> None:
    with pytest.raises(ConfigError, match=r"set exists: give another out="):
        write_parquet({"train": [recording("a", 1)]}, written, 500)
    with pytest.raises(DataError, match="no recordings to write"):
        write_parquet({"train": []}, written.parent / "other", 500)
    assert not (written.parent / "other").exists()


def test_the_verb_conforms() -> None:
    assert {one.status for one in check("verb", "data.parquet")} == {"ran"}


@pytest.mark.slow
def test_the_command_writes_a_set_that_is_recognised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["data", "parquet", "data=sim", "data.scenes=2", "data.val=1", "data.size=32"]
    assert cli.run([*words, f"out={tmp_path / 'set'}"]) == 0
    assert "rows: train" in capsys.readouterr().out
    assert recognise(tmp_path / "set")[0][0] == "image_tables"
