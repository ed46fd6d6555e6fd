"""Outputs of a trained module on its data, for the report."""

from __future__ import annotations

from dataclasses import dataclass

from tactileforge.data.batches.clips import Clips, Skipped
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import DataError
from tactileforge.heads.decoder import Reconstruction
from tactileforge.heads.force import Forces
from tactileforge.report.captions import CaptionResult, nearest_captions
from tactileforge.report.classes import ClassResult, class_results
from tactileforge.report.embedding import Embedding, NeighbourScore, embedding_of, neighbours
from tactileforge.report.forces import ForceResult, force_results
from tactileforge.report.samples import (
    ClipReader,
    explained,
    liveliest,
    predictions,
    saliency,
    spread,
)
from tactileforge.report.strips import Strips, strips_of
from tactileforge.training.module import TouchModule

#: Largest numbers of clips per split to embed and read forces of, to reconstruct, and to show.
_CLIPS = 200
_REBUILT = 64
_SHOWN = 6


@dataclass(frozen=True)
class RunFindings:
    """Outputs of a module, for the report.

    Attributes:
        split: Split of the shown clips: ``val``, or ``train`` without validation.
        clips: Clips of that split.
        shown: Numbers of the shown clips.
        strips: Images of the shown clips.
        explained: Share of the variance of hidden pixels explained by reconstructions, by kind.
        forces: Results of force heads, one for each.
        classes: Results of heads for classes, one for each.
        embedding: Embedded clips of both splits.
        scores: Scores of nearest neighbours, by kind of label.
        captions: Captions nearest to touches; None where nothing was aligned with text.
        skipped: Recordings that could not be read, one line each.
    """

    split: str
    clips: Clips
    shown: list[int]
    strips: list[Strips]
    explained: dict[str, float]
    forces: list[ForceResult]
    classes: list[ClassResult]
    embedding: Embedding
    scores: dict[str, NeighbourScore | None]
    captions: CaptionResult | None
    skipped: list[str]


def run_findings(
    module: TouchModule, data: TouchData, skipped: Skipped, learned: int
) -> RunFindings:
    """Runs a module on some clips of its data.

    Args:
        module: Trained module.
        data: Data of the run, set up.
        skipped: Recordings that training could not read.
        learned: Number of clips trained on, an upper limit of the clips of a split to run.

    Raises:
        DataError: The data is not set up.
    """
    splits = {"val": data.val, "train": data.train}
    present = {split: clips for split, clips in splits.items() if clips is not None}
    if "train" not in present:
        raise DataError("setup() has not been called")
    skipped, count = data.skipped | dict(skipped), min(_CLIPS, learned)
    split, clips = next(iter(present.items()))  # validation, if there is any
    # the type of a prediction, not the name of a head, tells which heads predict forces
    _, tried = predictions(module, clips, [0])
    forces = [key for key, value in tried.items() if isinstance(value, Forces)]
    readers = {
        split: ClipReader(module, clips, forces, skipped) for split, clips in present.items()
    }
    looks = {split: reader.embed(spread(reader.clips, count)) for split, reader in readers.items()}
    shown = liveliest(clips, looks[split], _SHOWN)
    patches, predicted = predictions(module, clips, shown)
    salient = saliency(module, clips, shown)
    rebuilt = {key: value for key, value in predicted.items() if isinstance(value, Reconstruction)}
    embedding = embedding_of(data, looks)
    return RunFindings(
        split=split,
        clips=clips,
        shown=shown,
        strips=[
            strips_of(module.encoder, patches, list(rebuilt.values()), row, salient)
            for row in range(len(shown))
        ],
        explained=explained(module, clips, spread(clips, min(_REBUILT, count)), list(rebuilt)),
        forces=force_results(readers, forces, count),
        classes=class_results(module, split, readers[split], data.objects, count),
        embedding=embedding,
        scores={kind: neighbours(embedding, kind) for kind in embedding.labels},
        captions=nearest_captions(
            module, split, readers[split], looks[split].clips.tolist(), shown
        ),
        skipped=[line for line, _ in skipped.values()],
    )
