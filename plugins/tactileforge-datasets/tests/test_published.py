"""Invariants of every reader of a published data set."""

import inspect
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import Dataset, FrameSubset
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.reading.published import (
    NumberedImages,
    PublishedDataset,
    frame_times,
    label_runs,
    median_frames,
    still_background,
)
from tactileforge.specs.published import SPECS

Make = Callable[..., Any]
ROOT = Path(__file__).parents[1]
ENTRIES = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]


def _readers() -> dict[str, type[PublishedDataset]]:
    found = {}
    for name, target in ENTRIES["tactileforge.datasets"].items():
        module, _, attribute = target.partition(":")
        reader = getattr(import_module(module), attribute)
        if inspect.isclass(reader) and issubclass(reader, PublishedDataset):
            found[name] = reader
    return found


READERS = _readers()
each_reader = pytest.mark.parametrize(("name", "reader"), READERS.items(), ids=READERS)


def test_all_of_them_are_registered() -> None:
    files = {path.stem for path in (ROOT / "src/tactileforge_datasets").glob("*.py")}
    assert len(READERS) == 25
    assert set(READERS) <= files, "one per file, of its name"


@each_reader
def test_facts(name: str, reader: type[PublishedDataset]) -> None:
    assert reader.name == name
    assert set(reader.sensors) <= {*SPECS, "serial_array"}
    assert 1 <= reader.tier <= 5
    assert reader.url.startswith(("http://", "https://"))
    assert all((reader.licence, reader.citation, reader.tree))
    assert len({split.name for split in reader.splits}) == len(reader.splits)
    assert isinstance(reader("."), Dataset)


@each_reader
def test_missing_data(name: str, reader: type[PublishedDataset], tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError) as caught:
        list(reader(str(tmp_path)).recordings("train"))
    for part in (name, str(tmp_path), reader.url, "data.root", reader.tree):
        assert part in str(caught.value)
    with pytest.raises(DataNotFoundError):
        list(reader(str(tmp_path / "gone")).recordings("val"))


@each_reader
def test_foreign_folders_are_not_recognised(
    name: str, reader: type[PublishedDataset], tmp_path: Path, make_images: Make, write: Make
) -> None:
    make_images("a/b/{}.png", range(2))
    make_images("frames/{:04d}.jpg", range(2))
    write("train.csv", "file,fx,fy,fz\n")
    write("labels.json", "{}")
    write("._all_data_direction.json", "")
    for place in (tmp_path, tmp_path / "train.csv", tmp_path / "gone"):
        assert reader.recognise(place) is None


@each_reader
def test_bad_arguments(name: str, reader: type[PublishedDataset]) -> None:
    with pytest.raises(ConfigError, match=f"{name}: unknown split 'al'.*Known: .*all"):
        reader(".", split="al")
    with pytest.raises(ConfigError, match=f"{name}: val is 1"):
        reader(".", val=1)
    with pytest.raises(ConfigError, match="unknown side of a split 'tests'"):
        next(iter(reader(".").recordings("tests")))


@each_reader
def test_the_page_lists_it(name: str, reader: type[PublishedDataset]) -> None:
    page = (ROOT.parents[1] / "docs/datasets.md").read_text()
    assert page.count(f"{reader.row()}\n") == 1, f"docs/datasets.md needs the line\n{reader.row()}"


def test_numbered(make_images: Make, tmp_path: Path, write: Make, levels: Make) -> None:
    make_images("a/frame{:04d}.jpg", (2, 10, 9))
    make_images("a/mask{}.jpg", (30,))
    write("a/._frame0003.jpg", "")
    write("a/frame0004.txt", "")
    files = NumberedImages(tmp_path / "a", r"frame\d+")
    assert list(files.files) == [2, 9, 10]
    assert levels(files.frames()) == [2, 9, 10]
    assert levels(files.nearest([0, 5, 6, 10, 99])) == [2, 2, 9, 10, 10]
    assert list(NumberedImages(tmp_path / "a").files) == [2, 9, 10, 30]
    assert levels(NumberedImages(tmp_path / "a", r"mask\d+").nearest([1, 40])) == [30, 30]
    none = NumberedImages(tmp_path / "gone")
    assert none.nearest([1]) is None
    with pytest.raises(DataError, match="gone: no image"):
        none.frames()


def test_helpers(make_images: Make, tmp_path: Path, levels: Make) -> None:
    assert list(label_runs([3, 4, 6, 7, 8], "aaaab")) == [slice(0, 2), slice(2, 4), slice(4, 5)]
    assert list(label_runs([], [])) == []
    np.testing.assert_allclose(frame_times([4, 5, 8], 2), [0, 0.5, 2])
    make_images("{}.png", range(33))
    frames = NumberedImages(tmp_path).frames()
    assert levels(median_frames(frames))[::7] == [0, 16, 32]
    assert still_background(tmp_path / "gone.png", frames) is None
    (tmp_path / "bad.png").write_bytes(b"")
    with pytest.raises(DataError, match=r"bad\.png: not a readable image"):
        still_background(tmp_path / "bad.png", frames)


@each_reader
@pytest.mark.parametrize("word", ["nan", "None", "N/A", ""])
def test_a_word_for_no_value_is_no_caption(
    name: str, reader: type[PublishedDataset], word: str
) -> None:
    frames = FrameSubset(ArrayFrames(np.zeros((1, 4, 4, 3), np.uint8)), [0])
    about = {"sensor": "digit", "frames": frames, "times": np.zeros(1), "no_contact": None}
    one = reader(".")._recording("a", object=word, text=word, **about)
    assert (one.key, one.object, one.text) == (f"{name}/a", None, None)


@each_reader
def test_every_reader_says_what_is_held_out(name: str, reader: type[PublishedDataset]) -> None:
    for split in reader.splits:
        (line,) = reader(".", split=split.name).held_out
        assert f"split {split.name}: {split.about}" in line
        assert line.startswith("by object, film or session") != bool(split.val)
