from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.reading.label_rows import LabelRow, label_row, read_labels
from tactileforge.reading.layout import DatasetLayout, parse_layout
from tactileforge.reading.layout_keys import FrameTable
from tactileforge.reading.tables import read_actions, read_cells, read_force
from tactileforge.reading.text_tables import read_text_table

Write = Callable[[str, str], Path]
TIMES = np.arange(5) / 10
FORCE = FrameTable("f.csv", "frame", ("fx", "fy", "fz"))


def layout(**more: object) -> DatasetLayout:
    given = {"videos": "*.mp4", "sensor": "digit", "background": "none"}
    return parse_layout("x", given | {"labels": {"file": "labels.csv"}} | more)


def test_labels_by_file_with_words(tmp_path: Path, write: Write) -> None:
    write("labels.csv", "file,kind,hard\na.mp4,red_cup,2\nsub/b.mp4,blue_cup,\n")
    rows = read_labels(layout(words={"hard": {0: "soft", 2: "hard"}}), tmp_path)
    assert dict(rows["a.mp4"].cells) == {"file": "a.mp4", "kind": "red_cup", "hard": "2"}
    assert rows["a.mp4"].fill("a {hard} {kind}") == "a hard red_cup"
    assert rows["a.mp4"].fill("a {kind}, {action}", spaced=True) == "a red cup, {action}"
    assert rows["sub/b.mp4"].fill("a {hard} thing") is None, "an empty cell says nothing"
    assert rows["sub/b.mp4"].fill("{stem} {folder} {file}") == "b sub sub/b.mp4"
    deep = label_row("mug/episode_1/camera.mp4", rows, layout())
    assert deep.fill("{parent} {folder} {stem}") == "mug episode_1 camera"
    other = label_row("c.mp4", rows, layout())
    assert (other.fill("{kind}"), other.fill("{stem}")) == (None, "c")


def test_what_an_empty_cell_means_can_be_said(tmp_path: Path, write: Write) -> None:
    write("labels.csv", "file,split\na.mp4,\nb.mp4,val\n")
    rows = read_labels(layout(words={"split": {"": "train", "val": "val"}}), tmp_path)
    assert [row.fill("{split}") for row in rows.values()] == ["train", "val"]


def test_errors_of_labels_name_the_row(tmp_path: Path, write: Write) -> None:
    with pytest.raises(DataNotFoundError, match=r"labels\.csv: no such CSV"):
        read_labels(layout(), tmp_path)
    write("labels.csv", "name,hard\na.mp4,2\n")
    with pytest.raises(ConfigError, match=r"labels\.csv: unknown column 'file'.*hard, name"):
        read_labels(layout(), tmp_path)
    write("labels.csv", "file,hard\na.mp4,2\nb.mp4,7\n")
    with pytest.raises(DataError, match=r"labels\.csv, row 3, column 'hard': '7' has no word"):
        read_labels(layout(words={"hard": {2: "hard"}}), tmp_path)
    write("labels.csv", "file,hard\na.mp4,2\na.mp4,1\n")
    with pytest.raises(DataError, match=r"row 3: 'a\.mp4' has a row already .*row 2"):
        read_labels(layout(), tmp_path)
    write("labels.csv", "file,hard\na.mp4,2,3\n")
    with pytest.raises(DataError, match="row 2: more cells than the header has"):
        read_labels(layout(), tmp_path)


def test_a_template_with_an_unknown_column() -> None:
    with pytest.raises(ConfigError, match=r"l\.csv, row 2: unknown column 'colour'.*'color'"):
        LabelRow("l.csv, row 2", {}, {"color": "red"}).fill("{colour}")


def test_a_template_takes_columns_as_they_are() -> None:
    row = LabelRow("l.csv, row 2", {}, {"obj.name": "{mug}", "stem": "7"})
    assert row.fill("a {obj.name}, {{plain}}") == "a {mug}, {plain}"
    with pytest.raises(ConfigError, match=r"'a\{stem:03d\}': columns are taken as they are"):
        row.fill("a{stem:03d}")


