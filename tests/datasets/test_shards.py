"""Recorded takes are held out only if nothing was held out before."""

from pathlib import Path

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data.batches.sources import sources_of
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards.shards import Packed, describe_recording, write_shard
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError

BLACK = encode_image(np.zeros((8, 8, 3), np.uint8), "png")


@pytest.fixture
def takes(tmp_path: Path) -> Path:
    """Twenty takes of two sensors, in a shard without an index, as `record` leaves them."""
    packed = []
    for take in range(20):
        for device in ("left", "right"):
            frames = ArrayFrames(np.zeros((30, 8, 8, 3), np.uint8))
            recording = Recording(
                key=f"out/{take:06d}/{device}/0000",
                sensor="digit",
                frames=frames,
                times=np.arange(30) / 30,
                no_contact=None,
                object=f"cup_{take % 5}",
                labels={"take": take},
            )
            packed.append(Packed(describe_recording(recording), "png", [BLACK] * 30, [], []))
    write_shard(tmp_path / "train-000000.tar", packed)
    return tmp_path


@pytest.mark.parametrize("unit", ["take", "object", "time"])
def test_a_share_is_held_out(takes: Path, unit: str) -> None:
    data = Shards(str(takes), val=0.3, hold_out=unit)
    train, val = (list(data.recordings(split)) for split in ("train", "val"))
    total = sum(len(one.frames) for one in [*train, *val])
    assert total == 40 * 30
    assert 0 < sum(len(one.frames) for one in val) < total / 2
    if unit != "time":
        named = {"take": lambda one: one.labels["take"], "object": lambda one: one.object}[unit]
        assert not {named(one) for one in train} & {named(one) for one in val}
    (source,) = sources_of(data, "val")
    assert source.summary.recordings == len(val)


def test_nothing_is_held_out_unless_asked_for(takes: Path) -> None:
    data = Shards(str(takes))
    assert len(list(data.recordings("train"))) == 40
    assert list(data.recordings("val")) == []
    with pytest.raises(ConfigError, match=r"unknown hold_out 'takes'.*take"):
        Shards(str(takes), hold_out="takes")
    with pytest.raises(ConfigError, match="val is 1"):
        Shards(str(takes), val=1)
