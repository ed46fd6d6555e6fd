"""A force probe with the encoder in every epoch, as published, against features computed once.

Few clips are measured, and the times are extrapolated: 50 epochs of 4,000 clips as published take
days on a CPU. The result gives the number of measured clips and epochs. Both ways are also trained
to their end on the same few clips, from the same seeds, and their errors on held-out touches are
compared.

    python probe.py [clips] [epochs]
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import save, side_by_side
from tactileforge_bench.fit.evaluate import SourceFeatures, evaluate_probe
from tactileforge_bench.fit.features import (
    PLAIN,
    FeatureStore,
    extract_features,
    read_batches,
    readers,
)
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.resolve import PreparedTask, choose_probe
from tactileforge_bench.results.intervals import Interval, mean_interval
from tactileforge_bench.tasks import splits, targets
from tactileforge_bench.tasks.source import TaskSource, open_source
from tactileforge_bench.tasks.suite import Task, parse_task
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders import AttentivePooler, TactileViT
from tactileforge.hub import make_header

#: Number of clips and epochs of the extrapolated times.
CLIPS, EPOCHS = 4000, 50
#: Batch size and learning rate of both ways.
BATCH, RATE = 64, 2e-4
#: Batch of clips for the extraction of features.
ENCODE = 16
SEEDS = (0, 1, 2)
NODE = {"name": "tactile_vit"}


def task(scenes: int) -> Task:
    data = {"name": "sim", "scenes": scenes, "val": max(2, scenes // 4), "sensors": ["digit"]}
    return parse_task(
        "force",
        {
            "title": "Force",
            "data": data | {"indenters": "bench", "size": 224},
            "target": "force",
            "probe": {"name": "force", "batch": BATCH, "lr": RATE},
            "metrics": ["rmse_sum_axes"],
            "split": {"train": {"side": "train"}, "test": {"side": "val"}},
        },
    )


class PublishedHead(nn.Module):
    """The published head, with its products in the published order."""

    def __init__(self, like: nn.Module) -> None:
        super().__init__()
        width = 768
        self.pooler = AttentivePooler(width, 1, 16)
        self.probe = nn.Sequential(nn.Linear(width, 192), nn.ReLU(), nn.Linear(192, 3))
        with torch.no_grad():
            for own, other in zip(self.parameters(), like.parameters(), strict=True):
                own.copy_(other)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, L, 768) to (B, 3)."""
        out: Tensor = self.probe(self.pooler(tokens))[:, 0]
        return out


class Published:
    """Published training of a probe: the encoder runs on every clip in every epoch."""

    def __init__(
        self, prepared: PreparedTask, subject: FrozenEncoder, store: FeatureStore, seed: int
    ) -> None:
        self.subject, self.store = subject, store
        ((self.clips, _),) = readers(subject, prepared.source, prepared.target.clips)
        part = prepared.target.parts["force"]
        self.truth, self.scale = part.normalised, part.scale
        torch.manual_seed(seed)
        self.head = PublishedHead(choose_probe(prepared.task, {}).build(768, prepared.target))
        self.optimiser = torch.optim.AdamW(
            self.head.parameters(), RATE, betas=(0.9, 0.99), weight_decay=0.05
        )

    def _tokens(self, places: Any) -> Iterator[tuple[Any, Tensor]]:
        for number, batch in enumerate(read_batches(self.clips, places, self.store, BATCH)):
            some = places[number * BATCH : (number + 1) * BATCH]
            yield some, self.subject.features(batch, PLAIN, "error")["tokens"].clone()

    def train(self, places: Any) -> None:
        """Trains for one epoch."""
        for some, tokens in self._tokens(places):
            loss = F.smooth_l1_loss(self.head(tokens), self.truth[some], beta=0.02)
            self.optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            self.optimiser.step()

    @torch.no_grad()
    def rmse(self, places: Any) -> float:
        """Root mean squared error, summed over the axes, mN."""
        out = torch.cat([self.head(tokens) for _, tokens in self._tokens(places)])
        error = (out - self.truth[places]) * self.scale[places]
        return float((error**2).mean(0).sqrt().sum() * 1000)


