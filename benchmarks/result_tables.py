"""Writes the tables of growth.json (docs/fast.md) and reader_instead.json (docs/reliability.md).

Run: python result_tables.py
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from textwrap import TextWrapper
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results"
END = "<!-- end -->"
#: Items in lines as those of the pages are.
_FILLED = TextWrapper(110, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
#: Exponent at the large end, and growth of memory from the smallest to the largest size, MB, above
#: which a row has a note.
LINEAR, GROWS = 1.1, 10.0
#: Why a cost grows faster than linear, or memory grows, by what there is more of and the verb.
NOTES: dict[tuple[str, str], str] = {
    ("seconds", "sim"): "memory is that of the most detailed shape so far, not of the number of "
    "touches: of 23 touches, looked at one by one, five raised it, and the thirteen last did not.",
    ("sensors", "sim"): "all sensors feel a touch together, so the gels and pictures of one touch "
    "on each are in memory at once.",
    ("images of each of 4 classes", "bench"): "features are in a mapped file, whose pages count "
    "here; the probe reads them.",
    ("epochs of the probe", "bench"): "`linear` is fitted until it has converged, whatever the "
    "number of epochs.",
    ("recordings of 20 frames", "inspect"): "pictures of 400 recordings at most are looked at, "
    "and compared in pairs; of the others labels only.",
    ("classes of 8 images", "bench"): "L-BFGS keeps 100 directions of a layer that has a row a "
    "class and a column an axis of the images, so that work is classes x images.",
}


def needs_note(row: Mapping[str, Any]) -> bool:
    """Whether a row grows faster than it should."""
    return bool(row["slope_large"] > LINEAR or row["mb"][-1] - row["mb"][0] > GROWS)


def growth_table(result: Mapping[str, Any]) -> str:
    """Cost against the amount of work, with notes on rows."""
    lines = [
        "| more | verb | sizes | CPU s | slope, at the large end | memory, MB |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [
            row["grows"],
            row["verb"],
            ", ".join(str(one) for one in row["sizes"]),
            ", ".join(f"{one:.1f}" for one in row["cpu_s"]),
            f"{row['slope']:.2f}, {row['slope_large']:.2f}",
            ", ".join(f"{one:.0f}" for one in row["mb"]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    notes = [
        f"- `{row['verb']}`, {row['grows']}: {note}"
        for row in result["rows"]
        if (note := NOTES.get((row["grows"], row["verb"])))
    ]
    filled = [line for note in notes for line in _FILLED.wrap(note)]
    return "\n".join([*lines, *([""] if notes else []), *filled]) + "\n"


def instead_table(found: Mapping[str, Any]) -> str:
    """Outcomes for sets with a replaced file, by reader."""
    lines = [
        "| reader of | files replaced | times | said | same | silent | traceback, hang, 500 MB |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in found.items():
        cells = [
            name,
            ", ".join(row["files"]),
            str(row["mutants"]),
            *(str(row[key]) for key in ("named", "equal", "silent")),
            str(row["traceback"] + row["hang"] + row["memory"]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    keys = ("mutants", "named", "equal", "silent")
    sums = [str(sum(row[key] for row in found.values())) for key in keys]
    bad = sum(row[key] for row in found.values() for key in ("traceback", "hang", "memory"))
    lines.append(f"| all {len(found)} | | {' | '.join(sums)} | {bad} |")
    return "\n".join(lines) + "\n"


#: Page, mark, file of results and table.
TABLES = (
    ("fast.md", "<!-- made by benchmarks/growth.py -->\n", "growth.json", growth_table),
    (
        "reliability.md",
        "<!-- made by benchmarks/reader_mutants.py --instead -->\n",
        "reader_instead.json",
        instead_table,
    ),
)


def page_with(page: str, mark: str, table: str) -> str:
    """A page with a table between its mark and the next end."""
    before, _, rest = page.partition(mark)
    return before + mark + table + END + rest.partition(END)[2]


def main() -> None:
    for name, mark, results, table in TABLES:
        path = ROOT / "docs" / name
        made = table(json.loads((RESULTS / results).read_text("utf-8")))
        path.write_text(page_with(path.read_text("utf-8"), mark, made), "utf-8")


if __name__ == "__main__":
    main()