def test_the_name_of_a_folder_has_no_ending() -> None:
    images = {"videos": None, "images": "*/*.png", "each": "sequence", "fps": 30}
    row = label_row("a/press_0.5N", {}, layout(**images, labels=None))
    assert row.fill("{folder}/{stem}.csv") == "a/press_0.5N.csv"


def test_force_with_gaps(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "frame,fz,fx,fy,note\n0,1,2,3,\n3,4,5,6,x\n1,,7,8,\n")
    force = read_force(FORCE, path, TIMES, "digit")
    assert force.dtype == np.float32
    nan = [np.nan] * 3
    np.testing.assert_array_equal(force, [[2, 3, 1], [7, 8, np.nan], nan, [5, 6, 4], nan])


def test_force_along_one_axis(tmp_path: Path, write: Write) -> None:
    """Most grippers and load cells measure the normal force alone."""
    path = write("f.csv", 'fz\n-1\n-2\n""\n-4\n-5\n')
    table = FrameTable("f.csv", None, ("", "", "fz"), (1, 1, -1), lag_s=0.1)
    force = read_force(table, path, TIMES, "digit")
    assert np.isnan(force[:, :2]).all()
    np.testing.assert_array_equal(force[:, 2], [np.nan, 1, 2, np.nan, 4])
    with pytest.raises(DataError, match=r"row 5: an empty line is before it"):
        read_force(table, write("f.csv", "fz\n-1\n-2\n\n-4\n-5\n"), TIMES, "digit")


def test_force_axes_and_signs(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "fx,fy,fz\n" + "1,2,-3\n" * 5)
    table = FrameTable("f.csv", None, ("fy", "fx", "fz"), (1, -1, -1))
    np.testing.assert_array_equal(read_force(table, path, TIMES, "digit"), [[2, -1, 3]] * 5)


def test_images_lag_the_force(tmp_path: Path, write: Write) -> None:
    cells = "".join(f"{i},{10 * i},0,{i}\n" if i != 2 else "2,,,\n" for i in range(5))
    path = write("f.csv", "frame,fx,fy,fz\n" + cells)
    whole = FrameTable("f.csv", "frame", ("fx", "fy", "fz"), lag_s=0.1)
    got = read_force(whole, path, TIMES, "digit")[:, 0]
    np.testing.assert_array_equal(got, [np.nan, 0, 10, np.nan, 30])
    half = FrameTable("f.csv", "frame", ("fx", "fy", "fz"), lag_s=0.05)
    got = read_force(half, path, TIMES, "digit")[:, 0]
    np.testing.assert_allclose(got, [np.nan, 5, np.nan, np.nan, 35], rtol=1e-6)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (
            "1,inf,0,0",
            r"f\.csv, row 3, column 'fx': 'inf' is not a finite number; leave the cell empty",
        ),
        ("1,0,inf,0", r"row 3, column 'fy': 'inf' is not a finite number"),
        ("1,0,0,much", r"row 3, column 'fz': 'much' is not a finite number"),
        ('1,0,0,"2,47"', r"column 'fz': '2,47' is not a .*; write a point for its comma: 2\.47$"),
        ("1,0,0,2.47 N", r"column 'fz': '2\.47 N' is not a .*; write only the number: 2\.47$"),
        ("1,0,0,2,47", r"row 3: more cells than the header has; .* a point for those of decimals"),
        ("5,0,0,0", r"f\.csv, row 3: frame 5 does not exist, the recording has 0 to 4"),
        ("-1,0,0,0", "row 3: frame -1 does not exist"),
        ("1.5,0,0,0", r"row 3: frame '1\.5' is not a whole number"),
        ("0,0,0,0", "row 3: frame 0 has a row already"),
    ],
)
def test_force_that_contradicts_the_frames(
    tmp_path: Path, write: Write, row: str, message: str
) -> None:
    path = write("f.csv", f"frame,fx,fy,fz\n0,0,0,0\n{row}\n")
    with pytest.raises(DataError, match=message):
        read_force(FORCE, path, TIMES, "digit")


def test_rows_that_count_from_1_are_told_what_to_do(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "frame,fx,fy,fz\n" + "".join(f"{i},0,0,0\n" for i in range(1, 6)))
    with pytest.raises(DataError, match="the rows count from 1: leave frame: out"):
        read_force(FORCE, path, TIMES, "digit")


