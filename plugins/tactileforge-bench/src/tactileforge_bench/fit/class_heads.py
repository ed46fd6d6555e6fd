"""Heads of classes, kept for `Model.classify`."""

from __future__ import annotations

from pathlib import Path

from tactileforge.hub import CLASS_FORMAT, ClassFacts, ClassHead, encoder_hash, uses_background
from tactileforge_bench.fit.baselines import BASELINES
from tactileforge_bench.fit.evaluate import ProbeResult
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.resolve import PreparedTask
from tactileforge_bench.results.write import file_name


def keep_class_head(
    folder: Path, prepared: PreparedTask, subject: FrozenEncoder, result: ProbeResult
) -> Path | None:
    """Writes the linear layer of a task of classes as ``heads/TASK.MODEL.safetensors``.

    It was fitted to all clips of the task; its metrics are of clips that were left out.

    Args:
        folder: Folder of the benchmark.
        prepared: The task.
        subject: The encoder.
        result: Result of the probe, with its layer.

    Returns:
        The file; None where the task has no classes, or the model is a baseline or untrained.
    """
    name, part = next(iter(prepared.target.parts.items()))
    no_model = subject.name.startswith("untrained:") or subject.header.encoder["name"] in BASELINES
    if result.layer is None or prepared.target.names is None or no_model:
        return None
    penalty, layers = result.layer
    layer = layers[name].float().cpu()
    facts = ClassFacts(
        format=CLASS_FORMAT,
        task=prepared.task.name,
        names=list(part.names),
        encoder=encoder_hash(subject.encoder),
        # None where the encoder takes no background at all
        background=any(recording.no_contact is not None for recording in prepared.source.recordings)
        if uses_background(subject.encoder)
        else None,
        sensors=sorted({recording.sensor for recording in prepared.source.recordings}),
        penalty=penalty,
        metrics=result.metrics,
    )
    path = folder / "heads" / f"{file_name(prepared.task.name, subject.name)}.safetensors"
    path.parent.mkdir(parents=True, exist_ok=True)
    ClassHead(facts, layer[:-1].T, layer[-1]).save(path)
    return path
