"""The embedding map, and nearest-neighbour scores of the embedding."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.pages.figures import scatter_figure
from tactileforge.pages.page import Section, legend, panel, panels, paragraph, percent, table
from tactileforge.report.samples import ClipSample, whole_key

#: Number of neighbours, and temperature of their votes.
_NEIGHBOURS = 5
_TEMPERATURE = 0.07
#: Largest number of classes with a colour of their own in a map.
_SHOWN = 12


@dataclass(frozen=True)
class Embedding:
    """Embedded clips of both splits.

    Attributes:
        vectors: float64 (n, d), unit length.
        recordings: Key of the whole recording of each clip, without the suffix of a part.
        held_out: bool (n,), True for validation clips.
        labels: Names of the clips' classes, by kind (sensor, object, action); "" for unknown.
    """

    vectors: NDArray[np.float64]
    recordings: list[str]
    held_out: NDArray[np.bool_]
    labels: dict[str, list[str]]


@dataclass(frozen=True)
class NeighbourScore:
    """Accuracy of classification by nearest neighbours in other recordings.

    Attributes:
        accuracy: Accuracy, mean over classes, 0 to 1.
        chance: Accuracy of a guess, 0 to 1.
        clips: Number of classified clips.
        classes: Number of their classes.
    """

    accuracy: float
    chance: float
    clips: int
    classes: int


def embedding_of(data: TouchData, looks: dict[str, ClipSample]) -> Embedding:
    """Joins the clips of the splits and drops clips with a non-finite embedding.

    Args:
        data: Data of the run.
        looks: Embedded clips, by split: ``train`` and ``val``.
    """
    recordings: list[str] = []
    labels: dict[str, list[str]] = {"sensor": [], "object": [], "action": []}
    for split, look in looks.items():
        clips: Clips = getattr(data, split)
        actions = clips.labels()[2][look.clips]
        labels["action"] += [ACTIONS[a] if a >= 0 else "" for a in actions.tolist()]
        for number in clips.index[look.clips, 0].tolist():
            recording = clips.recordings[number]
            recordings.append(whole_key(recording))
            labels["sensor"].append(recording.sensor)
            labels["object"].append(recording.object or "")
    vectors = np.concatenate([look.cls for look in looks.values()]).astype(np.float64)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True).clip(1e-12)
    held_out = np.concatenate([np.full(len(look.clips), s == "val") for s, look in looks.items()])
    fine = np.isfinite(vectors).all(1)  # one NaN would spoil the axes of all
    kept = np.flatnonzero(fine).tolist()
    names = {kind: [known[i] for i in kept] for kind, known in labels.items()}
    return Embedding(vectors[fine], [recordings[i] for i in kept], held_out[fine], names)


def neighbours(embedding: Embedding, kind: str) -> NeighbourScore | None:
    """Leave-one-recording-out k-NN accuracy, by the five nearest clips of other recordings.

    Validation clips (training clips without a validation split) are classified by their neighbours
    in both splits. A clip is left out if no other recording has its class. Votes are weighted by
    ``exp(cosine / 0.07)``.

    Returns:
        The score; None with less than two classes, or without a clip to classify.
    """
    names = np.array(embedding.labels[kind])
    known = names != ""
    recordings = np.array(embedding.recordings)
    classes, number = np.unique(names[known], return_inverse=True)
    if len(classes) < 2:
        return None
    ask = known & embedding.held_out if embedding.held_out.any() else known
    right: dict[str, list[bool]] = {}
    for i in np.flatnonzero(ask):
        # clips of one recording look alike whatever the encoder: they would vote for themselves
        others = recordings[known] != recordings[i]
        if names[i] not in names[known][others]:
            continue
        nearness = np.where(others, embedding.vectors[known] @ embedding.vectors[i], -np.inf)
        near = np.argsort(-nearness, kind="stable")[: min(_NEIGHBOURS, int(others.sum()))]
        weights = np.exp((nearness[near] - 1) / _TEMPERATURE)  # - 1: no overflow, same vote
        votes = np.bincount(number[near], weights, len(classes))
        right.setdefault(names[i], []).append(classes[votes.argmax()] == names[i])
    if not right:
        return None
    # mean over classes: a frequent one would hide the others
    accuracy = float(np.mean([np.mean(hits) for hits in right.values()]))
    return NeighbourScore(accuracy, 1 / len(classes), sum(map(len, right.values())), len(right))


def principal(vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates on the first two principal axes (n, 2), and every axis's share of variance."""
    centred = vectors - vectors.mean(0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    # the sign of an axis is arbitrary: fixed here, so that each report of a run has the same map
    axes *= np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(1)])[:, None]
    shares = sizes**2 / max(float((sizes**2).sum()), 1e-12)
    return centred @ axes[:2].T, shares


