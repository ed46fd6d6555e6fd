"""docs/contracts.md is made from the code: ``python tests/test_contracts_page.py`` writes it."""

import re
from dataclasses import MISSING, fields
from inspect import getdoc
from pathlib import Path

from tactileforge_bench.tasks.suite import ClipSpec, SplitPlan, Task
from tactileforge_bench.tasks.targets import TARGETS

from tactileforge import contracts
from tactileforge.contracts import Recording, SensorSpec
from tactileforge.specs.published import SPECS

PAGE = Path(__file__).parents[1] / "docs" / "contracts.md"
HEAD = """# Contracts

What a recording, a batch, a type of sensor and a task of the benchmark hold. This page is made from
the code (`python tests/test_contracts_page.py`), and a test compares the two.
"""


def meanings(kind: type) -> dict[str, str]:
    """Attributes of a docstring with their meanings."""
    text = re.split(r"\n\n(?=\S)", (getdoc(kind) or "").partition("Attributes:\n")[2])[0]
    rows = re.findall(r"^    (\w+): (.*(?:\n        .*)*)", text, re.M)
    return {name: " ".join(words.split()) for name, words in rows}


def table(kind: type) -> str:
    """One row a field: its type, its default and its meaning."""
    known, rows = meanings(kind), ["| field | type | default | meaning |", "|---|---|---|---|"]
    for field in fields(kind):
        made = field.default_factory is not MISSING
        default = "" if field.default is MISSING else f"`{field.default!r}`"
        default = f"`{field.default_factory()!r}`" if made else default
        type_name = str(field.type).replace("|", "\\|")
        rows.append(
            f"| `{field.name}` | `{type_name}` | {default.replace('|', chr(92) + '|')} "
            f"| {known[field.name].replace('|', chr(92) + '|')} |"
        )
    return "\n".join(rows)


def sensors() -> str:
    """The published types of sensors."""
    rows = [
        "| name | rows x columns | fps | area, mm | force scale x, y, z, N |",
        "|---|---|---|---|---|",
    ]
    for spec in SPECS.values():
        area = (
            "not public" if spec.area_mm is None else f"{spec.area_mm[0]:g} x {spec.area_mm[1]:g}"
        )
        scale = ", ".join(f"{value:g}" for value in spec.force_scale)
        size = f"{spec.height} x {spec.width}"
        rows.append(f"| `{spec.name}` | {size} | {spec.fps:g} | {area} | {scale} |")
    return "\n".join(rows)


def page() -> str:
    """The whole page."""
    doc = contracts.__doc__ or ""
    axes, batch = doc.partition("Axes. ")[2].partition("A batch is a plain dict:")[::2]
    labels = ("label:NAME", "numbers:NAME+NAME", "shares:NAME+NAME")
    targets = ", ".join(f"`{name}`" for name in (*TARGETS, *labels))
    parts = {
        "Recording": f"{axes.strip()}\n\n{table(Recording)}",
        "Batch": f"A batch is a plain dict:\n{batch.rstrip()}",
        "SensorSpec": table(SensorSpec),
        "Known sensors": f"Plugins add to these.\n\n{sensors()}",
        "A task of the benchmark": f"Targets: {targets}.\n\n{table(Task)}",
        "Its clips": table(ClipSpec),
        "Its split": table(SplitPlan),
    }
    text = HEAD + "".join(f"\n## {title}\n\n{body}\n" for title, body in parts.items())
    return text.replace("``", "`")


def test_the_page_is_what_the_code_says() -> None:
    assert PAGE.read_text("utf-8") == page(), f"write it: python {__file__}"
    for kind in (Recording, SensorSpec, Task, ClipSpec, SplitPlan):
        assert meanings(kind).keys() == {field.name for field in fields(kind)}


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
