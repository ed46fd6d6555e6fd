"""The parts of a loaded model: encoder, heads, header, and the hashes of their weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from tactileforge.encoders.feature_groups import group_sizes
from tactileforge.hub.cards import Card
from tactileforge.hub.clip_encoder import ClipEncoder, check_device
from tactileforge.hub.forces import fingerprint
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import squash_images
from tactileforge.hub.packed_force import PackedForce
from tactileforge.hub.picture_checks import PictureChecks
from tactileforge.plugins import local
from tactileforge.util.threads import usable_after_fork


class Parts(nn.Module):
    """Encoder, heads and header of a model in eval mode; arguments and attributes as of `Model`."""

    # set where weights are rounded, see `keep_fingerprint`; else computed when they are asked for
    _fingerprint = _encoder_hash = ""

    def __init__(
        self,
        encoder: Any,
        header: Header,
        card: Card | None = None,
        device: str | torch.device = "cpu",
        heads: Mapping[str, nn.Module] | None = None,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self._picture_checks = PictureChecks()
        self.header = header
        self.card = card
        self.heads = nn.ModuleDict(dict(heads or {}))
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        # encoding in workers that are forked is a usual pattern, as of a DataLoader
        usable_after_fork()
        # checked first: a move that fails would leave a part of the weights behind
        self.to(check_device(device)).eval()
        self.loaded = self.part_hashes()

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        return self.clips_reader.device

    @property
    def sensors(self) -> list[str]:
        """Sensors in its training; with ``any_sensor`` it takes others, too."""
        return list(self.encoder.sensors)

    @property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type: every sensor is encoded alike, named or not."""
        return self.clips_reader.any_sensor

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip; 0 for one frame."""
        return self.header.spacing

    @property
    def recipe(self) -> dict[str, Any]:
        """The resolved recipe of its training; empty for imported weights."""
        return self.header.recipe

    @property
    def squashed(self) -> tuple[int, int] | None:
        """Height and width of squashed frames in its training, before any resizing by the encoder.

        None for imported weights: their encoder was trained on frames of any size.
        """
        return self.clips_reader.squashed

    @property
    def reading(self) -> Literal["summary", "projected"]:
        """Vector of `encode` without groups: ``summary``; ``projected`` of imported weights.

        A linear probe on the summary of a model trained here reads more than on its projected class
        token (docs/reports/gate.md). Imported weights give the vector that their authors use.
        """
        return self.clips_reader.reading

    @property
    def vector_size(self) -> int:
        """Length of a vector of `encode`."""
        return self.clips_reader.vector_size

    @property
    def group_sizes(self) -> dict[str, int]:
        """Size of each group of `groups`, by name, in their order."""
        return group_sizes(self.encoder)

    @property
    def fingerprint(self) -> str:
        """Hash of its weights, 16 hexadecimal digits; ties a calibration to its model.

        Heads by classes of the user's own do not count: the file is read without them too.
        """
        if self._fingerprint:
            return self._fingerprint
        own = {key for key, one in self.header.heads.items() if local.is_local(one["node"]["name"])}
        heads = [self.heads[key] for key in sorted(self.heads) if key not in own]
        return fingerprint([self.encoder, *heads])

    @property
    def encoder_hash(self) -> str:
        """The same of the encoder's weights alone; ties a head for classes to its encoder."""
        return self._encoder_hash or fingerprint([self.encoder])

    @property
    def is_rounded(self) -> bool:
        """Whether its weights were rounded when it was loaded: ``dtype`` of `load`."""
        return bool(self._fingerprint)

    def part_hashes(self) -> dict[str, str]:
        """Hashes of the weights of ``encoder`` and of each ``head.NAME``."""
        parts = {"encoder": self.encoder, **{f"head.{key}": x for key, x in self.heads.items()}}
        return {key: fingerprint([part]) for key, part in parts.items()}

    def keep_fingerprint(self) -> None:
        """Keeps the hashes of the current weights: a fit for a model also fits its rounded copy."""
        self._fingerprint, self._encoder_hash = self.fingerprint, self.encoder_hash

    def __repr__(self) -> str:
        size = sum(x.numel() for x in self.encoder.state_dict().values()) / 1e6  # int8 is a buffer
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.vector_size})"
        )

    def squash(self, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Images as training showed them to the encoder; `encode` and the others do it themselves.

        Args:
            images: uint8 (..., H, W, 3).
        """
        return squash_images(images, self.squashed)

    # made anew at each use: an encoder or head may be put in another's place
    @property
    def clips_reader(self) -> ClipEncoder:
        """Its encoder, with the preprocessing of clips."""
        return ClipEncoder(self.encoder, trained_here=bool(self.recipe))

    @property
    def force_reader(self) -> PackedForce | None:
        """Its force head, with the encoder; None without one."""
        if "force" not in self.heads:
            return None
        return PackedForce(self.clips_reader, self.heads["force"], self.header.heads["force"])
