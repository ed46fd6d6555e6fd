"""Labels are counted as they are seen, and missed out loud."""

import logging

import pytest
import torch

from tactileforge.contracts import Batch
from tactileforge.training.labels import PATIENCE, Labels, known


def test_labels_that_a_batch_has(batch: Batch) -> None:
    batch["force_valid"][2, :2] = False
    assert known(batch, {"force"}) == [True, False] * 4  # z alone is a label
    assert known(batch, {"object|action"}) == [True] * 8
    assert known(batch, {"action"}) == [True] * 6 + [False] * 2
    assert known(batch, {"text|image"}) == [True, True, False, True, True, True, True, True]
    assert known(batch, {"text", "image"}) == [True, True, False, True, False, False, True, True]


def test_an_objective_without_labels_is_named_once(
    batch: Batch, caplog: pytest.LogCaptureFixture
) -> None:
    batch["force_valid"][:] = False
    labels = Labels()
    with caplog.at_level(logging.WARNING):
        for number in range(PATIENCE + 5):
            assert bool(labels.missing("force")) == (number >= PATIENCE)
            labels.add("force", frozenset({"force"}), batch)
            labels.add("align", frozenset({"text|image"}), batch)
            labels.add("pixel", frozenset(), batch)
    (record,) = caplog.records
    words = "'force' has seen no label in its first 20 batches (160 clips): it learns nothing"
    assert words in record.message
    assert labels.missing("align") == labels.missing("pixel") == ""
    assert labels.counts["align"]["labelled"] == 7 * (PATIENCE + 5)
    assert "pixel" not in labels.counts


def test_axes_without_labels_are_named(batch: Batch) -> None:
    batch["force_valid"][:, :2] = False
    labels = Labels()
    for _ in range(PATIENCE):
        labels.add("force", frozenset({"force"}), batch)
    assert labels.counts["force"] == {
        "batches": PATIENCE,
        "clips": 8 * PATIENCE,
        "labelled": 4 * PATIENCE,
        "x": 0,
        "y": 0,
        "z": 4 * PATIENCE,
    }
    assert "has seen no force along x and y in its first 20 batches" in labels.missing("force")
    batch["force_valid"] = torch.ones(8, 3, dtype=torch.bool)
    labels.add("force", frozenset({"force"}), batch)
    assert labels.missing("force") == ""
