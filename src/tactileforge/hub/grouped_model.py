"""Features in named groups, trained and untrained, for probes to weigh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from tactileforge.encoders.feature_groups import (
    check_groups,
    encode_groups,
    group_sizes,
    joint_vector,
)
from tactileforge.hub.feature_model import FeatureModel
from tactileforge.hub.inputs import Images
from tactileforge.hub.sensor_rows import Policy


class GroupedModel(FeatureModel):
    """Groups of features, as base of `hub.model.Model`; see there for arguments and attributes."""

    @property
    def group_sizes(self) -> dict[str, int]:
        """Size of each group of `groups`, by name, in their order."""
        return group_sizes(self.encoder)

    def encode(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        groups: Sequence[str] | Literal["all"] | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """Encodes each clip as one vector; warns of light that has changed while nothing touches.

        Args:
            frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or
                a batch with B in front. numpy or torch. One image, (H, W, 3), (3, H, W) or a batch
                with one frame a clip, is shown in all T places, as the authors do.
            background: A frame without contact of the same recording, of the frames' size: one,
                or one a clip. ``"first"`` takes the first frame of each clip, ``"none"`` subtracts
                nothing. May be left out only where the model uses none.
            sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal
                tokens. May be left out where the model knows one sensor, or none.
            groups: Names of groups, or ``all``, that are put side by side, each times a fixed
                factor with which a plain linear probe does well: see `groups` and
                `feature_groups.joint_vector`. None takes ``summary``, the best single vector for a
                linear probe; of imported weights the projected vector of their authors.
            unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
            batch_size: Clips that are computed at once.

        Returns:
            float32 (n,), or (B, n) for a batch, on the model's device: n is ``vector_size``, or
            what `group_sizes` tells for the groups together.

        Raises:
            DataError: Frames or background are not what the model takes; says both.
            ConfigError: No background, no such sensor or group, or a batch size below 1.
        """
        clips = frames, background, sensor, unknown_sensor, batch_size
        if groups is None and self.reading == "projected":
            return self._tapped("projected", *clips)
        groups = ["summary"] if groups is None else groups
        return joint_vector(self._grouped(None if groups == "all" else groups, *clips))

    def groups(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        names: Sequence[str] | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> dict[str, Tensor]:
        """Features of clips in groups, each computed once from the uint8 frames.

        They differ in content and in size. A probe does best if it weighs the groups, as the
        probes ``ridge`` and ``logistic`` of ``tactileforge bench`` do.

        - ``summary``: of the encoder, as `features` gives it with ``tap="summary"``. No unit.
        - ``photographs``, (2360,), where the encoder has a network of photographs
          (``anytouch2.tiny-real``): the network's own maps, as means of the quarters of the image
          and deviations over it. No unit.
        - ``difference``, (384,): grey levels, un-normalised. Means over 8 x 8 cells of the last
          frame less the background, (3, 8, 8), then of the last frame less the first, (3, 8, 8).
          With ``background="none"`` the first half is the picture itself, less a grey.
        - ``statistics``, (69,): of the last frame less its background at 128 x 128: moments,
          slopes and quantiles in shares of the range of grey levels, logarithms of the power in
          rings of the spectrum, and correlations of the channels.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            names: Names of groups; None takes all. A group that is not named costs nothing: without
                ``summary`` no transformer runs, without ``photographs`` beside it no network.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            batch_size: Clips that are computed at once.

        Returns:
            By name, float32 (n,), or (B, n) for a batch, on the model's device; sizes as in
            `group_sizes`.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: See `encode`; or the model has no such group.

        Example:
            >>> import numpy as np
            >>> from tactileforge import load
            >>> rest = np.full((240, 320, 3), 110, np.uint8)
            >>> model = load("anytouch2.tiny")
            >>> groups = model.groups(np.stack([rest] * 4), rest, "digit", names=["difference"])
            >>> groups["difference"].view(2, 3, 8, 8)[0].mean((1, 2)).tolist()  # red, green, blue
            [0.0, 0.0, 0.0]
        """
        return self._grouped(names, frames, background, sensor, unknown_sensor, batch_size)

    def _grouped(self, names: Sequence[str] | None, *clips: Any) -> dict[str, Tensor]:
        """Reads groups, as `groups` does; ``clips`` are the arguments of `_batches`."""
        wanted = check_groups(self.encoder, names)
        batches, single = self._batches(*clips)
        with torch.no_grad():
            done = [
                encode_groups(
                    self.encoder,
                    frames.to(self.device),
                    background.to(self.device),
                    rows.to(self.device),
                    wanted,
                )
                for frames, background, rows in batches
            ]
        joint = {name: torch.cat([part[name] for part in done]) for name in wanted}
        return {name: values[0] if single else values for name, values in joint.items()}
