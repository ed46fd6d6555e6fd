"""The Lightning module: an encoder, heads and objectives under a curriculum."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor, nn

from tactileforge import registry
from tactileforge.contracts import Batch, Follower
from tactileforge.curriculum import Curriculum, from_config
from tactileforge.data.augment import Augment, fill_captions
from tactileforge.errors import ConfigError, DataError, TactileForgeError

log = logging.getLogger(__name__)


class TouchModule(L.LightningModule):
    """Trains an encoder with several objectives at once.

    A step asks the encoder for at most one pass of each view, however many objectives there are. An
    objective whose weight is 0 is not computed, nor a view that only it needs. All randomness of a
    step is a function of (seed, batch number, rank): a run that is resumed goes on exactly as it
    would have.

    Args:
        encoder: A touch encoder.
        heads: One for each objective, by its name.
        objectives: By name.
        weights: Largest weight of each objective.
        curriculum: See `curriculum.from_config`.
        optim: ``lr``, ``weight_decay``, ``betas``, and ``warmup``, the share of the run in which
            the learning rate rises; it falls linearly to 0 afterwards.
        augment: Changes clips and their labels, or None.
        seed: Seed of the run.

    Attributes:
        skipped: What could not be read so far: by its name, a line that says why, and how many
            recordings it costs.
        allowed: How many recordings may be skipped before the run stops; None for any number.
    """

    def __init__(
        self,
        encoder: nn.Module,
        heads: Mapping[str, nn.Module],
        objectives: Mapping[str, nn.Module],
        weights: Mapping[str, float],
        curriculum: Mapping[str, Any],
        optim: Mapping[str, Any],
        augment: Augment | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.encoder: Any = encoder
        self.heads = nn.ModuleDict(heads)
        self.objectives = nn.ModuleDict(objectives)
        self.weights = dict(weights)
        self.curriculum_config = dict(curriculum)
        self.optim = dict(optim)
        self.augment = augment
        self.seed = seed
        self.plan: Curriculum | None = None
        self.total = 0
        self.skipped: dict[str, tuple[str, int]] = {}
        self.allowed: int | None = None

    @classmethod
    def from_config(cls, config: Mapping[str, Any], provides: AbstractSet[str]) -> TouchModule:
        """Builds every part from a finished configuration (see `compose.finish`).

        Args:
            config: Plain data.
            provides: Labels the data has; towers for others are not built.
        """
        encoder = registry.build("encoders", config["encoder"])
        modality = getattr(encoder, "modality", "touch")
        if modality != "touch":
            name = config["encoder"]["name"]
            raise ConfigError(f"encoder={name} encodes {modality}, not touch")
        heads, objectives, weights = {}, {}, {}
        for key, node in config["objective"].items():
            options = dict(node)
            weights[key] = float(options.pop("weight", 1.0))
            objectives[key] = registry.build("objectives", options)
            wanted = registry.context(registry.get("heads", config["head"][key]["name"]))
            towers = {
                f"{kind}_encoder": tower(config, kind)
                if kind in provides and config.get(f"{kind}_encoder")
                else None
                for kind in ("text", "image")
                if f"{kind}_encoder" in wanted
            }
            if towers and not any(towers.values()):
                raise ConfigError(
                    f"head {key!r} has nothing to align with: the data has "
                    f"{', '.join(sorted(provides)) or 'frames only'}; choose text_encoder= or "
                    "image_encoder= for what it has"
                )
            heads[key] = registry.build("heads", config["head"][key], encoder=encoder, **towers)
        augment = config.get("augment")
        return cls(
            encoder,
            heads,
            objectives,
            weights,
            config["curriculum"],
            config["optim"],
            Augment(**augment) if augment else None,
            config["seed"],
        )

    def setup(self, stage: str) -> None:
        """Reads the curriculum, once the length of the run is known."""
        total = self.total = int(self.trainer.estimated_stepping_batches)
        epochs = self.trainer.max_epochs or -1
        epoch = max(1, total // epochs) if epochs > 0 else total
        self.plan = from_config(self.curriculum_config, self.weights, total, epoch)

    def current_weights(self) -> dict[str, float]:
        """Weights of the objectives at this step."""
        if self.plan is None:
            raise TactileForgeError("the curriculum is known once training starts")
        return self.plan.weights(self.global_step)

    def losses(
        self, batch: Batch, weights: Mapping[str, float], universal: float = 0.0
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """The weighted loss, and what to log: each objective's loss and its further scalars.

        Args:
            batch: See `tactileforge.contracts`, on this module's device.
            weights: Objectives that are absent or have weight 0 are not computed.
            universal: Chance of the universal sensor tokens.
        """
        views = self.encoder.views(batch, universal)
        total = torch.zeros((), device=self.device)
        logs: dict[str, Tensor] = {}
        for key, objective in self.objectives.items():
            if not weights.get(key):
                continue
            loss, extra = objective(self.heads[key](views, batch), batch)
            total = total + weights[key] * loss
            logs[key] = loss.detach()
            logs |= {f"{key}/{name}": value for name, value in extra.items()}
        return total, logs

    def on_before_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Host side: flips are drawn, labels and captions follow."""
        if self.trainer.training:
            self._reseed(self._batch_number() + 1, self.global_rank + 1)
            if self.augment:
                batch = self.augment.labels(batch)
        fill_captions(batch)
        self.skip(batch["skipped"])
        return batch

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """One step of all objectives whose weight is above 0."""
        if self.augment:
            batch = self.augment(batch)
        self._reseed(self._batch_number(), 0)
        assert self.plan is not None
        weights = self.current_weights()
        universal = self.plan.universal(self.global_step)
        total, logs = self.losses(batch, weights, universal)
        if not total.requires_grad:  # every objective is still asleep
            raise ConfigError(
                f"no objective has a weight above 0 at step {self.global_step}; let one start at 0"
            )
        if (self.global_step + 1) % log_interval(self.trainer) == 0:
            self._log_step(total.detach(), logs, weights, universal)
        return total

    def on_train_start(self) -> None:
        """What follows the encoder starts equal to it."""
        if self.global_step == 0:
            self._follow(0)

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        """One step of the optimiser; what follows the encoder goes along."""
        super().optimizer_step(*args, **kwargs)
        self._follow(self.global_step + 1)

    def _follow(self, step: int) -> None:
        for part in (*self.heads.values(), *self.objectives.values()):
            if isinstance(part, Follower):
                part.follow(self.encoder, step, self.total)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Losses on held-out clips, with the same masks each time."""
        self._reseed(batch_idx, -1)
        weights = self.current_weights()
        if not bool((batch["group"] >= 0).any()):
            paired = [k for k, v in self.objectives.items() if getattr(v, "pairs", False)]
            weights |= dict.fromkeys(paired, 0.0)
        _, logs = self.losses(batch, weights)
        size = len(batch["frames"])
        self.log_dict({f"val/{k}": v for k, v in logs.items()}, batch_size=size, on_epoch=True)

    def configure_optimizers(self) -> Any:
        """AdamW without decay of vectors; linear warm-up, then linear decay to 0."""
        matrices: list[nn.Parameter] = []
        vectors: list[nn.Parameter] = []
        for parameter in self.parameters():
            if parameter.requires_grad:
                (matrices if parameter.ndim > 1 else vectors).append(parameter)
        optimizer = torch.optim.AdamW(
            [
                {"params": matrices, "weight_decay": self.optim["weight_decay"]},
                {"params": vectors, "weight_decay": 0.0},
            ],
            lr=self.optim["lr"],
            betas=tuple(self.optim["betas"]),
        )
        total = int(self.trainer.estimated_stepping_batches)
        warm = max(1, round(self.optim["warmup"] * total))
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimizer,
            lambda step: min((step + 1) / warm, (total - step) / max(1, total - warm + 1)),
        )
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": schedule, "interval": "step"},
        }

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keeps what was skipped, for the report of a resumed run."""
        checkpoint["skipped"] = dict(self.skipped)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """See `on_save_checkpoint`."""
        self.skipped = dict(checkpoint["skipped"])

    def skip(self, found: Mapping[str, tuple[str, int]]) -> None:
        """Notes what could not be read.

        Args:
            found: Like `skipped`.

        Raises:
            DataError: More is lost than `allowed`; lists it.
        """
        for name, (line, count) in found.items():
            if name not in self.skipped:
                self.skipped[name] = line, count
                log.warning("skipped: %s", line)
        lost = sum(count for _, count in self.skipped.values())
        if found and self.allowed is not None and lost > self.allowed:
            listed = "\n  ".join(line for line, _ in self.skipped.values())
            raise DataError(
                f"{lost} recordings cannot be read, and data.max_bad allows {self.allowed}; mend "
                f"them, or raise data.max_bad:\n  {listed}"
            )

    def _batch_number(self) -> int:
        return self.trainer.fit_loop.total_batch_idx

    def _reseed(self, number: int, stream: int) -> None:
        entropy = [self.seed, number + 1, stream + 1]
        state = np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0]
        torch.manual_seed(int(state >> np.uint64(1)))

    def _log_step(
        self,
        total: Tensor,
        logs: Mapping[str, Tensor],
        weights: Mapping[str, float],
        universal: float,
    ) -> None:
        if not torch.isfinite(total):
            bad = [key for key, value in logs.items() if not torch.isfinite(value)]
            raise TactileForgeError(
                f"the loss is not finite at step {self.global_step} ({', '.join(bad)}); lower "
                "optim.lr, or train with trainer.precision=32"
            )
        optimizer: Any = self.optimizers()
        row = {f"train/{key}": value for key, value in logs.items()} | {"train/loss": total}
        self.log_dict(row)
        settings = {f"weight/{key}": value for key, value in weights.items()}
        settings |= {"universal": universal, "lr": float(optimizer.param_groups[0]["lr"])}
        self.log_dict(settings)


def log_interval(trainer: L.Trainer) -> int:
    """Steps between two logged ones."""
    every: int = trainer.log_every_n_steps  # type: ignore[attr-defined]
    return every


def tower(config: Mapping[str, Any], kind: str) -> nn.Module:
    """Builds the tower for ``text`` or ``image``.

    Raises:
        ConfigError: The plugin chosen encodes something else.
    """
    node = config[f"{kind}_encoder"]
    built: nn.Module = registry.build("encoders", node)
    modality = getattr(built, "modality", "touch")
    if modality != kind:
        raise ConfigError(f"{kind}_encoder={node['name']} encodes {modality}, not {kind}")
    return built
