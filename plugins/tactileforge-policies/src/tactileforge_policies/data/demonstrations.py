"""The data set ``demonstrations``: shards with the touch and the commands of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import CutColumns
from tactileforge.datasets import Shards
from tactileforge.errors import ConfigError, unknown
from tactileforge_policies.data.episodes import Demonstration, check_alike, episodes_of
from tactileforge_policies.data.samples import Cutting, EpisodeClips

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Demonstrations:
    """Demonstrations in shards, one recording a finger (`docs/policies.md`).

    Episodes of both splits of the shards are taken together, and some are drawn for validation.
    Failed episodes (label ``success`` is 0) are left out.

    Args:
        root: Folder of the shards, or its URL.
        val: Share of the episodes held out; at least one where there are two. The paper holds out
            8 of 50.
        seed: Seed of the choice of held-out episodes.
        horizon: Commands of a chunk.
        observations: Number of steps with state and camera image in an observation.
        touch: ``frames``, the pictures of the fingers; ``force``, their forces (N, privileged:
            no sensor measures them as well); or ``none``.
        camera: Whether the camera image is used.
        image_size: Height and width of the resized camera image, pixels.
        reference_press: Whether the change of each picture is divided by the gain of its finger
            in a reference press; see `reference.reference_gain`.

    Raises:
        ConfigError: An invalid share or number of steps.
    """

    provides = frozenset({"force", "text", "image", "action_chunk"})

    def __init__(
        self,
        root: str,
        val: float = 0.16,
        seed: int = 0,
        horizon: int = 8,
        observations: int = 2,
        touch: Literal["frames", "force", "none"] = "frames",
        camera: bool = True,
        image_size: int = 48,
        reference_press: bool = False,
    ) -> None:
        if not 0 <= val < 1 or horizon < 1 or observations < 1:
            raise ConfigError(
                f"data.val={val}, data.horizon={horizon}, data.observations={observations}: give a "
                "share below 1, and at least one step each"
            )
        self.shards = Shards(root)
        self.val = val
        self.seed = seed
        self.cutting = Cutting(
            horizon=horizon,
            observations=observations,
            touch=touch,
            camera=camera,
            image_size=image_size,
            reference_press=reference_press,
        )

    @property
    def skipped(self) -> list[str]:
        """Unreadable recordings, a line each."""
        return self.shards.skipped

    @cached_property
    def _episodes(self) -> dict[str, list[Demonstration]]:
        both = [one for split in ("train", "val") for one in self.shards.recordings(split)]
        episodes = [one for one in episodes_of(both) if one.first.labels.get("success") != 0]
        if episodes:
            check_alike(episodes, self.cutting.camera)
        held = max(1, round(self.val * len(episodes))) if self.val and len(episodes) > 1 else 0
        drawn = set(np.random.default_rng(self.seed).permutation(len(episodes))[:held].tolist())
        split = ["val" if i in drawn else "train" for i in range(len(episodes))]
        return {
            name: [one for one, its in zip(episodes, split, strict=True) if its == name]
            for name in ("train", "val")
        }

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, episode by episode; see `contracts.Dataset`.

        Raises:
            DataNotFoundError: There are no shards.
            DataError: The recordings cannot train one policy; see `check_alike`.
            ConfigError: An unknown split.
        """
        if split not in ("train", "val"):
            raise ConfigError(unknown("split", split, ("train", "val")))
        for episode in self._episodes[split]:
            yield from episode.fingers.values()

    def cut(
        self,
        recordings: Iterable[Recording],
        frames: int,
        spacing: float,
        hop: float,
        size: tuple[int, int],
        cache_mb: float = 512,
        columns: CutColumns | None = None,
    ) -> EpisodeClips:
        """Cuts recordings into samples, one for each step; ``hop`` is not used."""
        return EpisodeClips(recordings, frames, spacing, size, self.cutting, cache_mb, columns)

    def plot(self, recording: Recording) -> Figure:
        """Plots a recording."""
        return self.shards.plot(recording)
