"""Writes docs/checks.md from the checks: python benchmarks/checks_page.py [--measure]."""

from __future__ import annotations

import json
import sys
from inspect import getdoc
from pathlib import Path
from textwrap import fill
from time import process_time

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.checks import CODES, Check, CheckRun, catalogue, made_touch
from tactileforge.contracts import Recording

PAGE = Path(__file__).parents[1] / "docs" / "checks.md"
#: Cost of each check, written by ``--measure``.
COSTS = Path(__file__).parent / "results" / "checks.json"
#: Folder of a picture for each check of group 3, drawn from its examples.
PICTURES = Path(__file__).parents[1] / "docs" / "assets" / "checks"
#: Frames of the recording that is measured on, and how often each pixel of a drawn one is in it.
_FRAMES, _LARGER = 300, 4
#: Longer side of a frame in a picture, pixels.
_SHOWN = 160
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
every recording, and those of pictures in `train` and `calibrate` on eight recordings: at most 112
frames of each are decoded (24, the next of each, and 64 in a row), however many there are. Those of
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

The cost of a check is CPU time, run alone on a recording of 300 frames of 320 x 240 pixels that are
in memory: decoding comes on top, once for all checks of a run, and so does what they measure on the
same frames.

"""


def cost_of(check: type[Check]) -> str:
    """Frames decoded by a check, in words."""
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


def measure() -> dict[str, float]:
    """CPU time of each check of recordings, run alone, ms: the least of five."""
    small = made_touch().frames.read([0])[0].astype(np.float64)
    still = small.repeat(_LARGER, axis=0).repeat(_LARGER, axis=1)
    depth = np.sin(np.pi * np.linspace(-0.125, 1.125, _FRAMES).clip(0, 1)) ** 2
    one = made_touch(still=still, depth=depth)
    out: dict[str, float] = {}
    for name, check in catalogue().items():
        if name not in CODES or "stream" in check.needs:
            continue
        times = []
        for _ in range(5):
            run, start = CheckRun([name]), process_time()
            run.look(one)
            run.end()
            times.append(1e3 * (process_time() - start))
        out[name] = float(f"{min(times):.2g}")
    return out


def picture(check: type[Check]) -> NDArray[np.uint8]:
    """Good and bad example of a check side by side, uint8 (H, W, 3), RGB.

    Of each the background, the first frame and the middle one; grey where there is no background.
    """
    shown = check.examples()
    touches = [examples[-1] for examples in (shown.good, shown.bad)]
    strips = [np.hstack(_shown(one)) for one in touches if isinstance(one, Recording)]
    height = max(len(strip) for strip in strips)
    lower = [
        np.pad(one, ((0, height - len(one)), (0, 16), (0, 0)), constant_values=255)
        for one in strips
    ]
    return np.hstack(lower)[:, :-16]


def _shown(touch: Recording) -> list[NDArray[np.uint8]]:
    first, middle = touch.frames.read([0, len(touch.frames) // 2])
    still = np.full_like(first, 200) if touch.no_contact is None else touch.no_contact.read([0])[0]
    size = len(first) * _SHOWN // max(first.shape[:2])
    return [
        cv2.resize(one, (one.shape[1] * size // len(one), size)) for one in (still, first, middle)
    ]


def page() -> str:
    """Text of the page."""
    costs = json.loads(COSTS.read_text())["ms"]
    checks = {name: check for name, check in catalogue().items() if name in CODES}
    out = [_TOP, "| code | name | level | reads | ms |\n|---|---|---|---|---|\n"]
    for name, check in checks.items():
        link = f"[{check.code}](#{check.code.lower()})"
        spent = f"{costs[name]:g}" if name in costs else ""
        out.append(f"| {link} | `{name}` | {check.level} | {cost_of(check)} | {spent} |\n")
    group = ""
    for name, check in checks.items():
        if GROUPS[check.code[2]] != group:
            group = GROUPS[check.code[2]]
            out.append(f"\n## {group}\n")
        out.append(f"\n### {check.code}\n\n")
        head = f"**{check.title}** (`{name}`, {check.level}). {check.why}"
        bad = (getdoc(check.examples) or "").rstrip(".")
        if check.code[2] == "3":
            shown = "Good and bad example: background, first and middle frame of each"
            out.append(f"![{shown}](assets/checks/{check.code.lower()}.jpg)\n\n")
        tail = f"Put right: {check.fix.rstrip('.')}. Bad example: {bad}."
        out += [fill(head, _WIDTH, break_long_words=False), "\n\n"]
        out += [fill(tail, _WIDTH, break_long_words=False, break_on_hyphens=False), "\n"]
    return "".join(out)


if __name__ == "__main__":
    if "--measure" in sys.argv:
        about = {"frames": _FRAMES, "height": 320, "width": 240, "unit": "ms of CPU"}
        COSTS.write_text(json.dumps({**about, "ms": measure()}, indent=1) + "\n")
    for one in catalogue().values():
        if one.code[2:3] == "3":
            PICTURES.mkdir(exist_ok=True)
            path = str(PICTURES / f"{one.code.lower()}.jpg")
            cv2.imwrite(path, picture(one)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    PAGE.write_text(page())
