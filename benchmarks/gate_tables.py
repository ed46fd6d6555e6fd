"""Tables of the release gate in docs/reports/gate.md, from the results of its two suites.

Run, after ``bench suite=real`` and ``suite=real_held_out`` with the weights that ship, and with
their ``gate.json`` in ``results/``: python benchmarks/gate_tables.py
"""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

from tactileforge_bench.results.release_gate import COMPARED

PAGE = Path(__file__).parents[1] / "docs" / "reports" / "gate.md"
RESULTS = Path(__file__).parent / "results"
#: Suites, and the short names of their tasks; those in brackets do not count.
SUITES = {
    "real": {
        "real_octopi_object": "object",
        "real_octopi_hardness": "hardness",
        "real_octopi_roughness": "roughness",
        "real_losing_grip": "(grip)",
        "real_force_gelsight_mini": "force Mini",
        "real_ball_gelsight": "ball FOTS",
        "real_ball_gelsight_domed": "ball Taxim",
        "real_edge_progress": "edge",
        "real_ball_digit": "ball DIGIT",
        "real_ball_digit_unit": "other DIGIT",
    },
    "real_held_out": {
        "held_octopi_object": "object",
        "held_octopi_hardness": "hardness",
        "held_octopi_roughness": "roughness",
        "held_losing_grip": "(grip)",
        "held_force_digit": "force DIGIT",
        "held_ball_gelsight_mini": "ball Mini",
        "held_ball_wedge": "ball wedge",
        "held_cable_contact": "(cable)",
        "held_ball_size": "(ball size)",
    },
}
#: Rows of a table: models, their random weights, and what a user has without touch.
ROWS = {
    "touch.tiny": "`touch.tiny`",
    "untrained:touch.tiny": "its random weights",
    "anytouch2.tiny-real": "`anytouch2.tiny-real`",
    "untrained:anytouch2.tiny-real": "its random weights",
    "anytouch2.tiny": "`anytouch2.tiny`",
    "untrained:anytouch2.tiny": "its random weights",
    "imagenet": "photographs (`imagenet`)",
    "statistics": "picture statistics",
    "pixels": "16 x 16 pixels",
    "motion": "motion energy",
    "hog": "HOG",
    "background": "background alone",
    "chance": "chance",
}
MODELS = ("touch.tiny", "anytouch2.tiny-real", "anytouch2.tiny")
#: Baselines with one vector, for which the reading says nothing.
_PLAIN = ("statistics", "pixels", "motion", "hog", "background", "chance")
READINGS = ("groups", "summary", "patches", "pooled")
#: Readings whose single tasks are shown: what the gate reads, and all patches. The files have all.
_SHOWN = ("groups", "patches")


@cache
def load(suite: str) -> dict[str, Any]:
    """The gate of a suite, as ``bench`` wrote it."""
    plain: dict[str, Any] = json.loads((RESULTS / f"{suite}_gate.json").read_text("utf-8"))
    return plain


@cache
def rows_of(suite: str) -> dict[tuple[str, str, str], Any]:
    """Rows of a suite, by model, reading and task."""
    return {(row["model"], row["reading"], row["task"]): row for row in load(suite)["rows"]}


def value_table(suite: str) -> str:
    """Values of all models by groups and patches, task by task, and means of counted tasks."""
    tasks, rows = SUITES[suite], rows_of(suite)
    lines = [["", "reading", *tasks.values(), "mean"]]
    for model, title in ROWS.items():
        for reading in READINGS:
            is_shown = model in _PLAIN or reading in _SHOWN
            if not is_shown or (model, reading, "mean") not in rows:
                continue
            cells = [f"{rows[model, reading, task]['value']:.2f}" for task in tasks]
            mean = f"{rows[model, reading, 'mean']['value']:.3f}"
            lines.append([title, "" if model in _PLAIN else reading, *cells, mean])
    return _markdown(lines)


def lead_table() -> str:
    """Leads of the means over what a user has without touch, and tasks below random weights."""
    lines = [
        ["", "reading", "suite", "random weights", "pixels", "statistics", "photographs", "below"]
    ]
    for model in MODELS:
        for reading in READINGS:
            for suite in SUITES:
                above = rows_of(suite)[model, reading, "mean"]["above"]
                below = load(suite)["models"][model][reading]["below_random"]
                cells = [_lead(above[name]) for name in COMPARED]
                names = ", ".join(SUITES[suite][task] for task in below)
                lines.append([f"`{model}`", reading, f"`{suite}`", *cells, names])
    return _markdown(lines)


def _lead(lead: dict[str, float]) -> str:
    """A lead, bold beyond the interval."""
    text = f"{lead['value']:+.3f} ({lead['low']:+.3f} to {lead['high']:+.3f})"
    return f"**{text}**" if lead["low"] > 0 else text


def _markdown(lines: list[list[str]]) -> str:
    head, *rows = [f"| {' | '.join(line)} |" for line in lines]
    return "\n".join([head, "|" + "---|" * len(lines[0]), *rows])


def blocks() -> dict[str, str]:
    """Tables by the name of their place in the page."""
    return {"leads": lead_table()} | {suite: value_table(suite) for suite in SUITES}


def filled(text: str) -> str:
    """The page with its tables written anew, each after ``<!-- table: NAME -->``."""
    for name, table in blocks().items():
        head, mark, rest = text.partition(f"<!-- table: {name} -->\n\n")
        assert mark, name
        after = re.sub(r"^(?:[|].*\n)*\n*", "", rest)
        text = f"{head}{mark}{table}\n\n{after}"
    return text


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text("utf-8")), "utf-8")
