from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.labels.missing import NO_VALUE
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError

Make = Callable[..., Path]
TOUCH = {
    "images": "*.png",
    "each": "touch",
    "sensor": "digit",
    "background": "none",
    "labels": {"file": "labels.csv"},
    "object": "{object}",
}
SEQUENCE = TOUCH | {"images": "*/*.png", "each": "sequence", "fps": 10}


def read(root: Path, **layout: Any) -> list[Recording]:
    return list(Recordings(str(root), {"a": layout}, val=0).recordings("train"))


@pytest.mark.parametrize(
    "spelled", ["./0.png", ".\\0.png", "0.PNG", "{root}/0.png", "{root}//./0.png", "x/../0.png"]
)
def test_a_row_finds_its_file_however_it_spells_it(
    tmp_path: Path, make_image: Make, write: Make, spelled: str
) -> None:
    make_image("0.png")
    make_image("1.png")
    write("labels.csv", f"file,object\n{spelled.format(root=tmp_path)},bolt\n1.png,nut\n")
    assert [one.object for one in read(tmp_path, **TOUCH)] == ["bolt", "nut"]


def test_files_without_a_row_are_noted(tmp_path: Path, make_image: Make, write: Make) -> None:
    for number in range(3):
        make_image(f"{number}.png")
    write("labels.csv", "file,object\n1.png,nut\n")
    data = Recordings(str(tmp_path), {"a": TOUCH}, val=0)
    assert [one.object for one in data.recordings("train")] == [None, "nut", None]
    assert data.notes == ["a/0.png: has no row in labels.csv (and 1 more)"]


@pytest.mark.parametrize(
    "spelled",
    [
        "take\\0.png",
        "TAKE/0.PNG",
        "./take/0.png",
        "/home/ann/set/take/0.png",
        "C:\\sets\\take\\0.png",
    ],
)
def test_a_row_finds_a_file_in_a_folder(
    tmp_path: Path, make_image: Make, write: Make, spelled: str
) -> None:
    make_image("take/0.png")
    write("labels.csv", f"file,object\n{spelled},bolt\n")
    (only,) = read(tmp_path, **TOUCH | {"images": "*/*.png"})
    assert (only.object, only.labels["file"]) == ("bolt", spelled)


def test_letters_with_accents_are_found_taken_apart(
    tmp_path: Path, make_image: Make, write: Make
) -> None:
    make_image("u\u0308.png")  # as a Mac writes it
    write("labels.csv", "file,object\n\u00fc.png,bolt\n")
    assert read(tmp_path, **TOUCH)[0].object == "bolt"


def test_files_that_differ_in_case_alone_are_told_apart(
    tmp_path: Path, make_image: Make, write: Make
) -> None:
    make_image("a.png")
    make_image("A.png")
    write("labels.csv", "file,object\na.png,bolt\nA.png,nut\n")
    assert {one.key: one.object for one in read(tmp_path, **TOUCH)} == {
        "a/a.png": "bolt",
        "a/A.png": "nut",
    }


@pytest.mark.parametrize(
    ("spelled", "near"), [("/home/me/set/0.png", "0.png"), ("1O.png", "10.png")]
)
def test_a_row_of_nothing_names_the_nearest(
    tmp_path: Path, make_image: Make, write: Make, spelled: str, near: str
) -> None:
    for name in ("0.png", "10.png", "zebra.png"):
        make_image(name)
    write("labels.csv", f"file,object\n{spelled},bolt\n")
    with pytest.raises(DataError, match=rf"row 2: .* names no file .* is: '{near}'\); correct"):
        read(tmp_path, **TOUCH)


def test_a_row_of_something_else_is_an_error(tmp_path: Path, make_image: Make, write: Make) -> None:
    make_image("take/0.png")
    write("notes.txt", "")
    (tmp_path / "empty").mkdir()
    layout = TOUCH | {"images": "*/*.png"}
    for name in ("notes.txt", "empty"):
        write("labels.csv", f"file,object\n{name},bolt\n")
        with pytest.raises(DataError, match=rf"'{name}' names nothing that layout 'a' reads"):
            read(tmp_path, **layout)
    write("labels.csv", "file,object\nnotes.txt,bolt\ntake/0.png,nut\n")
    assert read(tmp_path, **layout)[0].object == "nut", "a file of another layout, beside its own"


@pytest.mark.parametrize("spelled", ["s/take", "take", ".\\s\\take", "take/"])
def test_a_row_that_names_a_folder_is_of_what_lies_in_it(
    tmp_path: Path, make_image: Make, write: Make, spelled: str
) -> None:
    for name in ("s/take/0.png", "s/take/near/1.png", "s/take/near/2.png", "t/3.png"):
        make_image(name)
    rows = f"{spelled},bolt\nnear,nut\n2.png,key\n"
    write("labels.csv", f"file,object\n{rows}")
    found = read(tmp_path, **TOUCH | {"images": "**/*.png"})
    assert {one.key.rpartition("/")[2]: one.object for one in found} == {
        "0.png": "bolt",
        "1.png": "nut",  # of the nearest folder
        "2.png": "key",  # its own row counts
        "3.png": None,
    }


