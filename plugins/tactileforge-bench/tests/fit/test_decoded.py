"""Clips decoded once equal the clips read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tactileforge_bench.fit import decoded
from tactileforge_bench.fit.features import PLAIN, FeatureStore, extract_features, read_batches
from tactileforge_bench.fit.models import baseline_encoder
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import ClipSpec

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import DataError


def source() -> TaskSource:
    rng = np.random.default_rng(0)
    made = [
        Recording(
            key=f"r{i}",
            sensor=("digit", "gelsight")[i % 2],
            frames=ArrayFrames(rng.integers(0, 256, (9, 20, 30, 3), dtype=np.uint8)),
            times=np.arange(9) / 20,
            no_contact=ArrayFrames(np.full((1, 20, 30, 3), 90 + i, np.uint8)),
        )
        for i in range(3)
    ]
    return TaskSource(made, ["train"] * 3, ClipSpec(span=0.1, hop=0.05))


def clips(of: TaskSource) -> Clips:
    return Clips(of.recordings, 2, 0.1, 0.05, (16, 16))


def test_what_is_stored_is_what_was_read(tmp_path: Path) -> None:
    of = source()
    some = clips(of)
    store = FeatureStore(tmp_path / "features", workers=0)
    folder = decoded.clip_folder(tmp_path / "clips", of, some, 0.1)
    assert folder is not None
    assert decoded.stored_batches(folder, 4) is None
    first = list(
        decoded.store_batches(folder, len(some), read_batches(some, range(len(some)), store, 4))
    )
    again = decoded.stored_batches(folder, 4)
    assert again is not None
    for batch, other in zip(first, again, strict=True):
        assert torch.equal(batch["frames"], other["frames"])
        assert torch.equal(batch["background"], other["background"])
        assert list(batch["sensor"]) == list(other["sensor"])
    assert sorted(path.name for path in folder.iterdir()) == [
        "background.npy",
        "frames.npy",
        "sensors.json",
    ]


def test_a_pass_that_was_stopped_keeps_nothing(tmp_path: Path) -> None:
    of = source()
    some = clips(of)
    folder = tmp_path / "clips"
    passing = decoded.store_batches(
        folder, len(some), read_batches(some, range(len(some)), FeatureStore(tmp_path, 0), 4)
    )
    next(passing)
    passing.close()
    assert decoded.stored_batches(folder, 4) is None


def test_another_background_or_rate_is_another_source() -> None:
    of = source()
    first = of.recordings[0]
    still = ArrayFrames(np.stack([np.full((20, 30, 3), level, np.uint8) for level in (9, 50, 90)]))
    prints = {of.fingerprint}
    for change in (
        {"no_contact": still},
        {"no_contact": FrameSubset(still, [0])},
        {"times": first.times * 2},
    ):
        changed = [replace(first, **change), *of.recordings[1:]]
        other = TaskSource(changed, of.sides, of.clip)
        other.index = of.index
        prints.add(other.fingerprint)
    assert len(prints) == 4


@pytest.mark.slow
def test_the_next_encoder_decodes_nothing(tmp_path: Path) -> None:
    of, store = source(), FeatureStore(tmp_path / "features", workers=0, batch=4)
    places = np.arange(len(of))
    hog = extract_features(store, baseline_encoder("hog"), of, places, ["pooled"])["pooled", PLAIN]
    seen = of._read_once  # a picture of each recording, once
    broken = TaskSource(of.recordings, of.sides, of.clip)
    broken.__dict__["_read_once"] = seen
    for batch in broken.recordings:
        object.__setattr__(batch, "frames", Broken())
    statistics = extract_features(store, baseline_encoder("statistics"), broken, places, ["pooled"])
    assert len(statistics["pooled", PLAIN]) == len(hog)
    with pytest.raises(DataError, match="gone"):
        extract_features(
            store, baseline_encoder("pixels"), broken, places, ["pooled"]
        )  # of another size


class Broken:
    shape = (20, 30)

    def __len__(self) -> int:
        return 9

    def read(self, indices: object) -> None:
        raise DataError("gone")


def test_other_clips_are_in_another_place_and_many_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = source()
    places = {decoded.clip_folder(tmp_path, of, clips(of), spacing) for spacing in (0.1, 0.05)}
    fewer = clips(of)
    fewer.index = fewer.index[1:]
    places.add(decoded.clip_folder(tmp_path, of, fewer, 0.1))
    assert len(places) == 3
    monkeypatch.setattr(decoded, "LIMIT", 1000)
    assert decoded.clip_folder(tmp_path, of, clips(of), 0.1) is None
