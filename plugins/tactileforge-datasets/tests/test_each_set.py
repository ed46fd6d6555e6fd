"""The duties of every reader of this package."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from made_sets import MADE, save_picture

from tactileforge import cli
from tactileforge.plugin import ConfigError, DataNotFoundError, PublishedDataset
from tactileforge.plugins import registry
from tactileforge.testing import check

ROOT = Path(__file__).parents[3]
each = pytest.mark.parametrize("name", MADE)


@each
def test_its_facts_and_its_row_in_the_docs(name: str) -> None:
    reader = registry.get("datasets", name)
    assert issubclass(reader, PublishedDataset)
    assert reader.name == name
    assert 1 <= reader.tier <= 5
    assert all((reader.url.startswith("https://"), reader.licence, reader.citation, reader.tree))
    page = (ROOT / "docs/datasets.md").read_text()
    assert page.count(f"{reader.row()}\n") == 1, f"docs/datasets.md needs the line\n{reader.row()}"
    assert page.count(f"\n| `{name}` | seen:") == 1, "what was seen, and what is inferred"


@each
def test_it_conforms(name: str, make) -> None:
    results = check("dataset", registry.get("datasets", name), root=str(make(name)))
    assert [result for result in results if result.status == "failed"] == []
    assert sum(result.status == "ran" for result in results) >= 8


@each
def test_recordings_are_whole_lazy_and_travel_to_workers(name: str, make) -> None:
    data = registry.build("datasets", {"name": name, "root": str(make(name)), "val": 0})
    recordings = list(data.recordings("train"))
    assert len({recording.key for recording in recordings}) == len(recordings) > 0
    for recording in recordings:
        count = len(recording.times)
        assert len(recording.frames) == count
        assert recording.times[0] == 0
        assert (np.diff(recording.times) > 0).all()
        assert recording.force is None or (recording.force.dtype, recording.force.shape) == (
            np.float32,
            (count, 3),
        )
        assert {len(track) for track in recording.tracks.values()} <= {count}
        assert recording.licence
        assert recording.key.startswith(f"{name}/")
        other = pickle.loads(pickle.dumps(recording))
        np.testing.assert_array_equal(
            other.frames.read([count - 1]), recording.frames.read([count - 1])
        )
        assert recording.frames.read([0]).shape == (1, *recording.frames.shape, 3)
    forces = [recording.force[:, 2] for recording in recordings if recording.force is not None]
    assert not forces or np.nanmean(np.concatenate(forces)) > 0, "pressing is positive"


@each
def test_it_is_recognised_alone(name: str, make, tmp_path: Path) -> None:
    root = make(name)
    guesses = {other: registry.get("datasets", other).recognise(root) for other in MADE}
    assert [other for other, guess in guesses.items() if guess] == [name]
    guess = guesses[name]
    assert guess is not None
    assert guess.options == {"root": str(root)}
    assert 0.5 <= guess.score <= 1
    assert guess.doubts
    found = registry.build("datasets", {"name": name, **guess.options}).recordings("train")
    assert next(iter(found)).key.startswith(name)


@each
def test_foreign_folders_are_not_recognised(name: str, tmp_path: Path) -> None:
    save_picture(tmp_path / "a/b/0.png", 0)
    (tmp_path / "data").mkdir()
    (tmp_path / "data/train-0.parquet").write_bytes(b"PAR1")
    (tmp_path / "a/train-0.parquet").write_bytes(b"no table")
    (tmp_path / "catalog.csv").write_text("name,price\nball,1\n")
    for place in (tmp_path, tmp_path / "gone", tmp_path / "catalog.csv"):
        assert registry.get("datasets", name).recognise(place) is None


@each
def test_missing_data_and_bad_options_are_named(name: str, tmp_path: Path) -> None:
    reader = registry.get("datasets", name)
    with pytest.raises(DataNotFoundError) as caught:
        list(reader(str(tmp_path)).recordings("train"))
    for part in (name, str(tmp_path), reader.url, "data.root", reader.tree):
        assert part in str(caught.value)
    with pytest.raises(ConfigError, match=f"{name}: unknown split 'al'.*Known: .*all"):
        reader(".", split="al")


@pytest.mark.slow
@each
def test_the_commands_take_it(name: str, make, tmp_path: Path, monkeypatch, capsys) -> None:
    root = make(name)
    monkeypatch.chdir(tmp_path)
    data = [f"data={name}", f"data.root={root}", "data.split=all", "data.val=0.5"]
    assert cli.run(["data", "inspect", *data, "out=page.html"]) == 0, capsys.readouterr().err
    assert name in Path("page.html").read_text()
    assert cli.run(["data", "pack", *data, "out=packed"]) == 0, capsys.readouterr().err
    words = ["objective=[pixel]", "scale=tiny", "debug=steps", "hydra.run.dir=run"]
    words += ["encoder.image_size=32", "batch.workers=0"]
    assert cli.run(["train", *data, *words]) == 0, capsys.readouterr().err
