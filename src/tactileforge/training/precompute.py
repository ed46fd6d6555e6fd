"""Tokens of a frozen encoder, computed once before training."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tactileforge.contracts import Remembering
from tactileforge.data.batches.datamodule import TouchData

log = logging.getLogger(__name__)


def remember_features(encoder: Any, data: TouchData) -> None:
    """Computes the tokens of clips once, for clips with `contracts.Remembering`.

    Other clips are read as usual. Tokens are kept in memory, as float16, and are the same when a
    run is resumed.

    Args:
        encoder: Frozen encoder.
        data: Data of the run, after its setup.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")

    def encode(frames: Tensor, background: Tensor, sensors: Sequence[str]) -> Tensor:
        rows = encoder.sensor_ids(sensors).to(device)
        with torch.no_grad():
            tokens: Tensor = encoder(frames.to(device), background.to(device), rows)[0]
        return tokens.cpu()

    mode = encoder.training
    encoder.to(device).eval()
    for clips in (data.train, data.val):
        if isinstance(clips, Remembering):
            log.info("tokens of %d clips are computed once", len(clips))
            clips.remember(encode)
    encoder.cpu().train(mode)
