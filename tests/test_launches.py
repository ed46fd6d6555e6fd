"""Operators of a training step that launch on a card: no more than a VideoMAE of equal size has."""

from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_spec("transformers"), reason="the peer is transformers'"),
]


def test_a_step_launches_no_more_than_videomae(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    import launches

    ours, peer, five = (launches.count(name, "tiny").total for name in launches.SUBJECTS)
    assert 0 < ours <= peer
    assert five <= 1.8 * ours  # `tiny` has half the blocks and the same heads
