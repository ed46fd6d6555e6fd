"""The benchmark of one card, at its smallest, on a CPU: its rows, and its counts."""

import json
import os
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from warm import Warm

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_spec("transformers"), reason="the peer is transformers'"),
]

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "gpu_train.py"


def rows_of(warm: Warm, out: Path, *words: str) -> list[dict[str, Any]]:
    script = [warm.bin / "warm-python", SCRIPT]
    command = [*script, "--tiny", "--device", "cpu", "--out", out, *words]
    subprocess.run(command, check=True, timeout=1800, env=os.environ | {"OMP_NUM_THREADS": "1"})
    rows: list[dict[str, Any]] = json.loads(out.read_text())["rows"]
    return rows


def test_every_kind_of_row_is_measured(tmp_path: Path, warm: Warm) -> None:
    rows = rows_of(warm, tmp_path / "out.json")
    failed = [row for row in rows if "error" in row]
    assert [row["batch"] for row in failed] == [0]  # that one cannot work, and stops no other
    measured = [row for row in rows if "error" not in row]
    assert {row["data"] for row in measured} == {"resident", "host", "loader"}
    assert {row["subject"] for row in measured} == {"pixel+diff", "videomae", "all five"}
    for row in measured:
        assert row["clips_per_s"] == pytest.approx(row["batch"] / row["step_s"])
        if row["flops"]:  # the formula, against operations that torch counts as they are done
            assert row["flops"] == pytest.approx(row["flops_counted"], rel=1e-3)
    assert {row["subject"] for row in measured if row["flops"]} == {"pixel+diff", "videomae"}
    summary = json.loads((tmp_path / "out.json").read_text())["summary"]
    assert "tiny, 2 frames, batch of 4: times as fast as VideoMAE" in summary


def test_no_row_starts_after_its_time(tmp_path: Path, warm: Warm) -> None:
    rows = rows_of(warm, tmp_path / "out.json", "--minutes", "0")
    assert {row["error"] for row in rows} == {"out of time: --minutes"}
