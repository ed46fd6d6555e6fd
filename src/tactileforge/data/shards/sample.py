"""The touch of the package, for first steps without data or a sensor."""

from __future__ import annotations

from importlib.resources import as_file, files

from tactileforge.contracts import Recording
from tactileforge.data.shards.shards import read_shard


def sample_touch() -> Recording:
    """A simulated touch: a key is pressed on a GelSight Mini and dragged, 40 frames in 2.2 s.

    Returns:
        Recording with uint8 frames (40, 240, 320, 3), times in seconds, the frame without contact
        (`Recording.background`) and forces (40, 3) in newton.

    Example:
        >>> touch = sample_touch()
        >>> touch.sensor, touch.frames.read([0, 20]).shape, touch.force.shape
        ('gelsight_mini', (2, 240, 320, 3), (40, 3))
    """
    # frames are read when they are asked for, from a file that stays where it was installed
    with as_file(files("tactileforge.data.shards") / "press.tar") as path:
        return next(iter(read_shard(path)))