def test_force_without_a_frame_column_counts_its_rows(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "fx,fy,fz\n" + "0,0,1\n" * 6)
    with pytest.raises(
        DataError, match=r"row 7: a row for each frame, and there are 5 .*is one missing"
    ):
        read_force(FrameTable("f.csv", None, ("fx", "fy", "fz")), path, TIMES, "digit")

    path = write("f.csv", "fx,fy,fz\n" + "0,0,1\n" * 4)
    with pytest.raises(DataError, match=r"f\.csv: 4 rows for 5 frames; give the column of .*time:"):
        read_force(FrameTable("f.csv", None, ("fx", "fy", "fz")), path, TIMES, "digit")


def test_force_on_a_clock_of_its_own(tmp_path: Path, write: Write) -> None:
    """Most force sensors are read at another rate than the camera."""
    table = FrameTable("f.csv", None, ("", "", "fz"), (1, 1, -1), time="t")
    rows = "".join(f"{0.04 * i:.2f},{-i}\n" for i in range(1, 8))
    path = write("f.csv", "t,fz\n" + rows)
    force = read_force(table, path, TIMES, "digit")
    assert np.isnan(force[:, :2]).all()
    np.testing.assert_allclose(force[:, 2], [np.nan, 2.5, 5, np.nan, np.nan], rtol=1e-6)
    late = read_force(replace(table, lag_s=0.1), path, TIMES, "digit")
    np.testing.assert_allclose(late[:, 2], [np.nan, np.nan, 2.5, 5, np.nan], rtol=1e-6)
    path = write("f.csv", "t,fz\n0,0\n0.1,-1\n0.2,\n0.3,-3\n")
    np.testing.assert_array_equal(
        read_force(table, path, TIMES, "digit")[:, 2], [0, 1, np.nan, 3, np.nan]
    )
    path = write("f.csv", "t,fz\n0,0\n0.05,0\n0.1,-1\n0.4,-4\n")  # a gap between two of them
    np.testing.assert_array_equal(
        read_force(table, path, TIMES, "digit")[:, 2], [0, 1, np.nan, np.nan, 4]
    )
    for wrong in ("0,0\n0.2,0\n0.1,0\n", "0,0\n,0\n"):
        with pytest.raises(DataError, match=r"f\.csv, row \d: the time .* is not after that"):
            read_force(table, write("f.csv", "t,fz\n" + wrong), TIMES, "digit")


DATES = ["5/13/2024 2:22:05.{} PM", "13.05.2024 14:22:05,{}", "13/05/2024 14:22:05.{}"]
DATES += ["2024-05-13 14:22:05.{}", "2:22:05.{} pm", "14:22:05.{}"]


@pytest.mark.parametrize("date", DATES)
def test_forces_by_dates_as_programs_write_them(date: str, tmp_path: Path, write: Write) -> None:
    table = FrameTable("f.csv", None, ("", "", "fz"), time="t", start="first_row")
    rows = "".join(f'"{date.format(100 * i)}",{i}\n' for i in range(1, 6))
    path = write("f.csv", "t,fz\n" + rows)
    np.testing.assert_allclose(
        read_force(table, path, TIMES, "digit")[:, 2], [1, 2, 3, 4, 5], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0.02,1\n0.02,2\n", r"row 3: the time '0\.02' is that of the row before, too; write"),
        ("0.02,1\n0.01,2\n", r"row 3: the time '0\.01' is not after .*; sort the rows by time"),
        ("5/6/2024 14:22:05,1\n", r"column 't': '5/6/2024 14:22:05': 5 or 6 may be the month"),
        ("5/32/2024 2:22:05 PM,1\n", r"column 't': .* write numbers, or dates as 2024-10-27"),
        ("99:99 h,1\n", r"column 't': '99:99 h' is no number, date or time of day"),
    ],
)
def test_times_that_cannot_be_read(rows: str, message: str, tmp_path: Path, write: Write) -> None:
    table = FrameTable("f.csv", None, ("", "", "fz"), time="t")
    with pytest.raises(DataError, match=message):
        read_force(table, write("f.csv", "t,fz\n" + rows), TIMES, "digit")


