"""Drawn sections of the bench's page: forces, confusions, losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from tactileforge.errors import DataError
from tactileforge.pages import (
    NONE,
    Curve,
    Section,
    card,
    cards,
    curve_figure,
    details,
    heading,
    image,
    joined,
    legend,
    panel,
    panels,
    paragraph,
    percent,
    table,
)
from tactileforge_bench.output.charts import NAMED, POINTS, confusion, scatter
from tactileforge_bench.results.predictions import (
    Predictions,
    most_certain_wrong,
    read_predictions,
)
from tactileforge_bench.results.results import LossCurve, Results, ResultTask
from tactileforge_bench.results.scores import Scores, main_score, titles

#: Points of a loss curve that are drawn.
_CURVE = 200
#: Wrong clips that are listed; all are in predictions/*.csv.
_ROWS = 100


def draw_figures(folder: Path, results: Results, scores: Scores) -> list[Section]:
    """Scatter of forces, confusion matrices, and loss curves; only what there is."""
    scatters, confusions = Markup(), Markup()
    for task in results.tasks:
        readings, trouble = _read(folder, results, scores, task)
        values = {name: one for name, one in readings.items() if not one.names}
        classes = {name: one for name, one in readings.items() if one.names}
        if values:
            # the first is open, the others are a click away
            scatters += details(task.title, _scatters(task, values) + trouble, is_open=not scatters)
        if classes or (trouble and not values):
            confusions += details(
                task.title, _confusions(classes) + trouble, is_open=not confusions
            )
    parts = []
    if scatters:
        words = (
            "Each point is of the test set; on the dashed line the prediction is right. "
            f"At most {POINTS} points are drawn, spread evenly; RMSE and r are of all. All models "
            "have the same axes, those of the true values: what is predicted beyond them lies on "
            "the edge. Of several seeds the first is shown."
        )
        parts.append(Section("values", "Predicted and true", paragraph(words) + scatters))
    if confusions:
        words = (
            "Each row is a true class: the shares of its clips, in percent, that are predicted as "
            "each class. Of several seeds the first is shown."
        )
        body = paragraph(words) + confusions
        parts.append(Section("confusions", "Classes", body))
    if losses := _trainings(results) + _probes(results, scores):
        parts.append(Section("losses", "Losses", legend({0: "training", 1: "validation"}) + losses))
    return parts


def _read(
    folder: Path, results: Results, scores: Scores, task: ResultTask
) -> tuple[dict[str, Predictions], Markup]:
    """Predictions of one task by title of the model, and text on the missing ones."""
    names, readings, trouble = titles(results), {}, []
    for model in results.models:
        score = main_score(scores, task, model)
        if score is None or not score.cells[0].predictions:
            continue
        try:
            one = read_predictions(folder / score.cells[0].predictions)
        except DataError as error:
            trouble.append(f"{names[model.name]}: no picture. {error}")
            continue
        readings[names[model.name]] = one
    return readings, joined(paragraph(words, soft=True) for words in trouble)


def _scatters(task: ResultTask, values: Mapping[str, Predictions]) -> Markup:
    """A row of panels for each model, one for each axis."""
    limits = _limits(list(values.values()))
    usual = "N" if any(metric.unit == "mN" for metric in task.metrics) else ""
    body = Markup()
    for name, one in values.items():
        drawings = []
        for i, axis in enumerate(one.columns):
            truth, predicted = one.truth[:, i], one.predicted[:, i]
            # a picture has the finite ones, and words below it how many there are beside them
            finite = np.isfinite(truth) & np.isfinite(predicted)
            if not finite.any():
                drawings.append(panel(axis, "", "no prediction is a finite number"))
                continue
            drawing = scatter(
                truth[finite], predicted[finite], axis, limits[axis], one.unit or usual
            )
            lost = int((~finite).sum())
            below = f"{lost} of {len(finite)} predictions are no finite number" if lost else ""
            drawings.append(panel(axis, drawing, below))
        body += heading(name) + panels(drawings)
    return body


def _limits(readings: Sequence[Predictions]) -> dict[str, tuple[float, float]]:
    """One range for each axis, with all true values and room around them."""
    limits: dict[str, tuple[float, float]] = {}
    for axis in dict.fromkeys(axis for one in readings for axis in one.columns):
        # of true values alone: one wild prediction would push all points into a corner
        parts = [one.truth[:, one.columns.index(axis)] for one in readings if axis in one.columns]
        truth = np.concatenate(parts)
        truth = truth[np.isfinite(truth)]
        low, high = (float(truth.min()), float(truth.max())) if len(truth) else (0.0, 1.0)
        # so that the outermost points do not lie on the frame; a little where all values are equal
        room = max(0.12 * (high - low), 0.01)
        limits[axis] = (low - room, high + room)
    return limits


def _confusions(classes: Mapping[str, Predictions]) -> Markup:
    drawings = []
    widest = 0
    for name, one in classes.items():
        for i in range(one.truth.shape[1]):
            title = f"{name}, {one.columns[i]}" if one.truth.shape[1] > 1 else name
            drawing, counts = confusion(one.truth[:, i], one.predicted[:, i], one.names)
            share = counts.trace() / counts.sum()
            below = f"{counts.trace()} of {counts.sum()} right, {100 * share:.1f} %"
            drawings.append(panel(title, drawing, below))
            widest = max(widest, len(counts))
    words = f"{widest} classes: their names are left out." if widest > NAMED else ""
    note = paragraph(words, soft=True) if words else Markup()
    return panels(drawings, wide=widest > 8) + note + joined(map(_wrong, classes, classes.values()))


def _wrong(name: str, one: Predictions) -> Markup:
    """The wrong clips of a model, the most certain first: its picture, both names, confidence."""
    if not one.clips or one.truth.shape[1] > 1:
        return Markup()
    truth, said = one.truth[:, 0], one.predicted[:, 0]
    wrong = most_certain_wrong(truth, said, one.probability)
    if not len(wrong):
        return Markup()
    shares = one.probability
    sure = {i: "" if shares is None else percent(shares[i, said[i]]) for i in wrong.tolist()}
    # a model that is mostly wrong says nothing about labels
    look = ": those at the top may be labelled wrongly, so look at them"
    body = paragraph(
        f"The most certain ones first{look * (2 * len(wrong) < len(truth))}. What trained the "
        "probe is not tested: of suite=classes, classes.folds=5 tests each image."
    )
    if one.pictures is not None:
        body += cards(
            card(
                one.clips[place],
                image(picture, f"taken for {one.names[said[place]]}"),
                f"labelled {one.names[truth[place]]}, taken for {one.names[said[place]]}"
                f"{', ' * bool(sure[place])}{sure[place]}",
            )
            for place, picture in zip(one.wrong, one.pictures, strict=True)
        )
    rows = [
        (one.clips[i], f"text|{one.names[truth[i]]}", f"text|{one.names[said[i]]}", sure[i] or NONE)
        for i in wrong.tolist()[:_ROWS]
    ]
    head = ("Clip", "text|label", "text|taken for", "confidence")
    caption = f"{len(rows)} of {len(wrong)}" if len(rows) < len(wrong) else ""
    body += table(f"wrong-{name}", head, rows, caption)
    return details(f"{name}: {len(wrong)} of {len(truth)} wrong", body)


def _trainings(results: Results) -> Markup:
    names = titles(results)
    by_model: dict[str, list[LossCurve]] = {}
    for one in results.training:
        by_model.setdefault(one.model, []).append(one)
    if not by_model:
        return Markup()
    body = paragraph(
        "In pre-training, of the models that were trained for this bench; a panel an objective."
    )
    for i, (model, some) in enumerate(by_model.items()):
        drawings = panels(_loss(one.objective, one.step, one.train, one.validation) for one in some)
        body += details(names[model], drawings, is_open=i == 0)
    return body


def _probes(results: Results, scores: Scores) -> Markup:
    names, body = titles(results), Markup()
    for task in results.tasks:
        drawings = []
        for model in results.models:
            score = main_score(scores, task, model)
            curve = score.cells[0].curve if score else {}
            if train := curve.get("train", []):
                epochs = list(range(1, len(train) + 1))
                drawings.append(
                    _loss(names[model.name], epochs, train, curve.get("validation", []), "epoch")
                )
        if drawings:
            body += details(task.title, panels(drawings), is_open=False)
    words = "Of the probes, by epoch; of several seeds the first is shown."
    return paragraph(words) + body if body else body


def _loss(
    title: str,
    steps: Sequence[float],
    train: Sequence[float],
    validation: Sequence[float],
    unit: str = "step",
) -> Markup:
    first, second = _curve(steps, train), _curve(steps, validation)
    if first is None and second is None:
        return panel(title, "", "no loss is a finite number")
    return panel(title, curve_figure("loss", int(max(steps)), first, second, unit=unit))


def _curve(steps: Sequence[float], values: Sequence[float]) -> Curve | None:
    """The finite values; None where there are none."""
    kept = [(step, value) for step, value in zip(steps, values, strict=False) if np.isfinite(value)]
    if not kept:
        return None
    x, y = zip(*kept, strict=True)
    return Curve(np.array(x, np.int64), np.array(y, np.float64)).thinned(_CURVE)
