"""Regression of descriptors: its scale, its mask, its noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactileforge.contracts import Batch, Features, Recording
from tactileforge.data.batches.clips import Clips, collate
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.descriptors import GROUPS, Descriptors
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.descriptors import DescribedTouch, DescriptorsHead
from tactileforge.objectives.descriptors import DescriptorRegression


def said(batch: Batch, off: float = 0.0) -> DescribedTouch:
    """A prediction of the true descriptors, off by so many deviations."""
    true = Descriptors.of(batch)
    return DescribedTouch((true.values + off)[:, None].expand(-1, 5, -1), true.values + off, true)


def test_the_loss_is_hubers_in_deviations(batch: Batch) -> None:
    objective = DescriptorRegression(image=1.0, contact=0.0, force=0.0)
    true = Descriptors.of(batch).values[:, GROUPS["image"]]
    near = true.abs().amax() < 6  # else clamped
    objective.deviation.fill_(1.0 if near else float(true.abs().amax()))
    prediction = said(batch)
    exact = DescribedTouch(
        prediction.tokens / objective.deviation,
        prediction.cls / objective.deviation + 0.5,
        prediction.true,
    )
    loss, logs = objective(exact, batch)
    assert loss.item() == pytest.approx(0.5 * 0.5**2, rel=1e-4)
    assert set(logs) == {"image", "contact", "force"}


def test_unlabelled_contact_does_not_count(batch: Batch) -> None:
    batch = batch | {"surface_valid": torch.zeros_like(batch["surface_valid"])}
    loss, _ = DescriptorRegression(image=0.0, contact=1.0, force=0.0)(said(batch, 3.0), batch)
    assert loss.item() == 0


def test_deviations_are_those_of_the_clips() -> None:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (10, 32, 32, 3), dtype=np.uint8)
    recording = Recording(
        key="a",
        sensor="digit",
        frames=ArrayFrames(images),
        times=np.arange(10) / 15,
        no_contact=ArrayFrames(images[:1]),
    )
    clips = Clips([recording], 4, 1 / 15, 1 / 15, (32, 32))
    objective = DescriptorRegression()
    objective.prepare(clips)
    true = Descriptors.of(collate([clips[place] for place in range(len(clips))])).values
    columns = GROUPS["image"]
    assert torch.allclose(objective.mean[columns], true.mean(0)[columns], atol=1e-5)
    spread = true.std(0, correction=0)[columns]
    moves = spread > 1e-6
    assert moves.any()
    assert torch.allclose(objective.deviation[columns][moves], spread[moves], rtol=1e-3)


def test_noise_is_a_share_of_each_channels_deviation(batch: Batch) -> None:
    torch.manual_seed(0)
    encoder = TactileViT("tiny", frames=4, image_size=32)
    head = DescriptorsHead(encoder, noise=0.4)
    tokens = torch.randn(8, encoder.prefix + 512, encoder.width)
    tokens[..., 0] *= 10
    views = SimpleNamespace(
        full=Features(tokens, torch.randn(8, encoder.projected), encoder.prefix, encoder.grid)
    )
    head.tokens = torch.nn.Identity()  # type: ignore[assignment]
    batch = {key: value for key, value in batch.items()}
    noise = head(views, batch).tokens - tokens[:, encoder.prefix :]
    share = noise.std((0, 1)) / tokens[:, encoder.prefix :].std((0, 1))
    assert share[0].item() == pytest.approx(0.4 * 2**0.5, rel=0.25)
    assert share.mean().item() == pytest.approx(0.4 * 2**0.5, rel=0.1)
    head.eval()
    assert torch.equal(head(views, batch).tokens, tokens[:, encoder.prefix :])
