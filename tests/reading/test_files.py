import pickle
from pathlib import Path

import pytest
from tactileforge_datasets.feel import Feel
from tactileforge_datasets.ssvtp import Ssvtp
from tactileforge_datasets.tacquad import TacQuad
from tactileforge_datasets.touch_and_go import TouchAndGo
from tactileforge_datasets.tvl import Tvl

from tactileforge.errors import DataError
from tactileforge.reading import files
from tactileforge.reading.files import matching_files, read_rows, read_text
from tactileforge.reading.notes import Lines, add_once
from tactileforge.reading.records import read_records


@pytest.mark.parametrize(
    "names",
    [
        ["2.png", "10.jpg", "011.png"],
        ["-1.5.png", "-1.05.png", "0.png", "0.05.png", "0.1.png", "1700000000.5.png"],
        ["frame_1.png", "frame_2.png", "frame_10.png"],
        ["press-1.5/a.png", "press-2/a.png", "press-10/a.png"],
    ],
)
def test_files_are_in_natural_order_and_each_once(tmp_path: Path, names: list[str]) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    files, odd = matching_files(tmp_path, ["**/*.jpg", "**/*.png", "**/*[0-9]*.*"], "x")
    assert [path.relative_to(tmp_path).as_posix() for path in files] == names
    assert [path for path in odd if "." not in path.name] == []


def test_rows_are_those_of_the_lines(tmp_path: Path) -> None:
    path = tmp_path / "index.csv"
    path.write_bytes('\ufeffa,"b, c"\r\n\r\nd\u2028e,f'.encode())
    assert read_rows(path) == [["a", "b, c"], [], ["d\u2028e", "f"]]


def test_text_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"gone\.txt: cannot be read \(No such file"):
        read_text(tmp_path / "gone.txt")
    (tmp_path / "long.csv").write_text("a" * 200_000)
    with pytest.raises(DataError, match=r"long\.csv: not a CSV \(field larger than"):
        read_rows(tmp_path / "long.csv")


@pytest.mark.parametrize(
    ("reader", "file", "folder"),
    [
        (TouchAndGo, "label.txt", "dataset"),
        (Feel, "feel.csv", "."),
        (TacQuad, "contact_indoor.csv", "."),
        (Ssvtp, "ssvtp/test.csv", "ssvtp/images_tac"),
        (Tvl, "hct/data1/train.csv", "hct/data1"),
    ],
)
def test_an_index_that_is_no_text_is_named(
    tmp_path: Path, reader: type[Feel], file: str, folder: str
) -> None:
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_bytes(b"a/0.jpg,3\nf\xff\xfe")
    with pytest.raises(DataError, match=rf"{file}: byte 11 is not UTF-8; download it again"):
        list(reader(str(tmp_path), val=0).recordings("train"))


def test_a_line_of_a_table_is_not_too_long(monkeypatch, tmp_path):
    monkeypatch.setattr(files, "_MOST_LINE", 10)
    path = tmp_path / "a.csv"
    for good in ("a,b\n" * 9, "0123456789\n" * 3, "0123456789", "a\n0123456789"):
        path.write_text(good)
        assert files.read_rows(path)
    for bad, number in (
        ("a\n" * 5 + "0123456789,\nb\n", 6),
        ("01234567890", 1),
        ("a\n01234567890", 2),
    ):
        path.write_text(bad)
        with pytest.raises(DataError, match=f"a.csv: line {number} has more than 10 characters"):
            files.read_rows(path)


def test_many_lines_are_added_once():
    kept, other = Lines(["a"]), ["b"]
    for line in ("a", "b", "b", "c"):
        add_once(kept, line)
        add_once(other, line)
    assert (kept, other) == (["a", "b", "c"], ["b", "a", "c"])
    kept.append("d")
    kept += ["e"]
    for line in ("d", "e", "f"):
        add_once(kept, line)
    assert kept == ["a", "b", "c", "d", "e", "f"]
    again = pickle.loads(pickle.dumps(kept))
    add_once(again, "f")
    assert again == kept


def test_a_text_of_a_table_in_json_is_not_too_long(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('[{"' + "x" * (1 << 19) + '": 1}]')
    with pytest.raises(DataError, match=r"a.json: a name or text of more than 524288 characters"):
        read_records(path)
    path.write_text('[{"' + "x" * ((1 << 19) - 1) + '": 1}]')
    assert len(read_records(path)) == 1


@pytest.mark.parametrize(
    ("text", "encoding", "said"),
    [
        ("时间,力 (N)\n0.1,2\n", "gb18030", "gb18030"),
        ("時間,ちから\n0.1,2\n", "shift_jis", "shift_jis"),
        ("Größe,Kräfte\n0.1,2\n", "latin1", "latin1"),
        ("résumé,été,à\n0.1,2\n", "latin1", "latin1"),
    ],
)
def test_the_likely_encoding_is_named(text: str, encoding: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    with pytest.raises(DataError, match=rf"is not UTF-8; .* iconv -f {said} -t utf-8 a\.csv"):
        read_text(tmp_path / "a.csv")
