"""The speed of a run, in its report."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactileforge.pages.curves import Curve
from tactileforge.pages.page import number, percent
from tactileforge.training.speed import WAITING


def speed_fact(curves: Mapping[str, Curve]) -> str:
    """Medians of clips per second, share of time spent waiting, and MFU; "" if not logged."""
    values = {key: float(np.median(curve.values)) for key, curve in _logged(curves).items()}
    if "clips_per_s" not in values:
        return ""
    text = f"{number(values['clips_per_s'])} clips/s, {percent(values['waiting'])} waiting for data"
    return text + (f", MFU {percent(values['mfu'])}" if "mfu" in values else "")


def speed_verdict(curves: Mapping[str, Curve]) -> list[tuple[str, str]]:
    """A finding if the loader limited the speed; otherwise none."""
    waiting = _logged(curves).get("waiting")
    if waiting is None or not (share := float(np.median(waiting.values))) > WAITING:
        return []
    text = (
        f"Training waited for data {percent(share)} of the time (median): raise batch.workers, or "
        "pack the data at the encoder's size (tactileforge data pack)."
    )
    return [("bad", text)]


def _logged(curves: Mapping[str, Curve]) -> dict[str, Curve]:
    return {k.removeprefix("speed/"): v for k, v in curves.items() if k.startswith("speed/")}
