"""Outputs of a trained module on its data, which the report shows beside the metrics."""

from __future__ import annotations

from dataclasses import dataclass

from tactileforge.data.batches.clips import Clips, Skipped
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import DataError
from tactileforge.heads.decoder import Reconstruction
from tactileforge.heads.force import Forces
from tactileforge.module import TouchModule
from tactileforge.report.embedding import Embedding, NeighbourScore, embedding_of, neighbours
from tactileforge.report.forces import ForceResult, force_results
from tactileforge.report.pictures import Strips, strips_of
from tactileforge.report.samples import ClipReader, explained, liveliest, predictions, spread

#: Clips of a split that are embedded and whose forces are read, clips that are reconstructed, and
#: clips that are shown; at most.
_CLIPS = 200
_REBUILT = 64
_SHOWN = 6


@dataclass(frozen=True)
class RunFindings:
    """Outputs of a module that the report shows.

    Attributes:
        split: Split of the clips that are shown: ``val``, or ``train`` without validation.
        clips: The clips of that split.
        shown: Numbers of those that are shown.
        strips: Their images.
        explained: Share of the variance of hidden pixels that is explained, by kind.
        forces: One for each head that predicts force.
        embedding: Of both splits.
        scores: Scores of nearest neighbours, by kind.
        skipped: Recordings that could not be read, one line each.
    """

    split: str
    clips: Clips
    shown: list[int]
    strips: list[Strips]
    explained: dict[str, float]
    forces: list[ForceResult]
    embedding: Embedding
    scores: dict[str, NeighbourScore | None]
    skipped: list[str]


def run_findings(
    module: TouchModule, data: TouchData, skipped: Skipped, learned: int
) -> RunFindings:
    """Runs a module on some clips of its data.

    Args:
        module: Trained.
        data: Set up.
        skipped: Recordings that training could not read.
        learned: Clips that it was trained on; not more of a split are looked at.

    Raises:
        DataError: The data is not set up.
    """
    splits = {"val": data.val, "train": data.train}
    present = {split: clips for split, clips in splits.items() if clips is not None}
    if "train" not in present:
        raise DataError("setup() has not been called")
    skipped, count = data.skipped | dict(skipped), min(_CLIPS, learned)
    split, clips = next(iter(present.items()))
    _, tried = predictions(module, clips, [0])
    forces = [key for key, value in tried.items() if isinstance(value, Forces)]
    readers = {
        split: ClipReader(module, clips, forces, skipped) for split, clips in present.items()
    }
    looks = {split: reader.embed(spread(reader.clips, count)) for split, reader in readers.items()}
    shown = liveliest(clips, looks[split], _SHOWN)
    patches, predicted = predictions(module, clips, shown)
    rebuilt = {key: value for key, value in predicted.items() if isinstance(value, Reconstruction)}
    embedding = embedding_of(data, looks)
    return RunFindings(
        split=split,
        clips=clips,
        shown=shown,
        strips=[
            strips_of(module.encoder, patches, list(rebuilt.values()), row)
            for row in range(len(shown))
        ],
        explained=explained(module, clips, spread(clips, min(_REBUILT, count)), list(rebuilt)),
        forces=force_results(readers, forces, count),
        embedding=embedding,
        scores={kind: neighbours(embedding, kind) for kind in embedding.labels},
        skipped=[line for line, _ in skipped.values()],
    )
