"""Extra columns of the batch: declared by heads and objectives, cut from tracks of recordings."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.contracts import Column, Recording
from tactileforge.data.batches.clips import Clips, collate
from tactileforge.data.batches.columns import declared_columns, measure_columns, plain_sizes
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import ConfigError, DataError, PluginError
from tactileforge.testing import check
from tactileforge.training.parts import sizes_of


def recording(key: str = "a", **tracks: np.ndarray) -> Recording:
    """Ten frames at 10 Hz."""
    frames = np.random.default_rng(0).integers(0, 255, (10, 32, 32, 3)).astype(np.uint8)
    times = np.arange(10) / 10
    return Recording(
        key=key,
        sensor="digit",
        frames=ArrayFrames(frames),
        times=times,
        no_contact=None,
        tracks=tracks,
    )


def width(start: float = 0.0) -> np.ndarray:
    return (start + np.arange(10, dtype=np.float64))[:, None]


WIDTH = Column(name="width", track="gripper_width", statistics=True)
AHEAD = Column(name="ahead", track="gripper_width", window=(0, 4))
PHASE = Column(name="phase", window=(-1, 1), dtype="int64")


def clips(recordings: list[Recording], *columns: Column) -> Clips:
    sizes = measure_columns(columns, recordings)
    return Clips(recordings, 2, 0.2, 0.1, (32, 32), columns=sizes)


def test_columns_are_cut_at_the_frames_of_the_clip_and_in_windows() -> None:
    one = recording(gripper_width=width(), phase=np.arange(10) // 5)
    cut = clips([one], WIDTH, AHEAD, PHASE)
    first, last = cut[0], cut[len(cut) - 1]  # they end at frames 2 and 9
    assert first["width"].tolist() == [[0.0], [2.0]]
    assert first["width_valid"].tolist() == [True, True]
    assert first["ahead"][:, 0].tolist() == [2, 3, 4, 5]
    assert last["ahead"][:, 0].tolist() == [9, 9, 9, 9]
    assert last["ahead_valid"].tolist() == [True, False, False, False]
    assert cut[3]["phase"].tolist() == [0, 1]  # frames 4 and 5
    batch = collate([first, last])
    assert (batch["width"].dtype, batch["phase"].dtype) == (torch.float32, torch.int64)
    assert batch["ahead"].shape == (2, 4, 1)


def test_what_is_not_known_is_not_labelled() -> None:
    holes = width()
    holes[4] = np.nan
    cut = clips([recording("a", gripper_width=holes), recording("b")], WIDTH)
    row = cut[2]  # frames 2 and 4
    assert row["width_valid"].tolist() == [True, False]
    assert row["width"].tolist() == [[2.0], [0.0]]
    none = cut[len(cut) - 1]
    assert not none["width_valid"].any()
    assert none["width"].shape == (2, 1)


def test_sizes_and_statistics_are_those_of_the_tracks() -> None:
    pair = [recording("a", gripper_width=width()), recording("b", gripper_width=width(10.0))]
    sizes = measure_columns([WIDTH, AHEAD], pair).sizes
    values = np.concatenate([width(), width(10.0)])
    assert sizes["width"].shape == (1,)
    assert sizes["width"].mean == pytest.approx((values.mean(),))
    assert sizes["width"].deviation == pytest.approx((values.std(),))
    assert sizes["ahead"].mean is None
    kept = plain_sizes(measure_columns([WIDTH, AHEAD], pair))
    assert sizes_of({"columns": kept}) == dict(sizes)  # a run is read again


def test_what_cannot_be_cut_is_named() -> None:
    with pytest.raises(ConfigError, match=r"'gripper_width', which the data does not have \(it ha"):
        measure_columns([WIDTH], [recording(temperature=width())])
    odd = [recording("a", gripper_width=width()), recording("b", gripper_width=np.zeros((10, 2)))]
    with pytest.raises(DataError, match=r"b: a step of the track 'gripper_width' is \(2,\), and"):
        measure_columns([WIDTH], odd)
    lost = recording(gripper_width=np.full((10, 1), np.nan))
    with pytest.raises(DataError, match="no finite value"):
        measure_columns([WIDTH], [lost])


class Grip:
    """Declares a column."""

    columns = (WIDTH,)


class Chunk:
    """Declares as many steps as an option says."""

    @staticmethod
    def columns(options):
        return [Column(name="chunk", track="gripper_width", window=(0, options["steps"]))]


def test_heads_and_objectives_declare_columns_once() -> None:
    found = declared_columns([("head", Grip, {}), ("other", Grip, {}), ("c", Chunk, {"steps": 5})])
    assert [column.name for column in found] == ["width", "chunk"]
    assert found[1].window == (0, 5)
    other = type("Other", (), {"columns": (replace(WIDTH, window=(0, 2)),)})
    with pytest.raises(PluginError, match="head 'a' and head 'b' declare other columns by the na"):
        declared_columns([("head 'a'", Grip, {}), ("head 'b'", other, {})])
    taken = type("Taken", (), {"columns": (Column(name="force"),)})
    with pytest.raises(PluginError, match="'force', which every batch has"):
        declared_columns([("head 'a'", taken, {})])


PLUGIN = """
import numpy as np
import torch
from torch import nn
from tactileforge.plugin import ArrayFrames, Column, Recording, masked_mean


