"""Folders in the place of a chunk, and of a file: said, and the rest is read."""

from pathlib import Path

from made_episodes import open_x_tactile
from tactileforge_episodes.dataset import Episodes


def test_a_folder_in_the_place_of_a_chunk_is_a_missing_chunk(tmp_path: Path) -> None:
    open_x_tactile(tmp_path, seconds=True)
    chunks = [one for one in tmp_path.rglob("[0-9]*.0") if "pose" in str(one.parent)]
    chunk = max(chunks)
    chunk.unlink()
    chunk.mkdir()
    data = Episodes(str(tmp_path), val=0)
    assert [*data.recordings("train")]
    said = [line for line in data.notes if chunk.parent.name in line and "chunk" in line]
    assert len(said) == 1, data.notes


def test_an_empty_folder_in_the_place_of_a_file_is_named(tmp_path: Path) -> None:
    open_x_tactile(tmp_path, seconds=True)
    (tmp_path / "b.npz").mkdir()
    data = Episodes(str(tmp_path), val=0)
    assert [*data.recordings("train")]
    assert data.skipped == [f"{tmp_path / 'b.npz'}: no regular file but an empty folder; remove it"]
