"""What a run says that is cut short from outside."""

from pathlib import Path

import pytest

from tactileforge import train
from tactileforge.run_folder import LAST


@pytest.mark.parametrize(
    ("said", "lost"),
    [
        ("[pair.cc:537] Read error [127.0.0.1]:6473: Connection reset by peer", True),
        ("[pair.cc:547] Connection closed by peer [127.0.0.1]:6473", True),
        ("NCCL communicator was aborted on rank 0", True),
        ("mat1 and mat2 shapes cannot be multiplied (4x2 and 3x4)", False),
    ],
)
def test_a_process_that_died_is_told_from_a_mistake(said: str, lost: bool) -> None:
    assert bool(train._LOST.search(said)) is lost


def test_the_way_back_is_quoted(tmp_path: Path) -> None:
    run = tmp_path / "my run"
    assert train._kept(run) == "Nothing was saved before: give the same command again"
    (run / LAST).parent.mkdir(parents=True)
    (run / LAST).touch()
    assert train._kept(run).endswith(f"tactileforge train resume='{run}'")
