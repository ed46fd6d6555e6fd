"""The models that come with the package."""

from pathlib import Path

import numpy as np
import pytest

import tactileforge
from tactileforge.data.batches.clips import Clips
from tactileforge.datasets.sim import Sim
from tactileforge.hub import cards


@pytest.mark.parametrize("name", ["anytouch2.tiny", "mae.tiny"])
def test_it_works_without_a_network_and_is_small(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path))
    monkeypatch.setattr("socket.socket", None)
    model = tactileforge.load(name)
    _, weight = cards.find_card(name)
    assert weight.kind == "shipped"
    assert weight.bytes < 15_000_000
    assert model.header.licence == weight.licence == "Apache-2.0"
    assert set(model.header.data["licences"]) <= {"BSD-2-Clause", "CC0-1.0"}  # CC0: simulated
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_it_reads_forces_of_touches_it_never_saw() -> None:
    """Force trials of the bench's indenters, by units and hands that it was not trained on."""
    touches = Sim(scenes=4, val=0, indenters="bench", motions="force_trial", seed=5)
    clips = Clips(touches.recordings("train"), 4, 1 / 15, 0.2, (128, 128))
    rows = [clips[i] for i in range(len(clips))]
    frames, background = (np.stack([row[key] for row in rows]) for key in ("frames", "background"))
    model = tactileforge.load("anytouch2.tiny")
    with pytest.warns(UserWarning, match="was calibrated for this model"):
        estimated = model.force(frames, background, [row["sensor"] for row in rows])[:, -1]
    true = np.array([row["force"][-1].numpy() for row in rows])
    for axis, least in enumerate((0.7, 0.7, 0.8)):
        assert np.corrcoef(estimated[:, axis], true[:, axis])[0, 1] > least
    errors = np.abs(estimated.numpy() - true).mean(0)
    assert (errors < 0.75 * np.abs(true - np.median(true, 0)).mean(0)).all()