def embedding_section(embedding: Embedding, scores: dict[str, NeighbourScore | None]) -> Section:
    """The maps, one for each kind of label, and the scores."""
    name, title = "embedding", "Embedding map"
    if len(embedding.vectors) < 3:
        return Section(
            name, title, paragraph("Fewer than three clips with a finite embedding: no map.")
        )
    places, shares = principal(embedding.vectors)
    if not shares.any():
        return Section(name, title, paragraph("All clips have one and the same embedding."))
    known = [kind for kind, names in embedding.labels.items() if any(names)]
    maps = panels(_map(kind, embedding, places, shares, scores[kind]) for kind in known)
    rows = [(kind, *_cells(scores[kind])) for kind in known]
    split = "validation clips" if embedding.held_out.any() else "training clips"
    note = (
        f"k-NN: the {_NEIGHBOURS} nearest clips of other recordings vote on the class of {split}; "
        "mean over classes. A recording never helps to recognise itself."
    )
    head = ("What is read", "k-NN accuracy", "chance", "clips", "classes")
    count, size = embedding.vectors.shape
    faint = " Training clips are drawn faintly." if embedding.held_out.any() else ""
    # the participation ratio: k for a variance spread evenly over k axes
    used = 1 / float((shares**2).sum())
    introduction = paragraph(
        f"Projected class tokens of {count} clips of {len(set(embedding.recordings))} recordings "
        f"on their first two principal axes; outliers are drawn at the edge.{faint} The map shows "
        f"{percent(float(shares[:2].sum()))} of the variance, which is spread over about "
        f"{used:.1f} of {size} dimensions: trust the numbers below it more than the map."
    )
    body = introduction + maps + table("neighbours", head, rows, note)
    if missing := [kind for kind in embedding.labels if kind not in known]:
        body += paragraph(f"Not known of these clips: {', '.join(missing)}.", soft=True)
    return Section(name, title, body)


def _map(
    kind: str,
    embedding: Embedding,
    places: NDArray[np.float64],
    shares: NDArray[np.float64],
    score: NeighbourScore | None,
) -> Markup:
    counts = Counter(name for name in embedding.labels[kind] if name)
    # the most frequent ones get colours; by name among equals, so that maps stay the same
    names = [name for name, _ in sorted(counts.items(), key=lambda item: (-item[1], item[0]))]
    shown = sorted(names[:_SHOWN])
    which = {name: i for i, name in enumerate(shown)}
    classes = np.array([which.get(name, -1) for name in embedding.labels[kind]])
    faint = embedding.held_out.any()
    # a few outliers would shrink all other points to a dot
    low, high = np.percentile(places, [1, 99], axis=0)
    x, y = np.clip(places, low - 0.2 * (high - low), high + 0.2 * (high - low)).T
    groups = [
        (x[chosen], y[chosen], classes[chosen], strength)
        for chosen, strength in (
            (~embedding.held_out, 0.35 if faint else 0.9),
            (embedding.held_out, 0.95),
        )
        if chosen.any()
    ]
    axes = (f"axis 1 ({percent(float(shares[0]))})", f"axis 2 ({percent(float(shares[1]))})")
    left = len(names) - len(shown)
    others = [f"{left} more"] * (left > 0) + ["unknown"] * ("" in embedding.labels[kind])
    words = f"k-NN {percent(score.accuracy)}, chance {percent(score.chance)}" if score else ""
    keys = dict(enumerate(shown))
    if others:
        keys[-1] = " or ".join(others)
    return panel(f"By {kind}", scatter_figure(groups, axes) + legend(keys), words)


def _cells(score: NeighbourScore | None) -> Sequence[str]:
    if score is None:
        return "text|no answer: one class, or no class in two recordings", "", "", ""
    shares = percent(score.accuracy), percent(score.chance)
    return *shares, str(score.clips), str(score.classes)
