"""Classes named by a head, against those of the clips."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from markupsafe import Markup

from tactileforge.data.batches.clips import Clips
from tactileforge.data.labels.objects import object_class
from tactileforge.heads.classify import ClassifyHead
from tactileforge.pages.images import image
from tactileforge.pages.page import (
    SPLIT_WORDS,
    Section,
    card,
    cards,
    heading,
    paragraph,
    percent,
    table,
)
from tactileforge.report.samples import ClipReader, batches, quiet, spread
from tactileforge.training.module import TouchModule

#: Most classes of a confusion matrix, most confusions that are listed, and most wrong clips shown.
_MATRIX = 12


@dataclass(frozen=True)
class ClassResult:
    """Classes named by one head, of clips of the training objects.

    Attributes:
        objective: Name of the objective of the head.
        split: The split.
        names: Names of the classes, those of the training objects.
        own: Class of each clip.
        said: Class that the head names.
        probability: Probability of that class, 0 to 1.
        clips: Number of each clip in its split.
        pictures: Last frame of the wrong clips that are shown, float (3, H, W) in 0..1, by clip.
    """

    objective: str
    split: str
    names: list[str]
    own: list[str]
    said: list[str]
    probability: list[float]
    clips: list[int]
    pictures: dict[int, torch.Tensor]

    @property
    def accuracy(self) -> float:
        """Share of the rightly named clips."""
        return float(np.mean([a == b for a, b in zip(self.own, self.said, strict=True)]))

    @property
    def guess(self) -> float:
        """Share of the most frequent class."""
        return max(Counter(self.own).values()) / len(self.own)

    @property
    def line(self) -> str:
        """The result in a line."""
        return (
            f"Classes: {percent(self.accuracy)} of {len(self.own)} {SPLIT_WORDS[self.split]} clips "
            f"are named right, of {len(self.names)} classes; always guessing the most frequent: "
            f"{percent(self.guess)}"
        )

    @property
    def wrong(self) -> list[int]:
        """Places of the wrongly named clips, the surest first."""
        places = [i for i, own in enumerate(self.own) if own != self.said[i]]
        return sorted(places, key=lambda i: (-self.probability[i], i))


def class_results(
    module: TouchModule, split: str, reader: ClipReader, names: Sequence[str], count: int
) -> list[ClassResult]:
    """Names the classes of clips with every head for classes.

    Args:
        module: Trained module.
        split: Split of the clips.
        reader: Reader of the split.
        names: Names of the training objects.
        count: Largest number of clips.
    """
    heads = {k: head for k, head in module.heads.items() if isinstance(head, ClassifyHead)}
    known, recordings = set(names), reader.clips.recordings
    which = spread(reader.clips, count, lambda recording: recording.object in known)
    if not heads or not which:
        return []
    clips = reader.embed(which).clips.tolist()
    own = [str(recordings[reader.clips.index[clip, 0]].object) for clip in clips]
    vectors = torch.from_numpy(reader.vectors(clips)).to(module.device)
    results = []
    for key, head in heads.items():
        rows = [object_class(name, head.linear.out_features) for name in names]
        with quiet(module):
            share, place = head.linear(vectors)[:, rows].float().softmax(-1).cpu().max(-1)
        said = [names[i] for i in place.tolist()]
        result = ClassResult(key, split, list(names), own, said, share.tolist(), clips, {})
        shown = [clips[i] for i in result.wrong[:_MATRIX]]
        for batch in batches(module, reader.clips, shown):
            last = batch["frames"][:, -1].float().cpu() / 255
            result.pictures.update(zip(batch["clip"].tolist(), last, strict=True))
        results.append(result)
    return results


def classes_section(results: Sequence[ClassResult], clips: Clips) -> Section:
    """Confusions, and the wrongly named clips."""
    body = Markup()
    for result in results:
        if len(results) > 1:
            body += heading(result.objective)
        body += paragraph(f"{result.line}.") + _confusions(result)
        if result.wrong:
            body += heading("Named wrong, the surest first")
            body += paragraph("A sure one may have the wrong label.", soft=True)
            body += cards(_card(result, place, clips) for place in result.wrong[:_MATRIX])
    return Section("classes", "Classes", body)


def _confusions(result: ClassResult) -> Markup:
    pairs = Counter(zip(result.own, result.said, strict=True))
    name = f"classes-{result.objective}"
    if len(result.names) <= _MATRIX:
        rows = [(own, *(str(pairs[own, said]) for said in result.names)) for own in result.names]
        note = "Clips of each class (rows) by the class that is named (columns)."
        return table(name, ("", *result.names), rows, note)
    often = [(own, said, count) for (own, said), count in pairs.most_common() if own != said]
    rows = [(own, f"text|{said}", str(count)) for own, said, count in often[:_MATRIX]]
    note = "The most frequent confusions."
    return table(name, ("Class", "text|named", "clips"), rows, note)


def _card(result: ClassResult, place: int, clips: Clips) -> Markup:
    clip, own, said = result.clips[place], result.own[place], result.said[place]
    key = clips.recordings[clips.index[clip, 0]].key
    picture = result.pictures.get(clip)
    shown = Markup() if picture is None else image(picture, f"{own}, named {said}")
    return card(f"{own}, named {said}", shown, f"{percent(result.probability[place])} sure: {key}")
