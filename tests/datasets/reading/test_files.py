from pathlib import Path

import pytest

from tactileforge.datasets.feel import Feel
from tactileforge.datasets.reading.files import read_rows, read_text
from tactileforge.datasets.ssvtp import Ssvtp
from tactileforge.datasets.tacquad import TacQuad
from tactileforge.datasets.touch_and_go import TouchAndGo
from tactileforge.datasets.tvl import Tvl
from tactileforge.errors import DataError


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
