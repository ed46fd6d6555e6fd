"""The sections on losses, frames, data and recipe."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from tactileforge.contracts import LABELS
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.shards.summary import counted
from tactileforge.pages.curves import Curve, weighed
from tactileforge.pages.figures import SPLITS, curve_figure, lines_figure
from tactileforge.pages.images import image, strip
from tactileforge.pages.page import (
    SPLIT_WORDS,
    Section,
    card,
    details,
    duration,
    items,
    legend,
    panel,
    panels,
    paragraph,
    percent,
    preformatted,
    table,
)
from tactileforge.report.findings import RunFindings
from tactileforge.report.samples import clip_title
from tactileforge.report.strips import Strips
from tactileforge.runs import folder as run_folder

#: Explanations of the rows of a clip's images.
_ROW_NOTES = {
    "Saliency": "share of each patch in the distance of the clip's vector from that of the "
    "untouched gel (integrated gradients)",
    "Masked": "what the encoder is given; dark tubes are hidden in every frame",
    "Reconstructed": "hidden tubes as predicted, among the visible ones",
    "Difference": "to the first frame, amplified",
    "Difference, reconstructed": "the same, hidden tubes as predicted",
}
#: Largest number of frames shown of a clip.
_FRAMES = 6


def losses(curves: Mapping[str, Curve], objectives: Sequence[str], last_step: int) -> Section:
    """One panel per objective, the learning rate, and the chance of the universal token."""
    if not any(key.startswith("train/") for key in curves):
        text = (
            "No metrics were logged; lower trainer.log_every_n_steps to see curves of short runs."
        )
        return Section("losses", "Losses", paragraph(text))
    parts = []
    for key in objectives:
        logged = [curves.get(f"{kind}/{key}") for kind in ("train", "val", "weight")]
        parts.append(panel(key, curve_figure("loss", last_step, *logged, of=key), _absent(*logged)))
    # names of three words, as val/force/r2_x, are parts of a loss or tell about it
    parts_of = [
        panel(
            key,
            curve_figure(
                "value",
                last_step,
                curves.get(f"train/{key}"),
                curves.get(f"val/{key}"),
                of=key.replace("/", " "),
            ),
        )
        for key in sorted({name.partition("/")[2] for name in curves if name.count("/") == 2})
    ]
    # what is about the plan, and not about the result, comes last
    plan = [
        panel(title, curve_figure(label, last_step, curves[key]))
        for key, title, label in (
            ("lr", "learning rate", "learning rate"),
            ("universal", "chance of the universal sensor token", "chance"),
        )
        if key in curves
    ]
    val = any(key.startswith("val/") for key in curves)
    splits = {SPLITS["train"]: "training"} | ({SPLITS["val"]: "validation"} if val else {})
    body = legend(splits, area="weight of the objective, right axis") + panels(parts)
    if not val:
        body += paragraph("There is no validation loss.", soft=True)
    if parts_of:
        body += details("Parts of the losses", panels(parts_of))
    if plan:
        body += details("Learning rate and sensor tokens", panels(plan))
    return Section("losses", "Losses", body)


def _absent(train: Curve | None, val: Curve | None, weight: Curve | None) -> str:
    """Reason for a missing training loss of an objective; "" if it has one."""
    if train is not None:
        return ""
    if weight is not None and weight.values.any():
        return "no loss: it saw no label in any step whose metrics were logged"
    return "never computed: its weight was 0 whenever metrics were logged"


def balance(
    curves: Mapping[str, Curve], objectives: Sequence[str], last_step: int
) -> list[Section]:
    """Share of each objective in the encoder's gradient; empty if it was not measured."""
    norms = {key: curves[f"gradient/{key}"] for key in objectives if f"gradient/{key}" in curves}
    if not norms:
        return []
    weights = {key: curves[f"weight/{key}"] for key in norms}
    reaching = {key: weighed(norms[key], weights[key]) for key in norms}
    shares = [
        panel("norm of the gradient, not weighted", lines_figure("norm", last_step, norms)),
        panel("weight", lines_figure("weight", last_step, weights)),
        panel("weight times norm", lines_figure("norm", last_step, reaching)),
    ]
    text = "Norms of each objective's gradient on the encoder, as last measured."
    body = paragraph(text) + legend(dict(enumerate(norms))) + panels(shares)
    return [Section("balance", "Balance", body)]


