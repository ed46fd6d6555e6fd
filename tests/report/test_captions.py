"""Captions nearest to touches, against a closed form."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from lookup import Lookup
from torch import nn

from tactileforge.heads.align import AlignHead
from tactileforge.report.captions import (
    CaptionResult,
    CaptionRow,
    captions_section,
    nearest_captions,
)
from tactileforge.report.strips import Strips

CAPTIONS = ["a ball", "a bar", "a cube"]


class Reader:
    """Clips with a vector and a caption each."""

    def __init__(self, vectors: torch.Tensor, own: list[str]) -> None:
        self._vectors, self._own = vectors.numpy(), own
        recordings = [
            SimpleNamespace(sensor="digit", object=None, key=f"r{i}") for i in range(len(own))
        ]
        index = np.stack([np.arange(len(own)), np.zeros(len(own), int)], 1)
        self.clips = SimpleNamespace(recordings=recordings, index=index)

    def captions(self, which: list[int]) -> list[str]:
        return [self._own[i] for i in which]

    def vectors(self, which: list[int]) -> np.ndarray:
        return self._vectors[which]


def module(text: bool = True) -> Any:
    """A module with an aligned head: captions lie along the axes of the space."""
    encoder = SimpleNamespace(projected=3)
    head = AlignHead(
        encoder, Lookup(dict(zip(CAPTIONS, torch.eye(3), strict=True))) if text else None, None
    )
    if text:
        nn.init.eye_(head.text_project.weight)
    made: Any = nn.Module()
    made.heads = nn.ModuleDict({"align": head})
    made.device = torch.device("cpu")
    return made


def test_captions_are_ordered_by_their_cosine() -> None:
    vectors = torch.tensor([[3.0, 4, 0], [0, 2, 0], [0, 0, -1], [1, 0, 0]])
    reader: Any = Reader(vectors, ["a ball", "a bar", "", "a cube"])
    found = nearest_captions(module(), "val", reader, [0, 1, 2, 3], [0, 2])
    assert found is not None
    assert (found.captions, found.clips) == (3, 3)
    assert found.first == pytest.approx(1 / 3), "the bar alone finds its own"
    assert [row.title for row in found.rows] == ["digit · r0", "digit · r2"]
    assert [row.caption for row in found.rows] == ["a ball", ""]
    names = [[name for name, _ in row.nearest] for row in found.rows]
    assert names == [["a bar", "a ball", "a cube"], ["a ball", "a bar", "a cube"]]
    assert [cosine for _, cosine in found.rows[0].nearest] == pytest.approx([0.8, 0.6, 0])
    assert found.rows[1].nearest[-1][1] == pytest.approx(-1)


def test_without_captions_or_a_text_tower_there_is_nothing_to_compare() -> None:
    reader: Any = Reader(torch.eye(3), ["", "", ""])
    assert nearest_captions(module(), "val", reader, [0, 1, 2], [0]) is None
    reader = Reader(torch.eye(3), CAPTIONS)
    assert nearest_captions(module(text=False), "val", reader, [0, 1, 2], [0]) is None


def strips() -> Strips:
    frames = torch.stack([torch.full((3, 8, 8), level) for level in (0.1, 0.8)])
    return Strips(rows={"Input": frames}, explained={}, gain=1.0)


def test_the_section_ticks_a_clips_own_caption() -> None:
    row = CaptionRow("digit · <r>", "a bar", [("a bar", 0.8), ("a <ball>", -0.25)])
    section = captions_section(CaptionResult("val", [row], 2, 40, 0.75), [strips()])
    assert '<li class="good">0.80  a bar</li>' in section.body
    assert '<li class="plain">\N{MINUS SIGN}0.25  a &lt;ball&gt;</li>' in section.body
    assert "for 75 % of 40 clips; a guess would be right for 50 %" in section.body
    assert section.body.count("<img") == 2
    assert "Its own caption: a bar" in section.body
    alone = captions_section(CaptionResult("train", [], 1, 4, 1.0), [])
    assert "All training clips have one and the same caption" in alone.body
