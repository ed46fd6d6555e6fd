from pathlib import Path

import pytest

from tactileforge import cli
from tactileforge.datasets.shards import Shards

SIM = ["data=sim", "data.scenes=3", "data.val=1", "data.size=32"]


@pytest.mark.slow
def test_pack_writes_what_shards_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "packed"
    assert cli.run(["data", "pack", *SIM, f"out={out}", "pack.processes=1", "pack.codec=png"]) == 0
    assert f"data=shards data.root={out}" in capsys.readouterr().out
    data = Shards(str(out))
    assert [len(list(data.recordings(split))) for split in ("train", "val")] == [9, 3]
    assert data.skipped == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "page"),
    [
        (["inspect", "recordings=4"], "Data set sim"),
        (["filter", "recordings=4", "pack.filter.laplacian=5"], "What is kept of sim"),
    ],
)
def test_pages_are_written(words: list[str], page: str, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    action, *rest = words
    assert cli.run(["data", action, *SIM, f"out={out}", *rest]) == 0
    assert page in out.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["pakc"], "unknown action of tactileforge data 'pakc'; did you mean 'pack'"),
        (["pack", "data=sim"], "give out=..."),
        (["pack", "out=x"], "give data=NAME"),
        (["pack", "data=simm", "out=x"], "simm"),
        (["pack", *SIM, "out=x", "pack.codec=bmp"], "unknown pack.codec 'bmp'"),
        (["inspect", "data=shards", "data.root=nowhere"], "nowhere: neither index.json nor"),
    ],
)
def test_mistakes_are_named(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        assert cli.run(["data", *words]) == 1
    assert said in capsys.readouterr().err


def test_help_lists_the_keys(capsys: pytest.CaptureFixture[str]) -> None:
    for action, key in (("pack", "shard_frames"), ("filter", "laplacian"), ("inspect", "out:")):
        assert cli.run(["data", action, "--help"]) == 0
        assert key in capsys.readouterr().out