def frames(findings: RunFindings) -> Section:
    """Images of a few clips, row by row."""
    cards = [
        _card(findings.clips, clip, strips)
        for clip, strips in zip(findings.shown, findings.strips, strict=True)
    ]
    kinds = list(findings.explained)
    moves = any(len(strips.rows["Input"]) > 1 for strips in findings.strips)
    text = (
        f"The {SPLIT_WORDS[findings.split]} {'clips that move most' if moves else 'images'}, of "
        "different sensors, objects and recordings. "
        "The background is subtracted: what nothing touches is grey. "
    )
    if not kinds:
        text += "No objective reconstructs."
    elif len(kinds) == 1:
        text += f"Only {kinds[0]} are reconstructed: no objective reconstructs the rest."
    return Section("frames", "Frames", paragraph(text) + panels(cards, wide=True))


def _card(clips: Clips, clip: int, strips: Strips) -> Markup:
    count = len(strips.rows["Input"])
    columns = np.unique(np.linspace(0, count - 1, min(count, _FRAMES)).round().astype(int)).tolist()
    body = Markup()
    for name, pictures in strips.rows.items():
        note = _ROW_NOTES.get(name, "")
        if name == "Difference":
            note += f" {strips.gain:.2g} times"
        missing = count - len(pictures)  # differences begin with frame 2
        images = [
            image(pictures[i - missing], f"{name}, frame {i + 1}") if i >= missing else None
            for i in columns
        ]
        body += strip(images, len(columns), f"{name}: {note}" if note else name)
    explained = ", ".join(f"{percent(share)} ({kind})" for kind, share in strips.explained.items())
    explained = f"Explained variance of hidden pixels: {explained}" if explained else ""
    return card(clip_title(clips, clip), body, explained)


def data_section(data: TouchData, skipped: Sequence[str]) -> Section:
    """The training data: recordings, sources, and unreadable files."""
    rows = []
    sources: Counter[tuple[str, str, int]] = Counter()
    for split in ("train", "val"):
        summary = data.summary(split)
        for sensor in summary.sensors:
            counts = [count for kind, count in summary.items() if kind.sensor == sensor]
            total: Counter[str] = Counter()
            for count in counts:
                total.update(count.labels)
            recordings = sum(count.recordings for count in counts)
            frames_of_it = sum(count.frames for count in counts)
            time = duration(sum(count.seconds for count in counts))
            labels = (counted(total, label) for label in LABELS)
            name = f"{sensor}, {SPLIT_WORDS[split]}"
            rows.append((name, str(recordings), str(frames_of_it), time, *labels))
        for kind, count in summary.items():
            sources[kind.source, kind.licence, kind.tier] += count.recordings
    head = ("Sensor", "recordings", "frames", "time", *(f"with {label}" for label in LABELS))
    body = table("recordings", head, rows, "Recordings with a label are counted, whole or in part.")
    if data.val is None:
        body += paragraph("No recordings are held out for validation.", soft=True)
    for line in getattr(data.dataset, "held_out", ()):
        body += paragraph(f"Held out: {line}.")
    lines = [
        (source or "not given", f"text|{licence or 'not given'}", str(tier), str(count))
        for (source, licence, tier), count in sorted(sources.items())
    ]
    body += table("sources", ("Source", "text|licence", "tier", "recordings"), lines)
    if not skipped:
        return Section("data", "Data", body + paragraph("Skipped recordings: none."))
    body += details(f"Skipped recordings: {len(skipped)}", items(skipped), is_open=True)
    return Section("data", "Data", body)


def facts(known: Mapping[str, Any]) -> Section:
    """Facts about the samples from the data set, used to build heads."""
    rows = []
    for key, value in known.items():
        said = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
        rows.append((key.replace("_", " "), f"text|{said}"))
    return Section("facts", "Samples", table("facts", ("Of the samples", "text|is"), rows))


def recipe(folder: Path) -> Section:
    """The resolved recipe, the versions and the command."""
    body = _details("The resolved recipe (config.yaml)", (folder / "config.yaml").read_text())
    kept = run_folder.read_versions(folder)
    if not kept:
        return Section("recipe", "Recipe", body + paragraph("versions.json is not there."))
    program, *words = kept["command"]
    command = shlex.join([Path(program).name, *words])
    versions = "\n".join(f"{name} {version}" for name, version in kept["versions"].items())
    plugins = "\n".join(f"{name}: {package}" for name, package in kept["plugins"].items())
    body = preformatted(command) + body + _details("Versions", versions)
    return Section("recipe", "Recipe", body + _details("Installed plugins", plugins))


def _details(title: str, text: str) -> Markup:
    return details(title, preformatted(text))
