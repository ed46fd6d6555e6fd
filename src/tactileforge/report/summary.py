"""The top of the page: facts and verdict of the run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tactileforge.checks import catalogue
from tactileforge.contracts import AXES
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.pages import page
from tactileforge.pages.curves import Curve
from tactileforge.pages.page import NONE, SPLIT_WORDS, duration, number, percent, table
from tactileforge.report.axes import AxisScore
from tactileforge.report.embedding import NeighbourScore
from tactileforge.report.findings import RunFindings
from tactileforge.report.forces import OWN, ForceResult, newtons
from tactileforge.report.speed import speed_fact, speed_verdict
from tactileforge.training.labels import Labels
from tactileforge.training.module import TouchModule

#: Smallest relative change of a loss to count as a change.
_LEAST = 0.01
#: Share of explained variance above which a reconstruction counts as learnt.
_LEARNT = 0.05
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


def run_facts(
    folder: Path,
    config: Mapping[str, Any],
    module: TouchModule,
    data: TouchData,
    steps: int,
    seconds: float | None,
    curves: Mapping[str, Curve],
    kept: Mapping[str, Any],
) -> Markup:
    """Facts of the run: name, date, seed and data first; ``kept`` is its ``versions.json``."""
    encoder = config["encoder"]
    name = " ".join(filter(None, (encoder["name"], encoder.get("size"))))
    size = sum(parameter.numel() for parameter in module.encoder.parameters()) / 1e6
    height, width = module.encoder.image_size
    clips = sum(track.size for track in data.stream().tracks)
    held_out = len(data.val) if data.val else 0
    versions = kept.get("versions", {})
    precision = [config["trainer"]["precision"], kept.get("precision")]
    root = config["data"].get("root")
    about = {
        "Run": folder.absolute().name,
        "Date": str(kept.get("date", "")),
        "Seed": str(config["seed"]),
        "Data": f"{config['data']['name']}, {Path(root).name}" if root else config["data"]["name"],
        "Encoder": f"{name}, {size:.3g} M parameters",
        "Input": f"{module.encoder.frames} frames, {height} x {width} pixels",
        "Clips": f"{clips:.0f} training, {held_out} validation",
        "Sensors": ", ".join(data.summary("train").sensors),
        "Steps": f"{steps}, each of {config['batch']['size']} clips",
        "Time": "not kept" if seconds is None else duration(seconds),
        "Speed": speed_fact(curves),
        "Precision": ": ".join(str(part) for part in precision if part),
        "Versions": ", ".join(
            f"{k} {versions[k]}" for k in ("tactileforge", "torch") if k in versions
        ),
    }
    return page.facts(about)


def checks_table(found: Sequence[str]) -> Markup:
    """Findings of the checks of the data: code, what was found and the fix; none without any.

    Args:
        found: Lines ``CODE what; fix``, as `TouchData.findings`; a line without a fix gets that of
            the check.
    """
    if not found:
        return Markup()
    fixes = {check.code: check.fix for check in catalogue().values()}
    rows = []
    for line in found:
        code, _, text = line.partition(" ")
        what, fix = _outside(text)
        rows.append((code, f"text|{what}", f"text|{fix or fixes.get(code, '')}"))
    head = ("Check", "text|what was found in the data", "text|what puts it right")
    note = "The checks of the data, before training; tactileforge data check names each recording."
    return table("checks", head, rows, note)


def _outside(text: str) -> tuple[str, str]:
    """Parts a line at its first ``; `` outside of parentheses."""
    place = next(
        (
            found.start()
            for found in re.finditer("; ", text)
            if text.count("(", 0, found.start()) <= text.count(")", 0, found.start())
        ),
        len(text),
    )
    return text[:place], text[place + 2 :]


def run_verdict(
    curves: Mapping[str, Curve],
    weights: Mapping[str, float],
    findings: RunFindings | None,
    labels: Labels,
    held_out: bool,
    skipped: Sequence[str],
) -> Markup:
    """A few sentences on the run, each marked as good, bad or plain, and a table of the losses."""
    lines = [_fell(curves, weights, "train")]
    if held_out:
        lines.append(_fell(curves, weights, "val"))
    else:
        lines.append(("plain", "No validation: the data holds nothing out."))
    lines += [
        ("bad", f"{line[0].upper()}{line[1:]}.")
        for key in weights
        if (line := labels.missing(key, has_ended=True))
    ]
    if findings is not None:
        lines += _rebuilt(findings.explained)
        lines += [line for result in findings.forces for line in _force(result)]
        lines += [(_mark([x.accuracy > x.guess]), f"{x.line}.") for x in findings.classes]
        lines += _read(findings.scores)
    lines += speed_verdict(curves)
    count = len(skipped)
    lines.append(
        ("bad", f"{count} recording{'s' * (count > 1)} could not be read; see Data.")
        if count
        else ("good", "No recording was skipped.")
    )
    rows = [_row(key, weight, curves) for key, weight in weights.items()]
    note = (
        "First and last: means of the first and the last tenth of the logged values (of one value "
        "where fewer than 20 were logged)."
    )
    return page.verdict(lines) + table("losses-summary", _HEAD, rows, note)


def ends(curve: Curve) -> tuple[float, float]:
    """First and last value of a loss: means of the first and the last tenth of its values."""
    count = max(1, len(curve.values) // 10)
    return float(curve.values[:count].mean()), float(curve.values[-count:].mean())


def _fell(curves: Mapping[str, Curve], weights: Mapping[str, float], split: str) -> tuple[str, str]:
    name = SPLIT_WORDS[split].capitalize()
    known = {key: curves[f"{split}/{key}"] for key in weights if f"{split}/{key}" in curves}
    compared = {key: ends(curve) for key, curve in known.items() if len(curve.values) > 1}
    if not compared:
        return "plain", f"{name} loss was logged less than twice: nothing to compare."
    stuck = [
        key for key, (first, last) in compared.items() if not first - last > _LEAST * abs(first)
    ]
    text = f"{name} loss fell by more than {percent(_LEAST)} for {len(compared) - len(stuck)} of "
    text += f"{len(compared)} objectives{f' (not {_and(stuck)})' if stuck else ''}"
    left = [key for key in weights if key not in compared]
    text += f"; {_and(left)} logged less than twice" if left else ""
    return "bad" if stuck else "good", f"{text}."


def _rebuilt(explained: Mapping[str, float]) -> list[tuple[str, str]]:
    if not explained:
        return []
    shares = _and([f"{percent(share)} of {kind}" for kind, share in explained.items()])
    mark = _mark([share > _LEARNT for share in explained.values()])
    text = f"Reconstruction explains this share of the variance of hidden pixels: {shares}."
    return [(mark, text)]


def _read(scores: Mapping[str, NeighbourScore | None]) -> list[tuple[str, str]]:
    known = {kind: score for kind, score in scores.items() if score}
    if not known:
        return []
    words = _and(
        [f"{k} {percent(s.accuracy)} (chance {percent(s.chance)})" for k, s in known.items()]
    )
    mark = _mark([score.accuracy > 1.5 * score.chance for score in known.values()])
    return [(mark, f"Nearest neighbours in the embedding tell {words}.")]


def _mark(learnt: Sequence[bool]) -> str:
    return "good" if all(learnt) else "plain" if any(learnt) else "bad"


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _force(result: ForceResult) -> list[tuple[str, str]]:
    if not result.readings:
        return []
    scores = _axes(result)
    better = [axis for axis, score in scores.items() if score.mae < score.median]
    text = f"{_errors(result)}. Better than it along {_and(better) or 'no axis'}."
    if collapsed := [axis for axis, score in scores.items() if score.collapsed]:
        text += f" Predictions hardly vary along {_and(collapsed)}: it has collapsed."
    is_good = len(better) == len(scores) and not collapsed
    mark = "good" if is_good else "plain" if better else "bad"
    return [(mark, text), *(("plain", f"{line}.") for line in _by_source(result))]


def _by_source(result: ForceResult) -> list[str]:
    """Errors of each source, where a mixture has several, as own and simulated forces."""
    sources = sorted(set(result.origins[next(iter(result.readings))]))
    return [_errors(result, source) for source in sources] if len(result.sources) > 1 else []


def _axes(result: ForceResult, source: str | None = None) -> dict[str, AxisScore]:
    """Scores of the axes with labels, of validation, if there is any."""
    every = zip(AXES, result.scores(next(iter(result.readings)), source), strict=True)
    return {axis: score for axis, score in every if score.mae == score.mae}


def _errors(result: ForceResult, source: str | None = None) -> str:
    """Errors of each axis beside those of the median guess, of all clips or of one source."""
    split = next(iter(result.readings))
    origins, scores = result.origins[split], _axes(result, source)
    count = len(origins) if source is None else origins.count(source)
    of = "" if source is None else f" of {source or OWN}"
    errors = ", ".join(f"{axis} {newtons(score.mae)}" for axis, score in scores.items())
    guesses = ", ".join(f"{axis} {newtons(score.median)}" for axis, score in scores.items())
    return (
        f"Force error on {count} {SPLIT_WORDS[split]} clips{of}: {errors} N; always "
        f"guessing the median: {guesses} N"
    )


def result_lines(
    findings: RunFindings | None, curves: Mapping[str, Curve], weights: Mapping[str, float]
) -> list[str]:
    """The result of a run in a few lines for the terminal.

    Force errors beside those of the median guess, classes that are named right, and what is
    explained of hidden pixels; without any, how the losses went.
    """
    lines = []
    if findings is not None:
        for result in findings.forces:
            lines += [_errors(result), *_by_source(result)] if result.readings else []
        lines += [result.line for result in findings.classes]
        lines += [text.removesuffix(".") for _, text in _rebuilt(findings.explained)]
    if lines:
        return lines
    splits = ("val", "train")
    known = next(
        (split for split in splits if any(f"{split}/{key}" in curves for key in weights)), None
    )
    return [] if known is None else [_fell(curves, weights, known)[1].removesuffix(".")]


def _row(key: str, weight: float, curves: Mapping[str, Curve]) -> list[str]:
    row = [key]
    for split in ("train", "val"):
        curve = curves.get(f"{split}/{key}")
        if curve is None:
            row += [NONE, NONE, NONE]
            continue
        first, last = ends(curve)
        change = NONE
        if len(curve.values) > 1 and first:  # 0 has no relative change
            share = (last - first) / abs(first)
            mark = "" if abs(share) < _LEAST else "good|" if share < 0 else "bad|"
            change = f"{mark}{percent(share, signed=True)}"
        row += [number(first), number(last), change]
    return [*row, number(weight)]