def prepare(clips: int) -> PreparedTask:
    one = task(max(4, clips // 8))
    source: TaskSource = open_source(one.data, one.sides, one.clip)
    target = targets.build_target(one, source)
    (split,) = splits.build_splits(one, source, target)
    few = splits.Split(
        split.train[:clips], split.validation[: clips // 4], split.test[: clips // 2]
    )
    return PreparedTask(one, source, target, [few])


def seconds(function: Any) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def as_published(
    prepared: PreparedTask, subject: FrozenEncoder, store: FeatureStore, epochs: int
) -> dict[str, Any]:
    (split,) = prepared.splits
    errors, times = [], {"train": 0.0, "test": 0.0}
    for seed in SEEDS:
        one = Published(prepared, subject, store, seed)
        for _ in range(epochs):
            times["train"] += seconds(lambda: one.train(split.train))  # noqa: B023
            times["test"] += seconds(lambda: errors.append(one.rmse(split.test)))  # noqa: B023
        # One error per seed: that of the last epoch.
        errors = [*errors[: SEEDS.index(seed)], errors[-1]]
    passes = epochs * len(SEEDS)
    train = times["train"] / passes / len(split.train)
    test = times["test"] / passes / len(split.test)
    return {
        "s_per_training_clip": train,
        "s_per_test_clip": test,
        "s_for_one_probe": EPOCHS * (CLIPS * train + CLIPS / 4 * test),
        "rmse_sum_axes": mean_interval(errors),
    }


def ours(
    prepared: PreparedTask, subject: FrozenEncoder, store: FeatureStore, epochs: int
) -> dict[str, Any]:
    (split,) = prepared.splits
    clips = np.sort(
        prepared.target.clips[np.concatenate([split.train, split.validation, split.test])]
    )
    found: dict[str, Any] = {}

    def extract() -> None:
        found["x"] = extract_features(store, subject, prepared.source, clips, ["tokens"])

    extraction = seconds(extract) / len(clips)
    kept = SourceFeatures(clips, found["x"])
    done: list[Any] = []
    # The metric of the last epoch, without selection, as for the published way.
    choice = choose_probe(prepared.task, {"epochs": epochs})

    def train(seeds: Any) -> None:
        done[:] = evaluate_probe(prepared, choice, subject, kept, store, seeds, select_on_test=True)

    alone = seconds(lambda: train(SEEDS[:1])) / epochs / len(split.train)
    together = seconds(lambda: train(SEEDS)) / epochs / len(split.train)
    values = [one.metrics["rmse_sum_axes"] for one in done]
    count = CLIPS * 1.25
    return {
        "s_per_clip_extracted": extraction,
        "s_per_clip_and_epoch": alone,
        "s_per_clip_and_epoch_of_three_probes": together,
        "s_for_one_probe": count * extraction + EPOCHS * CLIPS * alone,
        "s_for_three_probes": count * extraction + EPOCHS * CLIPS * together,
        "rmse_sum_axes": mean_interval(values),
    }


def extraction_speed(
    prepared: PreparedTask, subject: FrozenEncoder, folder: Path
) -> dict[str, Any]:
    """Times of reading, encoding and storing clips, against encoding clips from memory."""
    clips = prepared.target.clips[: 4 * ENCODE]
    ((reader, _),) = readers(subject, prepared.source, clips)
    store = FeatureStore(folder, workers=2, batch=ENCODE)
    batches = list(read_batches(reader, range(len(clips)), FeatureStore(folder, workers=0), ENCODE))
    number = iter(range(1000))

    def whole() -> None:
        fresh = FeatureStore(folder / str(next(number)), store.workers, store.batch)
        extract_features(fresh, subject, prepared.source, clips, ["tokens"])

    def bare() -> None:
        for batch in batches:
            subject.features(batch, PLAIN, "error")

    times = side_by_side({"extraction": whole, "encoder": bare}, rounds=3)
    ratio = times["encoder"]["median_s"] / times["extraction"]["median_s"]
    return times | {"extraction_over_encoder": round(ratio, 3)}


def plain(found: dict[str, Any]) -> dict[str, Any]:
    return {
        key: {"mean": value.mean, "half_of_95_%": value.half, "values": list(value.values)}
        if isinstance(value, Interval)
        else value
        for key, value in found.items()
    }


def main(clips: int = 64, epochs: int = 2) -> None:
    torch.manual_seed(0)
    encoder = TactileViT("base")
    header = make_header(encoder, NODE, licence="", spacing=1 / 15, recipe={"encoder": NODE})
    subject = FrozenEncoder("base", encoder, header)
    prepared = prepare(clips)
    with tempfile.TemporaryDirectory() as place:
        store = FeatureStore(Path(place) / "kept", workers=2, batch=ENCODE)
        speed = extraction_speed(prepared, subject, Path(place) / "speed")
        mine = ours(prepared, subject, store, epochs)
        theirs = as_published(prepared, subject, store, epochs)
    a, b = mine["rmse_sum_axes"], theirs["rmse_sum_axes"]
    wide = math.hypot(a.half, b.half)
    save(
        "probe",
        {
            "what": f"force probe, {EPOCHS} epochs, {CLIPS} training and {CLIPS // 4} test clips",
            "how": f"measured on {clips} clips and {epochs} epochs, and counted for the whole; "
            "the weights of the encoder are random",
            "published": plain(theirs),
            "ours": plain(mine),
            "times_as_fast": round(theirs["s_for_one_probe"] / mine["s_for_one_probe"], 1),
            "times_as_fast_three_probes": round(
                3 * theirs["s_for_one_probe"] / mine["s_for_three_probes"], 1
            ),
            "same_rmse_within_interval": abs(a.mean - b.mean) <= wide,
            "speed_of_extraction": speed,
        },
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
