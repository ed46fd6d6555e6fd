"""Writes docs/checks.md from the checks themselves: python benchmarks/checks_page.py."""

from __future__ import annotations

from inspect import getdoc
from pathlib import Path
from textwrap import fill

from tactileforge.checks import CODES, Check, catalogue

PAGE = Path(__file__).parents[1] / "docs" / "checks.md"
#: Headings of the hundreds of codes.
GROUPS = {
    "1": "Times",
    "2": "Forces",
    "3": "Pictures",
    "4": "Names and words",
    "5": "The set as a whole",
    "6": "Running sensors",
}
_WIDTH = 110
_TOP = """# Checks

Rules that find silent faults in touch data: wrong units, mirrored pictures, frames stored twice,
a background of another day. Each has a code. They run where data enters: all of them in
`data inspect` and `data check`, those that read labels in `train`, `data pack` and `calibrate` on
every recording, and those of pictures in `train` and `calibrate` on eight recordings. Those of
running sensors see every frame in `record`, `live` and the camera for LeRobot.

<!-- no-run: needs a public set -->
```bash
tactileforge data check touches             # prints findings, exits with 1 where there are some
tactileforge data check touches 'select=[TF2]' json=true
tactileforge data check touches 'ignore=[TF203]' baseline=known.json
tactileforge data check touches fix=true    # writes keys such as mirror: x into the layout
```

A finding is a line: `recording: TF203 force is zero for 40 % of the frames, where the gel is
pressed; ...`. A code may be given by its beginning (`TF2`) or by its name. Notes are choices, and
count with `notes=true`. A baseline is written where there is none, and findings in it are not told
again; `ignore: [TF307]` in a layout says the same of its recordings, at every door. `fix=true`
writes a key where all recordings of a layout agree on it, and keeps the layout as it was beside it
(`tactileforge.yaml.before`).

In Python:

```python
from tactileforge.checks import CheckRun, check_recordings, made_touch

found = check_recordings([made_touch(force=-made_touch().force)], CheckRun(select=["TF202"]))
print(found[0])
```

A package may bring checks of its own: [A check](plugins/check.md).

"""


def cost_of(check: type[Check]) -> str:
    """What a check decodes, in words."""
    needs = check.needs
    if "stream" in needs:
        return "every frame of a running sensor"
    if "all frames" in needs:
        return "up to 1000 frames of a recording"
    if check.name == "repeated_frames":
        return "24 frames of a recording, and 64 in a row"
    if "frames" in needs:
        return "24 frames of a recording, each with the next"
    return "nothing is decoded"


def page() -> str:
    """Text of the page."""
    checks = {name: check for name, check in catalogue().items() if name in CODES}
    out = [_TOP, "| code | name | level | reads |\n|---|---|---|---|\n"]
    for name, check in checks.items():
        link = f"[{check.code}](#{check.code.lower()})"
        out.append(f"| {link} | `{name}` | {check.level} | {cost_of(check)} |\n")
    group = ""
    for name, check in checks.items():
        if GROUPS[check.code[2]] != group:
            group = GROUPS[check.code[2]]
            out.append(f"\n## {group}\n")
        out.append(f"\n### {check.code}\n\n")
        head = f"**{check.title}** (`{name}`, {check.level}). {check.why}"
        bad = (getdoc(check.examples) or "").rstrip(".")
        tail = f"Put right: {check.fix.rstrip('.')}. Bad example: {bad}."
        out += [fill(head, _WIDTH, break_long_words=False), "\n\n"]
        out += [fill(tail, _WIDTH, break_long_words=False, break_on_hyphens=False), "\n"]
    return "".join(out)


if __name__ == "__main__":
    PAGE.write_text(page())
