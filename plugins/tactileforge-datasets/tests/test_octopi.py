from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.octopi import Octopi
from videos import greys, write_video

from tactileforge.errors import DataError, DataNotFoundError

Make = Callable[..., Any]
CONSTANTS = """
import os
os.mkdir("executed")
TRAIN_OBJECTS = ["physiclear_leather_book", "physiclear_cup"]
VAL_OBJECTS = ["physiclear_pen"]
TEST_OBJECTS = ["physiclear_orange"]
HARDNESS_RANK = {"physiclear_leather_book": 2, "physiclear_pen": 9}
HARDNESS_MAP = {0: "soft", 1: "moderately hard", 2: "hard"}
ROUGHNESS_RANK = {"physiclear_leather_book": 0}
ROUGHNESS_MAP = {0: "smooth"}
"""


def video(path: Path, count: int) -> None:
    write_video(path, greys(count, 7), codec="mp4v")


@pytest.fixture
def root(tmp_path: Path, write: Make) -> Path:
    for name in ("leather_book_2", "leather_book_10", "cup_0", "pen_0", "orange_0", "pear_0"):
        video(tmp_path / "dataset" / f"{name}.mov", 8)
    write("utils/constants.py", CONSTANTS)
    return tmp_path


def test_videos_and_ranks(root: Path, levels: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root)
    by_key = {
        recording.key: recording for recording in Octopi(str(root), val=0).recordings("train")
    }
    names = [key.removeprefix("octopi/") for key in by_key]
    want = ["cup_0", "leather_book_2", "leather_book_10", "orange_0", "pear_0", "pen_0"]
    assert names == want, "2 before 10"
    book = by_key["octopi/leather_book_2"]
    assert (book.object, book.sensor, book.tier) == ("leather_book", "gelsight_mini", 4)
    assert book.text == "{action} leather book, hard, smooth"
    assert book.labels == {"hardness": 2.0, "roughness": 0.0}
    assert levels(book.no_contact) == [0, 1, 2]
    np.testing.assert_allclose(book.times, np.arange(8) / 25)
    assert by_key["octopi/pen_0"].text == "{action} pen", "there is no word for rank 9"
    assert not (root / "executed").exists(), "constants are read, not run"


def test_the_official_split(root: Path) -> None:
    data = Octopi(str(root), split="octopi-official", val=0.5)
    sides = {
        side: {recording.object for recording in data.recordings(side)} for side in ("train", "val")
    }
    assert sides == {"train": {"leather_book", "cup"}, "val": {"pen"}}
    assert {recording.object for recording in data.recordings("test")} == {"orange"}
    (root / "utils/constants.py").unlink()
    with pytest.raises(DataNotFoundError, match=r"no list of objects in .*constants\.py"):
        list(data.recordings("train"))


def test_defects(root: Path, write: Make, levels: Make) -> None:
    video(root / "dataset/sponge.mov", 3)
    write("dataset/pen_1.mov", "no video")
    data = Octopi(str(root), val=0)
    by_object = {recording.object: recording for recording in data.recordings("train")}
    assert levels(by_object["sponge"].no_contact) == [0], (
        "three frames, two of them left to learn from"
    )
    assert len(data.skipped) == 1
    assert "pen_1.mov" in data.skipped[0]
    write("utils/constants.py", "HARDNESS_RANK = load()")
    with pytest.raises(DataError, match=r"constants\.py: HARDNESS_RANK is not a literal"):
        list(data.recordings("train"))


@pytest.mark.slow
def test_conformance(root: Path, conforms: Make) -> None:
    conforms(Octopi, root=str(root))


@pytest.mark.realdata
def test_real_videos(realdata: Path, conforms: Make) -> None:
    folder = realdata / "octopi_physiclear"
    data = Octopi(str(folder))
    sides = {side: list(data.recordings(side)) for side in ("train", "val")}
    recordings = sides["train"] + sides["val"]
    assert data.skipped == []
    assert (len(recordings), len({recording.object for recording in recordings})) == (240, 80)
    assert not {recording.object for recording in sides["train"]} & {
        recording.object for recording in sides["val"]
    }
    assert {recording.frames.shape for recording in recordings} == {(240, 320)}
    rates = Counter(
        round(1 / float(np.median(np.diff(recording.times)))) for recording in recordings
    )
    assert set(rates) == {10, 25}
    (foil,) = (recording for recording in recordings if recording.key == "octopi/aluminium_foil_0")
    still = np.median(foil.no_contact.read(range(3)), axis=0) if foil.no_contact else None
    change = np.abs(foil.frames.read([1, len(foil.frames) // 2]) - still).mean(axis=(1, 2, 3))
    assert change[1] > 3 * change[0], "the first frames are without contact"
    conforms(Octopi, root=str(folder))


@pytest.mark.parametrize(
    "text",
    [
        "COLOUR_MAP = " + "[" * 90_000,
        "COLOUR_MAP = " + "-" * 200_000 + "1",
        "COLOUR_MAP = " + "+".join(["1"] * 100_000),
        "COLOUR_MAP = {[]: 1}",
        "COLOUR_MAP = \0",
    ],
    ids=["brackets", "signs", "sums", "a key of no kind", "NUL"],
)
def test_constants_that_break_a_parser_are_an_error(root: Path, write: Make, text: str) -> None:
    write("utils/constants.py", text)
    with pytest.raises(DataError, match=r"constants\.py: "):
        list(Octopi(str(root), val=0).recordings("train"))
