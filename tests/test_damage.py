"""Training on shards with some damaged recordings."""

from pathlib import Path

import pytest
from tactileforge_sim.dataset import Sim

from tactileforge import cli
from tactileforge.packing import PackOptions, pack

pytestmark = pytest.mark.slow

SMALL = ["train", "scale=demo", "debug=steps", "encoder.image_size=32", "batch.workers=1"]
SMALL += ["objective=[pixel]", "batch.size=8", "data=shards", "trainer.max_steps=6"]


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """Shards of one recording for training; two of them have a flipped byte."""
    folder = tmp_path / "packed"
    pack(Sim(scenes=3, val=1, size=32), "sim", folder, PackOptions(processes=1, shard_frames=1))
    for path in sorted(folder.glob("train-*.tar"))[:2]:
        raw = bytearray(path.read_bytes())
        raw[len(raw) // 2] ^= 1
        path.write_bytes(raw)
    return folder


def test_a_run_stops_when_too_much_is_damaged_and_lists_it(
    damaged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*SMALL, f"data.root={damaged}", f"hydra.run.dir={tmp_path / 'run'}"]
    assert cli.run(words) == 1
    said = capsys.readouterr().err
    assert "recordings cannot be read, and data.max_bad allows 1" in said
    assert said.count("damaged, or another shard; download or pack it again") >= 2


def test_a_run_goes_on_without_what_is_damaged(damaged: Path, tmp_path: Path) -> None:
    words = [*SMALL, f"data.root={damaged}", f"hydra.run.dir={tmp_path / 'run'}"]
    assert cli.run([*words, "data.max_bad=0.5"]) == 0
    assert (
        "damaged, or another shard; download or pack it again"
        in (tmp_path / "run/report.html").read_text()
    )
