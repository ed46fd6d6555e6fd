import pytest
from lightning import LightningModule, Trainer

from tactileforge.contracts import Batch
from tactileforge.errors import DataError
from tactileforge.training.coverage import LabelCoverage, SkippedRecordings
from tactileforge.training.module import TouchModule


def test_a_run_stops_with_a_list_of_what_it_cannot_read() -> None:
    lost = SkippedRecordings(allowed=3)
    lost.skip({"a": ("a.tar: cut off", 2)})
    lost.skip({"a": ("a.tar: cut off", 2), "b": ("b.mp4: damaged", 1)})
    lost.skip({"b": ("b.mp4: damaged elsewhere", 1)})
    assert lost.skipped == {"a": ("a.tar: cut off", 2), "b": ("b.mp4: damaged", 1)}
    with pytest.raises(DataError, match=r"4 recordings .* allows 3(.|\n)*a\.tar(.|\n)*c\.png"):
        lost.skip({"c": ("c.png: no picture", 1)})


class Two(TouchModule):
    """A module with one objective asleep."""

    def __init__(self) -> None:
        LightningModule.__init__(self)
        needy = type("Needy", (), {"needs": frozenset({"force"})})
        self.objectives = {"force": needy(), "asleep": needy()}  # type: ignore[assignment]

    def current_weights(self) -> dict[str, float]:
        return {"force": 1.0, "asleep": 0.0}


def test_what_was_met_goes_on_after_a_resume(batch: Batch) -> None:
    lost, coverage = SkippedRecordings(), LabelCoverage(Two())
    batch["skipped"] = {"a": ("a.tar: cut off", 2)}
    for training in (True, True, False):
        coverage.observe(batch, training)
        lost.observe(batch, training)
    checkpoint: dict[str, object] = {}
    trainer = Trainer(logger=False, enable_checkpointing=False)
    for kept in (lost, coverage):
        kept.on_save_checkpoint(trainer, coverage.module, checkpoint)
    counts = {"force": {"batches": 2, "clips": 16, "labelled": 8, "x": 8, "y": 8, "z": 8}}
    assert checkpoint == {"skipped": {"a": ("a.tar: cut off", 2)}, "labels": counts}
    again = LabelCoverage(Two())
    again.on_load_checkpoint(trainer, again.module, checkpoint)
    again.observe(batch, True)
    assert again.labels.counts["force"]["batches"] == 3
    assert coverage.labels.counts == counts
