"""The data set ``sparsh_force``: probes press and slide on a DIGIT or GelSight Mini."""

from __future__ import annotations

from tactileforge.datasets.reading.official import FORCE_SPLITS
from tactileforge.datasets.reading.sparsh import SparshTrajectories


class SparshForce(SparshTrajectories):
    """T1 of Sparsh, force estimation: a trajectory is a recording.

    Pickles are read without executing anything. The background is the first image of the batch
    that is not in contact. Known defects: five images more than forces in most trajectories,
    channels in the wrong order in most batches, DIGIT images that lie on their side. Forces are in
    newton; which way x and y point in the image is not published, so no actions are derived.

    Args:
        root: Folder of the probes of one sensor.
        sensor: ``digit`` or ``gelsight_mini``.
        split: One of ``splits``.
        val: Share of the trajectories that is held out.
        fps: Frames per second; it is not published.

    Raises:
        ConfigError: An unknown sensor or split, or a share outside 0..1.
    """

    name = "sparsh_force"
    by_sensor = FORCE_SPLITS
    splits = FORCE_SPLITS["digit"]
