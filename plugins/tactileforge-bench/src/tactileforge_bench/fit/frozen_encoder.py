"""Frozen encoders of the benchmark, with the form of their input clips."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tactileforge.contracts import Batch
from tactileforge.encoders import FEATURE_GROUPS, encode_trained, free_groups, group_sizes
from tactileforge.errors import ConfigError
from tactileforge.hub import Header, Language, fingerprint, language_of
from tactileforge_bench.fit import trained_on
from tactileforge_bench.fit.baselines import BASELINES
from tactileforge_bench.fit.probes.base import Probe
from tactileforge_bench.tasks.suite import ClipSpec

#: Frames that a model of single frames is shown.
STILL_FRAMES = 2


class FrozenEncoder:
    """One frozen encoder, and the form of its input clips.

    Clips are read as its training read them: what was trained here is given frames of the size of
    its input, what was imported frames as they were recorded. A model of single frames is shown
    two, along the batch, and its features are averaged (AnyTouch 2, Implementation Details).

    Args:
        name: The word that users type.
        encoder: A touch encoder.
        header: Metadata of the encoder.
        sha256: Hash of its file; "" takes the hash of its weights.
        device: Device of the computation.
        heads: Heads of its file, by name: the aligned one tells words for clips.

    Attributes:
        frames: Frames of an input clip.
        weights: Hash of its weights.
        preprocessing: All else that its features depend on, as plain data.
    """

    def __init__(
        self,
        name: str,
        encoder: Any,
        header: Header,
        sha256: str = "",
        device: str = "cpu",
        heads: Mapping[str, torch.nn.Module] | None = None,
    ) -> None:
        self.name = name
        self.encoder = encoder.to(device).eval().requires_grad_(False)
        self.header = header
        self.device = torch.device(device)
        self.single = encoder.frames == 1
        self.flat: bool = getattr(encoder, "flat", False)
        self.frames: int = STILL_FRAMES if self.single else encoder.frames
        self.native = not header.recipe and header.encoder["name"] not in BASELINES
        digest = hashlib.sha256()
        for key, value in sorted(encoder.state_dict().items()):
            digest.update(key.encode())
            digest.update(value.detach().cpu().contiguous().numpy().tobytes())
        # of tensors and their names, and not of a file: runs and random weights have none
        self.weights = digest.hexdigest()
        self.sha256 = sha256 or self.weights
        self.heads = dict(heads or {})
        self.preprocessing = json.loads(
            json.dumps([header.encoder, header.input, header.sensors, self.native, self.frames])
        )

    @property
    def facts(self) -> dict[str, Any]:
        """Parameters, frames, image size; training data and steps, where they are known."""
        height, width = self.encoder.image_size
        known = {
            "parameters": sum(p.numel() for p in self.encoder.parameters()),
            "frames": self.encoder.frames,
            "image_size": f"{height} x {width}",
        }
        if not self.header.source:
            return known
        known |= {"trained_on": trained_on.trained_on(self.header)}
        if overlap := trained_on.seen(self.header):
            known |= {"seen_of_held_out": overlap}
        steps = self.header.source.get("steps")
        return known if steps is None else known | {"steps": steps}

    def width(self, tap: str) -> int:
        """Width of a feature."""
        if tap == "groups":
            return sum(self.group_sizes.values())
        if tap == "summary":
            return self.group_sizes["summary"]
        width: int = self.encoder.projected if tap == "projected" else self.encoder.width
        return width

    @property
    def group_sizes(self) -> dict[str, int]:
        """Size of each group of features; they lie side by side in the tap ``groups``."""
        return group_sizes(self.encoder)

    def taps(self, kind: type[Probe]) -> tuple[str, ...]:
        """Names of the features for a kind of probe, as far as this encoder has them."""
        if not kind.readings:
            return (kind.tap,)
        return kind.readings[:1] if self.flat else kind.readings

    @property
    def heads_hash(self) -> str:
        """Hash of the weights of its heads."""
        return fingerprint(self.heads.values())

    @property
    def language(self) -> Language:
        """Text side of the model.

        Raises:
            ConfigError: It is not aligned with language.
        """
        if self.name.startswith("untrained:"):
            raise ConfigError("random weights are not aligned with language")
        return language_of(self.header, self.heads, self.name, self.encoder.projected)

    def spacing_of(self, clip: ClipSpec) -> float:
        """Seconds between the frames of its clips."""
        # frames are spread over the whole span, the last one at its end
        if self.single or clip.spread:
            return clip.span / (self.frames - 1)
        return self.header.spacing

    def size_for(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Height and width after reading, for recorded frames of a shape."""
        size: tuple[int, int] = self.encoder.image_size
        return shape if self.native else size

    def unknown(self, sensors: Sequence[str]) -> list[str]:
        """Sensors unknown to the encoder."""
        unknown = []
        for name in sensors:
            try:
                # one by one: an encoder tells only the first that it does not know
                self._rows([name], "error")
            except ConfigError:
                unknown.append(name)
        return unknown

    def features(
        self, batch: Batch, flip: tuple[bool, bool], policy: str, groups: bool = True
    ) -> dict[str, Tensor]:
        """Features for probes, without gradients.

        Args:
            batch: Clips, see `run`.
            flip: Whether it is mirrored left to right, and top to bottom.
            policy: Policy for an unknown sensor: ``error`` or ``universal``.
            groups: Whether ``summary`` or ``groups`` are asked for.

        Returns:
            ``tokens`` (B, L, width) and ``projected`` (B, projected). ``patches`` (B, n width), the
            tokens without those in front, one after another; ``pooled`` (B, width), their mean;
            ``summary``, see `encode_summary`; ``groups`` (B, n), all groups side by side, see
            `feature_groups.encode_groups`. Of a baseline without patches ``pooled`` is
            ``projected``, and the last two are not there.
        """
        with torch.inference_mode():
            taps = self.run(batch, flip, policy, groups and not self.flat)
            patches = taps["tokens"][:, self.encoder.prefix :]
            # fixed features have one token, which is not a patch
            pooled = taps["projected"] if self.flat else patches.float().mean(1)
            return taps | {"pooled": pooled, "patches": patches.flatten(1)}

    def run(
        self, batch: Batch, flip: tuple[bool, bool], policy: str, groups: bool = False
    ) -> dict[str, Tensor]:
        """Outputs of the encoder for a batch, with gradients if it has them; see `features`.

        Args:
            batch: Clips, backgrounds and sensors, see `tactileforge.contracts`.
            flip: Whether it is mirrored left to right, and top to bottom.
            policy: Policy for an unknown sensor: ``error`` or ``universal``.
            groups: Whether to add ``summary`` and ``groups``, see `features`.
        """
        frames = batch["frames"].to(self.device, non_blocking=True)
        background = batch["background"].to(self.device, non_blocking=True)
        mirrored = [dim for dim, on in zip((-1, -2), flip, strict=True) if on]
        if mirrored:
            frames, background = frames.flip(mirrored), background.flip(mirrored)
        rows = self._rows(batch["sensor"], policy).to(self.device)
        if not self.single:
            return self._taps(groups, frames, background, rows)
        count = frames.shape[1]
        taps = self._taps(
            groups,
            # each frame as a clip of its own; the features of a clip are their mean
            frames.flatten(0, 1)[:, None],
            background.repeat_interleave(count, 0),
            rows.repeat_interleave(count),
        )
        return {
            tap: value.reshape(-1, count, *value.shape[1:]).mean(1) for tap, value in taps.items()
        }

    def _taps(
        self, groups: bool, frames: Tensor, background: Tensor, rows: Tensor
    ) -> dict[str, Tensor]:
        if not groups:
            tokens, projected = self.encoder(frames, background, rows)
            return {"tokens": tokens, "projected": projected}
        tokens, projected, trained = encode_trained(self.encoder, frames, background, rows)
        all_groups = trained | free_groups(frames, background, FEATURE_GROUPS)
        joint = torch.cat([values.float() for values in all_groups.values()], 1)
        return {
            "tokens": tokens,
            "projected": projected,
            "summary": trained["summary"],
            "groups": joint,
        }

    def _rows(self, sensors: Sequence[str], policy: str) -> Tensor:
        # encoders with sensor tokens decide themselves what an unknown sensor is given
        if hasattr(self.encoder, "unknown_sensor"):
            self.encoder.unknown_sensor = policy
        if hasattr(self.encoder, "sensor_ids"):
            rows: Tensor = self.encoder.sensor_ids(sensors)
            return rows
        known = self.encoder.sensors
        if strange := [name for name in sensors if known and name not in known]:
            raise ConfigError(f"the model does not know the sensor {strange[0]!r}")
        return torch.tensor([known.get(name, 0) for name in sensors])
