"""The top of the page: did the run go well?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from tactileforge.data.datamodule import TouchData
from tactileforge.module import TouchModule
from tactileforge.report.embedding import Score
from tactileforge.report.forces import AXES, ForceResult, milli
from tactileforge.report.metrics import Curve
from tactileforge.report.page import NONE, duration, number, percent, table

_HEAD = (
    "Objective",
    "training: first",
    "last",
    "change",
    "validation: first",
    "last",
    "change",
    "largest weight",
)


def top(
    config: Mapping[str, Any],
    module: TouchModule,
    data: TouchData,
    steps: int,
    seconds: float | None,
    versions: Mapping[str, str],
) -> str:
    """What was trained, on what, for how long."""
    encoder = config["encoder"]
    size = sum(parameter.numel() for parameter in module.encoder.parameters()) / 1e6
    height, width = module.encoder.image_size
    assert data.train is not None
    held_out = len(data.val) if data.val else 0
    facts = {
        "Encoder": f"{encoder['name']} {encoder.get('size', '')}, {size:.3g} M parameters",
        "Input": f"{module.encoder.frames} frames, {height} x {width} pixels",
        "Data": config["data"]["name"],
        "Clips": f"{len(data.train)} training, {held_out} validation",
        "Sensors": ", ".join(data.train.sensors),
        "Steps": f"{steps}, each of {config['batch']['size']} clips",
        "Time": "not kept" if seconds is None else duration(seconds),
        "Versions": ", ".join(
            f"{name} {versions[name]}" for name in ("tactileforge", "torch") if name in versions
        )
        or "not kept",
    }
    cells = (f"<div><dt>{k}</dt><dd>{escape(v.strip())}</dd></div>" for k, v in facts.items())
    return f"<dl>{''.join(cells)}</dl>"


def verdict(
    curves: Mapping[str, Curve],
    weights: Mapping[str, float],
    forces: Sequence[ForceResult],
    scores: Mapping[str, Score | None],
    skipped: Sequence[str],
) -> str:
    """The run in a few sentences, each marked as good, bad or plain; then the losses as a table."""
    lines = [_fell(curves, weights, split) for split in ("train", "val")]
    lines += [line for result in forces for line in _force(result)]
    read = [
        f"{kind} {percent(score.accuracy)} (chance {percent(score.chance)})"
        for kind, score in scores.items()
        if score
    ]
    if read:
        better = all(score.accuracy > score.chance for score in scores.values() if score)
        lines.append(("good" if better else "bad", f"Nearest neighbours read {', '.join(read)}."))
    count = len(skipped)
    lines.append(
        ("bad", f"{count} recording{'s' * (count > 1)} could not be read; see Data.")
        if skipped
        else ("good", "No recording was skipped.")
    )
    items = "".join(f'<li class="{kind}">{escape(text)}</li>' for kind, text in lines)
    rows = [_row(key, weight, curves) for key, weight in weights.items()]
    note = (
        "First and last: means of the first and the last tenth of the logged values (of one value "
        "where fewer than 20 were logged)."
    )
    return f'<ul class="verdict">{items}</ul>' + table("losses-summary", _HEAD, rows, note)


def ends(curve: Curve) -> tuple[float, float]:
    """How a loss began and ended: means of the first and the last tenth of its values."""
    count = max(1, len(curve.values) // 10)
    return float(curve.values[:count].mean()), float(curve.values[-count:].mean())


def _fell(curves: Mapping[str, Curve], weights: Mapping[str, float], split: str) -> tuple[str, str]:
    name = {"train": "Training", "val": "Validation"}[split]
    known = {key: curves[f"{split}/{key}"] for key in weights if f"{split}/{key}" in curves}
    compared = {key: ends(curve) for key, curve in known.items() if len(curve.values) > 1}
    if not compared:
        return "plain", f"{name} loss was logged less than twice: nothing to compare."
    risen = [key for key, (first, last) in compared.items() if not last < first]
    text = f"{name} loss fell for {len(compared) - len(risen)} of {len(compared)} objectives"
    text += f" (not {', '.join(risen)})" if risen else ""
    left = [key for key in weights if key not in compared]
    text += f"; logged less than twice: {', '.join(left)}" if left else ""
    return "bad" if risen else "good", f"{text}."


def _force(result: ForceResult) -> list[tuple[str, str]]:
    for split, reading in result.readings.items():
        scores = dict(zip(AXES, result.scores(split), strict=True))
        errors = ", ".join(f"{axis} {milli(score.mae)}" for axis, score in scores.items())
        guesses = ", ".join(f"{axis} {milli(score.median)}" for axis, score in scores.items())
        better = [axis for axis, score in scores.items() if score.mae < score.median]
        where = {"val": "validation", "train": "training"}[split]
        text = (
            f"Force error on {len(reading.clips)} {where} clips: {errors} mN; always guessing the "
            f"median: {guesses} mN. Better than the guess along {', '.join(better) or 'no axis'}."
        )
        return [("good" if len(better) == 3 else "plain" if better else "bad", text)]
    return []


def _row(key: str, weight: float, curves: Mapping[str, Curve]) -> list[str]:
    row = [key]
    for split in ("train", "val"):
        curve = curves.get(f"{split}/{key}")
        if curve is None:
            row += [NONE, NONE, NONE]
            continue
        first, last = ends(curve)
        change = NONE
        if len(curve.values) > 1 and first:
            share = (last - first) / abs(first)
            change = f"{'good' if last < first else 'bad'}|{percent(share, signed=True)}"
        row += [number(first), number(last), change]
    return [*row, number(weight)]
