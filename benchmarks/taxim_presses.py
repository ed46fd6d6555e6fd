"""Ball presses by the package `taxim`, for sim_optics.py; runs in an environment with it.

Run: python taxim_presses.py IN.npz OUT.npz
"""

from __future__ import annotations

import os
import sys
import time
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import taxim  # type: ignore[import-not-found]

HERE = Path(taxim.__file__).parent / "calib"


def balls(about: dict[str, Any], shape: tuple[int, int], ball: float, share: float) -> list[Any]:
    """Height map (mm) and depth of each press, for contacts of ``share`` of the circles."""
    spacing = float(about["spacing"])
    found = []
    for x, y, seen in about["circles"]:
        far = np.hypot(*np.ogrid[-y : shape[0] - y, -x : shape[1] - x]) * spacing
        height = ball - np.sqrt(np.maximum(ball**2 - far**2, 0))
        contact = min(share * seen * spacing, 0.98 * ball)
        found.append((height.astype(np.float32), ball - np.sqrt(ball**2 - contact**2)))
    return found


def main() -> None:
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])  # one core, like ours
    about = dict(np.load(sys.argv[1]))
    folder = HERE / str(about["calibration"])
    simulator = taxim.Taxim(folder, backend="jax")
    shape = (simulator.height, simulator.width)
    gel = np.load(folder / "gelmap.npy") * simulator.sensor_params.pixmm
    out: dict[str, np.ndarray] = {"version": np.array(version("taxim"))}
    flat = np.full(shape, 10.0, np.float32)
    ways = product(np.unique(about["balls"]), np.unique(about["shares"]), (0, 1), (0, 1))
    for ball, share, on_dome, shadow in ways:
        if on_dome and np.ptp(gel) < 0.01:
            continue
        pictures = []
        for (height, depth), (x, y, _) in zip(
            balls(about, shape, ball, share), about["circles"], strict=True
        ):
            low = gel.max() - gel[int(y), int(x)] if on_dome else 0.0
            shot = simulator.render(height, with_shadow=bool(shadow), press_depth=depth + low)
            pictures.append(np.rint(255 * np.clip(shot, 0, 1)).astype(np.uint8))
        name = f"ball {ball:g} mm, contact {share:g} of the circle, dome {on_dome}, shadow {shadow}"
        out[name] = np.stack(pictures).transpose(0, 3, 1, 2)
    still = simulator.render(flat, with_shadow=False)
    out["still"] = np.rint(255 * np.clip(still, 0, 1)).astype(np.uint8).transpose(2, 0, 1)
    height, depth = balls(about, shape, 2.0, 1.0)[0]
    for name, step in (("640x480", 1), ("320x240", 2)):
        small = np.ascontiguousarray(height[::step, ::step])
        for shadow in (True, False):
            times = []
            for _ in range(6):
                start = time.perf_counter()
                simulator.render(small, with_shadow=shadow, press_depth=depth)
                times.append(time.perf_counter() - start)
            label = "with" if shadow else "without"
            out[f"fps {name} {label} shadow"] = np.array(1 / np.median(times[1:]))
    np.savez(sys.argv[2], allow_pickle=False, **out)


if __name__ == "__main__":
    main()