@pytest.mark.parametrize("keys", [{"time": "t"}, {"frame": "n"}, {}])
def test_empty_rows_at_the_end_and_words_for_no_value(
    keys: dict[str, str], tmp_path: Path, write: Write
) -> None:
    rows = [f"{n / 10};{n};{'nan' if n < 2 else n}" for n in range(5)]
    path = write("f.csv", "\n".join(["t;n;fz", *rows, ";;", ";;", ""]))
    table = FrameTable("f.csv", keys.get("frame"), ("", "", "fz"), time=keys.get("time"))
    force = read_force(table, path, TIMES, "digit")
    np.testing.assert_allclose(force[:, 2], [np.nan, np.nan, 2, 3, 4], rtol=1e-6)


def test_actions_per_frame(tmp_path: Path, write: Write) -> None:
    table = FrameTable("a.csv", "frame", ("what",))
    path = write("a.csv", "frame,what\n0,press\n1,\n4,leave\n")
    want = [ACTIONS.index("press"), -1, -1, -1, ACTIONS.index("leave")]
    assert read_actions(table, path, 5).tolist() == want
    write("a.csv", "frame,what\n0,push\n")
    with pytest.raises(ConfigError, match=r"a\.csv, row 2: unknown action 'push'"):
        read_actions(table, path, 5)


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"file,hard\na.mp4," + b"2" * 200_000, r"not a CSV \(field larger"),
        (b"file,hard\na.mp4,\xff\xfe", "byte 16 is not UTF-8"),
        (b"\xff\xfef\0i\0l\0e\0", "byte 0 is not UTF-8"),
    ],
    ids=["a cell without end", "no UTF-8", "UTF-16"],
)
def test_a_csv_that_is_none_is_named(tmp_path: Path, raw: bytes, reason: str) -> None:
    (tmp_path / "labels.csv").write_bytes(raw)
    with pytest.raises(DataError, match=rf"labels\.csv: {reason}"):
        read_labels(layout(), tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "frame;fx;fy;fz\n0;1,5;0;0\n3;-,5;0;0\n",
        "frame\tfx\tfy\tfz\n0\t1,5\t0\t0\n3\t-0,5\t0\t0\n",
        "# gamma, 100 Hz\nframe, fx, fy, fz\n0,1.5,0,0\n3,-.5,0,0\n",
        "# frame fx fy fz\n0 1.5 0 0\n3 -.5 0 0\n",
        "Gamma FT1\nRate,100\n\nframe,fx,fy,fz\n0,1.5,0,0\n3,-.5,0,0\n",
        'frame,fx,fy,fz\n-,N,[N],""\n0,1.5,0,0\n3,-.5,0,0\n',
        "frame;fx;fy;fz;note\n0;1,5;0;0;a, b\n3;-,5;0;0;c\n",
    ],
)
def test_a_table_as_other_programs_write_it(text: str, tmp_path: Path, write: Write) -> None:
    force = read_force(FORCE, write("f.csv", text), TIMES, "digit")
    np.testing.assert_array_equal(force[[0, 3], 0], np.float32([1.5, -0.5]))
    assert np.isnan(force[[1, 2, 4]]).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("frame,fx,fy\n0,1,0\n", r"'fz'.*Known: frame, fx, fy$"),
        ("0,1.5,0,0\n1,1.5,0,0\n", r"'fx'.*Known: 0, 1, 2, 3. The file has no line of names"),
        ("frame,fx,fy,fz\n,mN,mN,mN\n0,1,0,0\n", r"'fx'.*Known: frame, fx \[mN\], fy"),
    ],
)
def test_columns_of_other_names_or_units_are_named(
    text: str, words: str, tmp_path: Path, write: Write
) -> None:
    with pytest.raises(ConfigError, match=words):
        read_force(FORCE, write("f.csv", text), TIMES, "digit")