def test_a_name_of_two_folders_is_an_error(tmp_path: Path, make_image: Make, write: Make) -> None:
    make_image("left/take/0.png")
    make_image("right/take/0.png")
    write("labels.csv", "file,object\ntake,bolt\n")
    with pytest.raises(DataError, match="'take' names no file"):
        read(tmp_path, **TOUCH | {"images": "*/*/*.png"})


def test_two_spellings_of_one_file_are_two_rows(
    tmp_path: Path, make_image: Make, write: Make
) -> None:
    make_image("0.png")
    write("labels.csv", "file,object\n0.png,bolt\n./0.png,nut\n")
    with pytest.raises(DataError, match=r"row 3: '0\.png' has a row already .*row 2"):
        read(tmp_path, **TOUCH)


@pytest.mark.parametrize("word", ["nan", "NaN", "None", "null", "NA", "N/A", "?", "-", " nan "])
def test_a_word_for_no_value_is_none(
    tmp_path: Path, make_image: Make, write: Make, word: str
) -> None:
    make_image("0.png")
    write("labels.csv", f"file,object,action,hard\n0.png,{word},{word},{word}\n")
    words = {"action": "{action}", "text": ["a {object}", "{hard}"]}
    (only,) = read(tmp_path, **TOUCH | words)
    assert (only.object, only.text, dict(only.labels)) == (None, None, {"file": "0.png"})
    assert only.action is not None
    assert only.action.tolist() == [-1]


def test_a_rank_may_be_called_none(tmp_path: Path, make_image: Make, write: Make) -> None:
    make_image("0.png")
    write("labels.csv", "file,object\n0.png,none\n")
    (only,) = read(tmp_path, **TOUCH | {"words": {"object": {"none": "air"}}})
    assert only.object == "air"
    assert "none" in NO_VALUE


def test_rows_of_the_images_of_a_sequence(tmp_path: Path, make_image: Make, write: Make) -> None:
    rows = "file,object,kind,action\n"
    for take, name in (("a", "bolt"), ("b", "nut")):
        for i in range(3):
            make_image(f"{take}/{i}.png", i)
            rows += f"{take}/{i}.png,{name},hard,{['press', '', 'leave'][i]}\n"
    write("labels.csv", rows)
    layout = SEQUENCE | {"text": "a {kind} {object}", "action": "{action}"}
    first, second = read(tmp_path, **layout)
    assert (first.object, first.text) == ("bolt", "a hard bolt")
    assert (second.object, second.text) == ("nut", "a hard nut")
    actions = [ACTIONS.index("press"), -1, ACTIONS.index("leave")]
    for one in (first, second):
        np.testing.assert_array_equal(one.action, actions)
    assert dict(first.labels) == {"file": "a", "object": "bolt", "kind": "hard"}


def test_images_of_a_sequence_that_contradict_each_other(
    tmp_path: Path, make_image: Make, write: Make
) -> None:
    for i in range(2):
        make_image(f"a/{i}.png", i)
    write("labels.csv", "file,object\na/0.png,bolt\na/1.png,nut\n")
    with pytest.raises(DataError, match=r"row 3: object is 'nut' here and 'bolt' in .*row 2, both"):
        read(tmp_path, **SEQUENCE)
    write("labels.csv", "file,object\na,bolt\na/1.png,\n")
    assert read(tmp_path, **SEQUENCE)[0].object == "bolt", "a row of the folder, and an empty one"


def test_a_row_of_a_folder_with_a_slash(tmp_path: Path, make_image: Make, write: Make) -> None:
    make_image("a/0.png")
    write("labels.csv", "file,object\na/,bolt\n")
    assert read(tmp_path, **SEQUENCE)[0].object == "bolt"


def test_a_line_of_text_in_place_of_a_table_is_named(
    tmp_path: Path, make_image: Make, write: Make
) -> None:
    make_image("mug/0.png")
    write("mug/caption.txt", "a rough nut, held firmly\n")
    keys = {"labels": {"file": "{file}/caption.txt"}, "object": "{stem}"}
    with pytest.raises(DataError, match=r"mug/caption.txt: .* and no row; .* above it \(text\)"):
        read(tmp_path, **SEQUENCE | keys)
    write("mug/caption.txt", 'text\n"a rough nut, held firmly"\n')
    assert [one.text for one in read(tmp_path, **SEQUENCE | keys | {"text": "{text}"})] == [
        "a rough nut, held firmly"
    ]
