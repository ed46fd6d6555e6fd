"""The data set ``sim_array``: simulated touch on arrays of taxels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.contracts import Recording
from tactileforge.data import read_shard
from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import cache_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from tactileforge_sim.config import SimConfig

    from tactileforge_arrays.scenes import Array


class SimArray:
    """The touches of ``sim``, measured by a grid of taxels below a skin.

    Normal and shear traction are summed over the cell of each taxel, with noise, and drawn by the
    layout of the array: red, green and blue are x, y and z (`sensors.taxels`). Forces are exact.
    The values of the taxels are the track ``taxels``, N. The first use simulates the touches, and
    stores them in the folder ``cache``.

    Args:
        scenes: Number of touches for training.
        val: Number of touches for validation.
        sensor: Name of the array in recordings; see `tactileforge.specs.published`.
        shape: Rows and columns of taxels.
        pitch: Distance between neighbouring taxels, mm.
        axes: 3 for normal force and shear, 1 for normal force alone.
        span: Force on a taxel drawn as full colour, N; larger forces are clipped to it.
        noise: Standard deviation of the noise of a taxel, N.
        bits: Resolution of the converter, in bits.
        size: Rows of the image; None for one pixel a taxel.
        indenters: Indenters of the simulation: the option ``indenters`` of ``sim``.
        motions: Motions of the simulation: the option ``motions`` of ``sim``.
        action_seconds: Mean duration of one action, s.
        force: Range of the peak normal force of a touch, lowest and highest, N.
        seed: Seed of the touches; a different seed gives different touches.
        cache: Folder of the stored touches; None for ``$TACTILEFORGE_CACHE``, or the user's cache.
        processes: Number of simulating processes; None for one per core.

    Raises:
        ConfigError: A number of touches is negative, or not positive for training.
    """

    provides = frozenset({"force", "action", "object", "text", "image"})

    def __init__(
        self,
        scenes: int = 40,
        val: int = 8,
        sensor: str = "serial_array",
        shape: Sequence[int] = (8, 8),
        pitch: float = 2.0,
        axes: int = 3,
        span: float = 0.5,
        noise: float = 0.001,
        bits: int = 10,
        size: int | None = 16,
        indenters: str | Sequence[str] = "few",
        motions: str | Sequence[str] = "atomic",
        action_seconds: float = 0.6,
        force: Sequence[float] = (0.5, 8.0),
        seed: int = 0,
        cache: str | None = None,
        processes: int | None = None,
    ) -> None:
        if scenes < 1 or val < 0:
            raise ConfigError(
                f"sim_array: scenes={scenes} and val={val}; give 1 or more, and 0 or more"
            )
        self.scenes, self.val = scenes, val
        self.sensor, self.shape, self.pitch, self.axes = sensor, tuple(shape), pitch, axes
        self.span, self.noise, self.bits, self.size = span, noise, bits, size
        self.indenters, self.motions = indenters, motions
        self.action_seconds, self.force, self.seed = action_seconds, tuple(force), seed
        self.cache, self.processes = cache, processes
        self.skipped: list[str] = []

    @property
    def array(self) -> Array:
        """The taxel array.

        Raises:
            ConfigError: A number is out of range.
        """
        from tactileforge_arrays.scenes import Array

        if len(self.shape) != 2:
            raise ConfigError(f"sim_array: shape={list(self.shape)}; give rows and columns")
        return Array(
            sensor=self.sensor,
            shape=(self.shape[0], self.shape[1]),
            pitch=self.pitch,
            axes=self.axes,
            span=self.span,
            noise=self.noise,
            bits=self.bits,
            size=self.size,
        )

    @property
    def config(self) -> SimConfig:
        """Configuration of the simulation.

        Raises:
            ConfigError: An unknown indenter or motion.
        """
        from tactileforge_sim.config import SimConfig

        def plain(names: str | Sequence[str]) -> str | tuple[str, ...]:
            return names if isinstance(names, str) else tuple(names)

        return SimConfig(
            sensors=("gelsight",),  # required, but unused: the array has a skin of its own
            indenters=plain(self.indenters),
            motions=plain(self.motions),
            size=64,
            seconds=self.action_seconds,
            force=self.force,  # type: ignore[arg-type]
            markers=None,
            viscosity=0.0,
            lag=0.0,
            seed=self.seed,
            randomise="none",
        )

    @property
    def folder(self) -> Path:
        """Folder of the stored touches of this configuration."""
        from tactileforge_arrays.scenes import folder_name

        return cache_folder(self.cache) / "sim_array" / folder_name(self.config, self.array)

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split; simulates the missing ones.

        Args:
            split: ``train`` or ``val``.

        Raises:
            ConfigError: An unknown split, indenter or motion, or an invalid array.
        """
        from tactileforge_sim.config import FIRST_VAL
        from tactileforge_sim.generate import path_of

        from tactileforge_arrays.scenes import write_array_scenes

        numbers = {"train": range(self.scenes), "val": range(FIRST_VAL, FIRST_VAL + self.val)}
        if split not in numbers:
            raise ConfigError(unknown("split", split, numbers))
        folder = self.folder
        write_array_scenes(self.config, self.array, folder, numbers[split], self.processes)
        for number in numbers[split]:
            yield from read_shard(path_of(folder, number))

    def plot(self, recording: Recording) -> Figure:
        """Plots a recording."""
        from tactileforge.reading import plot_recording

        return plot_recording(recording)
