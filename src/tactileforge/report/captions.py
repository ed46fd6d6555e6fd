"""Captions nearest to touches, for runs aligned with language."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from markupsafe import Markup
from numpy.typing import NDArray
from torch.nn import functional as F

from tactileforge.heads.align import AlignHead
from tactileforge.pages.images import image, strip
from tactileforge.pages.page import (
    MINUS,
    SPLIT_WORDS,
    Section,
    card,
    cards,
    paragraph,
    percent,
    verdict,
)
from tactileforge.report.samples import ClipReader, clip_title, quiet
from tactileforge.report.strips import Strips
from tactileforge.training.module import TouchModule

#: Number of captions shown of a clip.
_NEAREST = 3


@dataclass(frozen=True)
class CaptionRow:
    """A touch, and the captions nearest to it.

    Attributes:
        title: Sensor, object and key of the recording.
        caption: Caption of the clip; "" for none.
        nearest: Captions with their cosines, the nearest first.
    """

    title: str
    caption: str
    nearest: list[tuple[str, float]]


@dataclass(frozen=True)
class CaptionResult:
    """Captions of a split, compared with its touches.

    Attributes:
        split: The split.
        rows: The shown clips.
        captions: Number of distinct captions.
        clips: Number of clips with a caption.
        first: Share of these clips whose own caption is the nearest of all.
    """

    split: str
    rows: list[CaptionRow]
    captions: int
    clips: int
    first: float


def nearest_captions(
    module: TouchModule, split: str, reader: ClipReader, which: Sequence[int], shown: Sequence[int]
) -> CaptionResult | None:
    """Compares touches with the captions of the same clips, by cosine in the shared space.

    Args:
        module: Trained module.
        split: Split of the clips.
        reader: Reader of the split.
        which: Numbers of the clips to compare.
        shown: Numbers of the clips to show.

    Returns:
        The comparison; None without a head that aligned text, or without captions.
    """
    aligned = (head for head in module.heads.values() if isinstance(head, AlignHead))
    head = next((head for head in aligned if head.text_encoder is not None), None)
    own = reader.captions(which)
    known = sorted(set(own) - {""})
    if head is None or not known:
        return None
    with quiet(module):
        text = F.normalize(head.text_vectors(known).float(), dim=-1).cpu().numpy()
    right = [
        known[int(cosines.argmax())] == caption
        for cosines, caption in zip(_cosines(reader, which, text), own, strict=True)
        if caption
    ]
    rows = []
    for clip, caption, cosines in zip(
        shown, reader.captions(shown), _cosines(reader, shown, text), strict=True
    ):
        # stable, so that equal captions keep their order from report to report
        order = np.argsort(-cosines, kind="stable")[:_NEAREST].tolist()
        nearest = [(known[i], float(cosines[i])) for i in order]
        rows.append(CaptionRow(clip_title(reader.clips, clip), caption, nearest))
    return CaptionResult(split, rows, len(known), len(right), float(np.mean(right)))


def _cosines(
    reader: ClipReader, which: Sequence[int], text: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Cosines of touches and captions, (clips, captions); NaN for an embedding without length."""
    touch = torch.from_numpy(reader.vectors(which))
    cosines: NDArray[np.float32] = F.normalize(touch, dim=-1).numpy() @ text.T
    return cosines


def captions_section(result: CaptionResult, strips: Sequence[Strips]) -> Section:
    """Touches with their nearest captions, and how often their own is the nearest.

    Args:
        result: Comparison of touches and captions.
        strips: Images of the shown clips.
    """
    name, title = "captions", "Touch to words"
    split = SPLIT_WORDS[result.split]
    if result.captions < 2:
        text = f"All {split} clips have one and the same caption: nothing to choose from."
        return Section(name, title, paragraph(text))
    text = (
        f"The nearest of {result.captions} captions of {split} clips is a clip's own for "
        f"{percent(result.first)} of {result.clips} clips; a guess would be right for "
        f"{percent(1 / result.captions)}. Below are the clips of the section Frames, first frame "
        "and last, with the nearest captions and their cosines in the space of touch and language. "
        "A clip's own caption is ticked."
    )
    shown = (_card(row, images) for row, images in zip(result.rows, strips, strict=True))
    return Section(name, title, paragraph(text) + cards(shown, 20))


def _card(row: CaptionRow, strips: Strips) -> Markup:
    """Pictures of a touch, and the captions nearest to it."""
    frames = strips.rows["Input"]
    ends = [frames[0], frames[-1]] if len(frames) > 1 else frames
    images = [image(frame, f"{row.title}, frame") for frame in ends]
    lines = [
        (
            "good" if caption == row.caption else "plain",
            f"{cosine:.2f}  {caption}".replace("-", MINUS, int(cosine < 0)),
        )
        for caption, cosine in row.nearest
    ]
    own = f"Its own caption: {row.caption}" if row.caption else "It has no caption."
    return card(row.title, strip(images, len(images)) + verdict(lines), own)