def test_numbers_and_texts_stay_what_they_are(write: Write) -> None:
    text = 'file,text\na.png,"soft; 1,5 cm"\nb.png,hard; 2 cm\n'
    rows = [cells for _, cells in read_cells(write("labels.csv", text), ["text"])]
    assert [row["text"] for row in rows] == ["soft; 1,5 cm", "hard; 2 cm"]
    # numbers with points and commas: thousands, which are not decimals
    path = write("f.csv", "frame;fx;fy;fz\n0;1,234;0;0\n1;0.5;0;0\n")
    with pytest.raises(DataError, match="'1,234' is not a finite number"):
        read_force(FORCE, path, TIMES, "digit")


def test_several_numbers_of_a_cell(write: Write) -> None:
    text = 'n,wrench,pose\n0,"[0.5, 1, -2]",1 2\n1,"[3, 4, 5]",1\n2,,\n'
    rows = [cells for _, cells in read_cells(write("labels.csv", text), ["wrench.2"])]
    assert [row["wrench.2"] for row in rows] == ["-2", "5", ""]
    assert "pose.0" not in rows[0]  # not so in every row


def test_a_lag_in_milliseconds_is_no_loss_of_all_forces(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "frame,fx,fy,fz\n" + "".join(f"{i},0,0,1\n" for i in range(5)))
    with pytest.raises(DataError, match=r"lag_s is 70, longer than the recording of 0\.4 s"):
        read_force(replace(FORCE, lag_s=70.0), path, TIMES, "digit")
    assert np.isfinite(read_force(replace(FORCE, lag_s=0.1), path, TIMES, "digit")[1:, 2]).all()
    still = write("f.csv", "frame,fx,fy,fz\n0,0,0,1\n")
    assert read_force(replace(FORCE, lag_s=0.1), still, TIMES[:1], "digit").shape == (1, 3)


def test_forces_in_another_unit(tmp_path: Path, write: Write) -> None:
    path = write("f.csv", "fx_kg,fy_kg,fz_kg\n0.1,0,0.5\n" + ",,\n" * 4)
    keys = {"file": "f.csv", "columns": ["fx_kg", "fy_kg", "fz_kg"], "sign": [1, 1, -1]}
    with pytest.raises(ConfigError, match=r"'x': force: 'fx_kg' is in kgf by its name"):
        layout(force=keys)
    table = layout(force={**keys, "unit": "kgf"}).force
    assert table is not None
    force = read_force(table, path, TIMES, "digit")
    np.testing.assert_allclose(force[0], [0.980665, 0, -4.903325], rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "header", "first"),
    [
        ("0.png 0.1 1.3\n1.png 0.2 1.4\n", ["0", "1", "2"], ["0.png", "0.1", "1.3"]),
        ("img/0.png 3\nimg/1.png 4\n", ["0", "1"], ["img/0.png", "3"]),
        ("0.png\n1.png\n2.png\n", ["0"], ["0.png"]),
        ("0.png,mug\n1.png,can\n", ["0", "1"], ["0.png", "mug"]),
        ("file,object\n0.png,mug\n1.png,can\n", ["file", "object"], ["0.png", "mug"]),
        ("a.png,object\nx,mug\ny,can\n", ["a.png", "object"], ["x", "mug"]),
        ("# gel\n# time name\n1.5 a/0.png\n1.6 a/1.png\n", ["time", "name"], ["1.5", "a/0.png"]),
        ("[ 0.1 -0.  1.3]\n[ 0.2  0.  1.4]\n", ["0", "1", "2"], ["0.1", "-0.", "1.3"]),
        ("[[0.1, 2]\n [0.2, 3]]\n".replace("[[", "[").replace("]]", "]"), ["0", "1"], ["0.1", "2"]),
        ("(0.1, 2)\n(0.2, 3)\n", ["0", "1"], ["0.1", "2"]),
        ("t,f\n0,[1 2]\n1,[2 3]\n", ["t", "f"], ["0", "[1 2]"]),
    ],
)
def test_a_first_line_with_names_of_files_or_arrays_is_a_row(
    text: str, header: list[str], first: list[str]
) -> None:
    table = read_text_table(text)
    assert table.header == header
    assert next(cells for _, cells in table.rows if cells) == first
