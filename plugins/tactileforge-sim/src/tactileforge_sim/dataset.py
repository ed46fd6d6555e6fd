"""The data set ``sim``: simulated touch, generated on demand from a seed and cached on disk."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.contracts import Recording
from tactileforge.data import read_shard
from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import cache_folder
from tactileforge.reading import Drawn

if TYPE_CHECKING:
    from tactileforge_sim.config import SimConfig

#: Seconds since its last use in which a cache is not removed: a long run may still read it, and
#: systems note the reading of a file once a day.
_IN_USE = 2 * 86400.0


class Sim(Drawn):
    """Objects pressed, slid or turned, and lifted, on several sensors at once.

    Forces are exact; see `docs/simulator.md`. The first use simulates, and caches the touches in
    ``cache``, in a folder of its own for each configuration and version of the simulator.

    Args:
        scenes: Number of touches for training; each gives one recording per sensor.
        val: Number of touches for validation.
        sensors: Types of sensors, see `specs.published.SIMULATED`.
        indenters: ``few`` (twelve for pre-training), ``pretrain`` (all 61), ``bench`` (validation
            on indenters of its own), ``textures``, ``all``, or names of shapes.
        motions: ``atomic``, ``force_trial``, ``manipulation``, ``all``, or names of motions.
        size: Shorter side of a frame, pixels.
        action_seconds: Mean duration of one action, s.
        force: Range of the largest normal force of a touch, lowest and highest, N.
        markers: Whether the gels have markers; None for their types' default.
        viscosity: Relaxation time of the gels, s; forces then lead images.
        lag: Delay of the images behind the forces, as from a real camera, s.
        randomise: Differences between units of a sensor, and between touches: ``none``, ``unit``,
            ``all``, or names of rows, see `randomise.table.TABLE`.
        seed: Seed of all touches.
        cache: Folder of the cache; None for ``$TACTILEFORGE_CACHE``, or the user's cache folder.
        cache_gb: Size limit of the cache, GB; None for no limit. Touches of other configurations
            and versions go first that were not used for longest, but none used within two days.
        processes: Number of simulating processes; None for one per core.

    Raises:
        ConfigError: ``scenes`` is below 1, ``val`` below 0, or ``cache_gb`` not above 0.
    """

    provides = frozenset({"force", "action", "object", "text", "image", "surface"})

    def __init__(
        self,
        scenes: int = 40,
        val: int = 8,
        sensors: Sequence[str] = ("digit", "gelsight", "gelsight_mini"),
        indenters: str | Sequence[str] = "few",
        motions: str | Sequence[str] = "atomic",
        size: int = 112,
        action_seconds: float = 0.6,
        force: Sequence[float] = (0.5, 8.0),
        markers: bool | None = None,
        viscosity: float = 0.0,
        lag: float = 0.0,
        randomise: str | Sequence[str] = "all",
        seed: int = 0,
        cache: str | None = None,
        cache_gb: float | None = 20.0,
        processes: int | None = None,
    ) -> None:
        if scenes < 1 or val < 0:
            raise ConfigError(f"sim: scenes={scenes} and val={val}; give 1 or more, and 0 or more")
        if cache_gb is not None and not cache_gb > 0:
            raise ConfigError(f"sim: cache_gb={cache_gb}; give GB above 0, or null for no limit")
        self.scenes, self.val = scenes, val
        self.cache, self.cache_gb, self.processes = cache, cache_gb, processes
        self.skipped: list[str] = []
        self._given = {
            "sensors": tuple(sensors),
            "indenters": indenters if isinstance(indenters, str) else tuple(indenters),
            "motions": motions if isinstance(motions, str) else tuple(motions),
            "size": size,
            "seconds": action_seconds,
            "force": tuple(force),
            "markers": markers,
            "viscosity": viscosity,
            "lag": lag,
            "randomise": randomise if isinstance(randomise, str) else tuple(randomise),
            "seed": seed,
        }

    @property
    def config(self) -> SimConfig:
        """Configuration of the simulation.

        Raises:
            ConfigError: An unknown sensor, indenter or motion.
        """
        # imported on use: the options of this class are read without the simulator
        from tactileforge_sim.config import SimConfig

        return SimConfig(**self._given)  # type: ignore[arg-type]

    @property
    def folder(self) -> Path:
        """Folder of the cached touches of this configuration."""
        return cache_folder(self.cache) / "sim" / self.config.digest()

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split; simulates missing ones.

        One touch gives consecutive recordings, one for each sensor.

        Args:
            split: ``train`` or ``val``.

        Raises:
            ConfigError: An unknown split, sensor, indenter or motion.
        """
        from tactileforge_sim.config import FIRST_VAL
        from tactileforge_sim.generate import path_of, write_scenes

        numbers = {"train": range(self.scenes), "val": range(FIRST_VAL, FIRST_VAL + self.val)}
        if split not in numbers:
            raise ConfigError(unknown("split", split, numbers))
        folder = self.folder
        write_scenes(self.config, folder, numbers[split], self.processes)
        with suppress(OSError):  # marks it as used; a cache may be read-only
            os.utime(folder)
        if self.cache_gb is not None:
            make_room(folder, self.cache_gb * 1e9)
        for number in numbers[split]:
            yield from read_shard(path_of(folder, number))


def make_room(folder: Path, limit: float) -> None:
    """Removes caches beside one, the least recently used first, down to a size of all of them.

    Args:
        folder: The cache that is used now, and stays.
        limit: Size of all caches of simulated touches, bytes.
    """
    caches, total = [], 0
    for cache in folder.parent.iterdir():
        # only folders named by a digest: others in this place are somebody's own
        if not re.fullmatch("[0-9a-f]{16}", cache.name) or cache.is_symlink():
            continue
        with suppress(OSError):  # another process makes room, too
            files = [path.stat() for path in cache.iterdir()]
            size = sum(file.st_size for file in files)
            used = [max(file.st_atime, file.st_mtime) for file in files]
            total += size
            caches.append((max([cache.stat().st_mtime, *used]), size, cache))
    for used_last, size, cache in sorted(caches):
        if total <= limit or time.time() - used_last < _IN_USE:
            break
        if cache != folder:
            shutil.rmtree(cache, ignore_errors=True)
            total -= size
