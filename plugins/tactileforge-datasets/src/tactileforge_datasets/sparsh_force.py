"""The data set ``sparsh_force``: probes pressed and slid on a DIGIT or GelSight Mini."""

from __future__ import annotations

from tactileforge_datasets.official_splits import FORCE_SPLITS
from tactileforge_datasets.sparsh import SparshTrajectories


class SparshForce(SparshTrajectories):
    """T1 of Sparsh, force estimation: a trajectory is a recording.

    Pickles are read without executing anything. The background is the batch's first image without
    contact. Known defects of the source: five images more than forces in most trajectories,
    channels in the wrong order in most batches, DIGIT images turned by 90 degrees. Forces are in
    newton; the directions of x and y in the image are not published, so no actions are derived.

    Args:
        root: Folder of the probes of one sensor.
        sensor: ``digit`` or ``gelsight_mini``.
        split: One of ``splits``.
        val: Share of the trajectories held out for validation.
        fps: Frames per second; the true rate is not published.

    Raises:
        ConfigError: An unknown sensor or split, or a share outside 0..1.
    """

    name = "sparsh_force"
    by_sensor = FORCE_SPLITS
    splits = FORCE_SPLITS["digit"]
