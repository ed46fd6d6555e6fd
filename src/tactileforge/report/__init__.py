"""The report of a run: one HTML file that tells in a minute whether the run went well."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tactileforge import checkpoints
from tactileforge.data.datamodule import TouchData
from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.heads.decoder import Reconstruction
from tactileforge.module import TouchModule
from tactileforge.report import embedding, forces, sections, summary
from tactileforge.report.metrics import Curve, read_metrics
from tactileforge.report.page import Section, page
from tactileforge.report.pictures import strips_of
from tactileforge.report.samples import liveliest, look, predictions, spread

#: Clips of a split that are embedded, and clips that are shown.
_CLIPS = 200
_SHOWN = 6


def report_of_run(folder: Path) -> Path:
    """Writes the report of a run again, from what the run left in its folder.

    Args:
        folder: Folder of the run, with ``config.yaml`` and ``checkpoints/last.ckpt``. The data that
            it was trained on must still be where it was.

    Returns:
        The report.

    Raises:
        DataNotFoundError: The folder is not that of a run, or the data is gone.
        ConfigError: The checkpoint does not fit the configuration.
    """
    from tactileforge.train import build_data

    config = _config(folder)
    state = checkpoints.read(folder)
    data = build_data(config)
    module = TouchModule.from_config(config, data.train.has() if data.train else set())
    try:
        module.load_state_dict(state["state_dict"])
    except RuntimeError as error:
        raise ConfigError(f"{folder}: the checkpoint does not fit config.yaml: {error}") from error
    module.on_load_checkpoint(state)
    return write_report(folder, module, data)


def write_report(folder: Path, module: TouchModule, data: TouchData) -> Path:
    """Writes ``report.html`` of a run that has ended.

    The report depends on the weights, the data and the files of the run alone: written twice, it is
    the same. It uses up no random numbers, and leaves the module as it was.

    Args:
        folder: Folder of the run.
        module: Trained.
        data: Set up.

    Returns:
        The report.
    """
    config = _config(folder)
    curves = read_metrics(folder)
    steps, seconds = _progress(folder, curves)
    head, parts = _contents(folder, config, module, data, curves, steps)
    path = folder / "versions.json"
    versions = json.loads(path.read_text())["versions"] if path.is_file() else {}
    facts = summary.top(config, module, data, steps, seconds, versions)
    title = f"Touch encoder, trained with {', '.join(config['objective'])}"
    html = page(title, facts + head, parts)
    report = folder / "report.html"
    part = report.with_name("report.html.part")
    part.write_text(html, encoding="utf-8")
    part.replace(report)
    return report


def _contents(
    folder: Path,
    config: Mapping[str, Any],
    module: TouchModule,
    data: TouchData,
    curves: Mapping[str, Curve],
    steps: int,
) -> tuple[str, list[Section]]:
    """The verdict, and the sections."""
    splits = {"val": data.val, "train": data.train}
    skipped = dict.fromkeys([*data.skipped, *module.skipped])
    looks = {
        split: look(module, clips, spread(clips, _CLIPS), skipped)
        for split, clips in splits.items()
        if clips is not None
    }
    split = next(iter(looks))
    clips = splits[split]
    assert clips is not None
    shown = liveliest(clips, looks[split], _SHOWN)
    patches, predicted = predictions(module, clips, shown)
    rebuilt = [value for value in predicted.values() if isinstance(value, Reconstruction)]
    strips = [strips_of(module.encoder, patches, rebuilt, row) for row in range(len(shown))]
    results = forces.force_results(module, data, predicted)
    embedded = embedding.embedding_of(data, looks)
    scores = {kind: embedding.neighbours(embedded, kind) for kind in embedded.labels}
    name = {"val": "validation", "train": "training"}[split]
    weights = {key: float(node["weight"]) for key, node in config["objective"].items()}
    parts = [
        sections.losses(curves, list(weights), steps),
        sections.frames(clips, shown, strips, name),
        forces.section(results, data),
        embedding.section(embedded, scores),
        sections.data_section(data, list(skipped)),
        sections.recipe(folder),
    ]
    return summary.verdict(curves, weights, results, scores, list(skipped)), parts


def _config(folder: Path) -> dict[str, Any]:
    path = folder / "config.yaml"
    if not path.is_file():
        raise DataNotFoundError(f"{folder}: no config.yaml there; give the folder of a run")
    config: dict[str, Any] = OmegaConf.to_container(OmegaConf.load(path))  # type: ignore[assignment]
    return config


def _progress(folder: Path, curves: Mapping[str, Curve]) -> tuple[int, float | None]:
    """Steps done, and seconds of training over all of a run's processes where they were kept."""
    if not (folder / checkpoints.LAST).is_file():
        return max((int(curve.steps[-1]) + 1 for curve in curves.values()), default=0), None
    state = checkpoints.read(folder)
    timer = state.get("callbacks", {}).get("Timer", {})
    seconds = timer.get("time_elapsed", {}).get("train")
    return int(state["global_step"]), seconds
