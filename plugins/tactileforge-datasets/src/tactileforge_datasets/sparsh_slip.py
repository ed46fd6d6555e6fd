"""The data set ``sparsh_slip``: slip of a probe on a DIGIT or GelSight Mini."""

from __future__ import annotations

from tactileforge_datasets.official_splits import SLIP_SPLITS
from tactileforge_datasets.sparsh import SparshTrajectories


class SparshSlip(SparshTrajectories):
    """T2 of Sparsh, slip detection: the files of ``sparsh_force``, in splits of its own.

    ``tracks["slip"]`` is int8 (T,), 1 for frames with slip.

    Args:
        root: Folder of the probes of one sensor.
        sensor: ``digit`` or ``gelsight_mini``.
        split: One of ``splits``.
        val: Share of the trajectories held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown sensor or split, or a share outside 0..1.
    """

    name = "sparsh_slip"
    by_sensor = SLIP_SPLITS
    splits = SLIP_SPLITS["digit"]