class Grips:
    provides, skipped = frozenset(), []

    def __init__(self, tracks: bool = True) -> None:
        self.tracks = tracks

    def recordings(self, split):
        for n in range(3 if split == "train" else 1):
            shade = np.random.default_rng([n, split == "val"]).integers(60, 200, 12)
            frames = np.broadcast_to(shade[:, None, None, None], (12, 32, 32, 3)).astype(np.uint8)
            tracks = {"gripper_width": shade[:, None] / 100} if self.tracks else {}
            yield Recording(key=f"{split}{n}", sensor="digit", frames=ArrayFrames(frames),
                            times=np.arange(12) / 15, no_contact=None, tracks=tracks)

    def plot(self, recording): ...


class GripHead(nn.Module):
    columns = (Column(name="width", track="gripper_width", statistics=True),)

    def __init__(self, encoder, column_sizes) -> None:
        super().__init__()
        size = column_sizes["width"]
        self.layer = nn.Linear(encoder.projected, *size.shape)
        self.register_buffer("mean", torch.tensor(size.mean))
        self.register_buffer("deviation", torch.tensor(size.deviation))

    def forward(self, views, batch):
        return self.layer(views.full.cls), (batch["width"][:, -1] - self.mean) / self.deviation


class Grip(nn.Module):
    head, needs = "grip", frozenset()
    columns = GripHead.columns

    def forward(self, prediction, batch):
        found, target = prediction
        return masked_mean((found - target).square().mean(-1), batch["width_valid"][:, -1]), {}
"""


@pytest.fixture
def _grip(installed) -> None:
    names = "[tactileforge.{0}s]\n{1} = grips:{2}\n"
    rows = [
        ("dataset", "grips", "Grips"),
        ("head", "grip", "GripHead"),
        ("objective", "grip", "Grip"),
    ]
    installed("grips", "".join(names.format(*row) for row in rows), {"grips.py": PLUGIN})


WORDS = ["scale=demo", "debug=steps", "encoder.image_size=32", "batch.size=4", "data=grips"]
WORDS += ["objective=[grip]", "batch.workers=0", "encoder.depth=1"]


@pytest.mark.slow
@pytest.mark.usefixtures("_grip")
def test_a_run_learns_a_width_and_keeps_its_size(tmp_path) -> None:
    module = train(compose("anytouch2", WORDS), tmp_path / "run")
    head = module.heads["grip"]
    assert 0.6 < float(head.mean) < 2
    assert module.trainer.callback_metrics["val/grip"] > 0
    from tactileforge.report.run import report_of_run
    from tactileforge.runs.folder import read_config

    kept = read_config(tmp_path / "run")["columns"]["width"]
    assert (kept["shape"], kept["mean"]) == ([1], pytest.approx([float(head.mean)]))
    assert report_of_run(tmp_path / "run").is_file()


@pytest.mark.usefixtures("_grip")
def test_a_track_that_is_missing_is_named_before_training(tmp_path) -> None:
    with pytest.raises(ConfigError, match="the column 'width' is cut from the track 'gripper_wid"):
        train(compose("anytouch2", [*WORDS, "data.tracks=false"]), tmp_path / "run")


@pytest.mark.slow
@pytest.mark.usefixtures("_grip")
def test_the_conformance_suite_feeds_columns() -> None:
    from grips import Grip as Objective
    from grips import GripHead

    results = check("head", GripHead) + check("objective", Objective, head=GripHead)
    assert [(r.name, r.detail) for r in results if r.status == "failed"] == []
    ran = {result.name for result in results if result.status == "ran"}
    assert {"unlabelled samples change nothing", "labels are counted"} <= ran


def test_a_clip_says_its_aspect_and_whether_it_lies_as_it_must() -> None:
    """Width over height as recorded, and the label ``upright``; another word is named."""
    wide = replace(recording(), frames=ArrayFrames(np.zeros((10, 24, 32, 3), np.uint8)))
    row = clips([wide])[0]
    assert (row["aspect"], row["upright"]) == (pytest.approx(4 / 3), False)
    for value, known in (("Yes", True), (1.0, True), ("no", False), (0.0, False)):
        assert clips([replace(wide, labels={"upright": value})])[0]["upright"] is known
    with pytest.raises(DataError, match="upright is 'perhaps': give yes or no"):
        clips([replace(wide, labels={"upright": "perhaps"})])[0]


def test_a_track_that_cannot_turn_is_named_before_the_first_step() -> None:
    one = recording(gripper_width=width())
    with pytest.raises(
        DataError, match=r"'gripper_width' is \(1,\), and one that turns as a wrench"
    ):
        measure_columns([replace(WIDTH, turns="wrench")], [one])
