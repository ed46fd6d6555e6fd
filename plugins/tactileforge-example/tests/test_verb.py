import pytest

from tactileforge.cli import run
from tactileforge.testing import check


def test_conformance():
    results = check("verb", "brightness")
    assert not [result for result in results if result.status == "failed"], results


def test_it_prints_a_line_for_each_recording(capsys):
    assert run(["brightness", "data=sim", "data.scenes=3", "data.val=1", "data.size=32"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows
    assert all(0 < float(level) < 255 for _, level in rows)


@pytest.mark.parametrize("word", ["frames=0", "fraems=1"])
def test_a_wrong_key_is_one_line(word, capsys):
    assert run(["brightness", "data=sim", word]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert word.partition("=")[0] in said
