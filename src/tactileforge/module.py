"""The Lightning module: an encoder, heads and objectives under a curriculum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import TYPE_CHECKING, Any, Self

import lightning as L
import torch
from torch import Tensor, nn

from tactileforge import balance as balances
from tactileforge import moves
from tactileforge.contracts import AfterStep, Batch, Prepared, Scored
from tactileforge.curriculum import Curriculum, from_config
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.distributed import alone, mean_over_ranks, seed_step, sum_over_ranks
from tactileforge.encoders.given import views_of
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.finite import FiniteWatch, NotFiniteError
from tactileforge.means import Mean
from tactileforge.optim import build_optimizer, set_rate
from tactileforge.parts import Term, build_parts, changing, logs_of, term_of
from tactileforge.strategies import shard

if TYPE_CHECKING:
    from tactileforge.data.batches.clips import Clips


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
        optim: See `optim.parse_optim`.
        augment: Changes a batch on the device, or None.
        seed: Seed of the run.
        balance: See `balance.build_balance`; None leaves weights as they are.
        freeze: Whether the encoder stays as it is, in evaluation mode.
    """

    def __init__(
        self,
        encoder: nn.Module,
        heads: Mapping[str, nn.Module],
        objectives: Mapping[str, nn.Module],
        weights: Mapping[str, float],
        curriculum: Mapping[str, Any],
        optim: Mapping[str, Any],
        augment: nn.Module | None = None,
        seed: int = 0,
        balance: Mapping[str, Any] | None = None,
        freeze: bool = False,
    ) -> None:
        super().__init__()
        self.encoder: Any = encoder
        self.freeze_encoder = freeze
        if freeze:
            encoder.requires_grad_(False).eval()
        self.heads = nn.ModuleDict(heads)
        self.objectives = nn.ModuleDict(objectives)
        self.weights = dict(weights)
        self.balance = balances.build_balance(balance, list(objectives))
        self.curriculum_config = dict(curriculum)
        self.optim = dict(optim)
        self.augment = augment
        self.seed = seed
        self.plan: Curriculum | None = None
        self.total = self.epoch_steps = 0
        #: Of validation: sums of scores; and of losses times labels, beside the labels.
        self._sums: dict[str, Tensor] = {}
        self._losses: dict[str, Tensor] = {}
        #: Objectives that met no label in the last step that was logged.
        self.unlabelled: list[str] = []
        self._sharded = False
        #: Parts, and the names of their numbers that the curriculum changes.
        self._changing: dict[str, tuple[Any, str]] = {}
        self.finite = FiniteWatch(list(objectives))

    @classmethod
    def from_config(
        cls,
        config: Mapping[str, Any],
        provides: AbstractSet[str],
        augment: nn.Module | None = None,
    ) -> TouchModule:
        """Builds every part from a finished configuration (see `compose.finish`).

        Args:
            config: Plain data.
            provides: Labels the data has; towers for others are not built.
            augment: Changes a batch on the device, or None.
        """
        encoder, heads, objectives = build_parts(config, provides)
        weights = {k: float(node.get("weight", 1.0)) for k, node in config["objective"].items()}
        return cls(
            encoder,
            heads,
            objectives,
            weights,
            config["curriculum"],
            config["optim"],
            augment,
            config["seed"],
            config.get("balance"),
            bool(config.get("freeze")),
        )

    def train(self, mode: bool = True) -> Self:
        """Sets the mode; a frozen encoder stays in evaluation mode."""
        super().train(mode)
        if self.freeze_encoder:
            self.encoder.eval()
        return self

    def configure_model(self) -> None:
        """Shards the parameters, where the strategy says so (`strategies.Sharded`)."""
        if self.device_mesh is not None and not self._sharded:
            shard(self, self.device_mesh)
            self._sharded = True

    def setup(self, stage: str) -> None:
        """Reads the curriculum, once the length of the run is known.

        A run that is shorter than the interval between logged steps logs its last one, and an epoch
        that is shorter than that between validations is validated at its end.
        """
        every = self.trainer.val_check_interval
        if isinstance(every, int) and self.trainer.check_val_every_n_epoch is not None:
            self.trainer.val_check_interval = int(min(every, _epoch_batches(self.trainer)))
        total = self.total = int(self.trainer.estimated_stepping_batches)
        trainer: Any = self.trainer
        trainer.log_every_n_steps = max(1, min(log_interval(trainer), total))
        batches = _epoch_batches(self.trainer) / self.trainer.accumulate_grad_batches
        self.epoch_steps = max(1, math.ceil(batches)) if math.isfinite(batches) else total
        self.plan = from_config(self.curriculum_config, self.weights, total, self.epoch_steps)
        self._changing = {place: changing(place, self._parts()) for place in self.plan.values}

    def _parts(self) -> dict[str, Any]:
        """Parts by their place in the configuration."""
        heads = {f"head.{key}": head for key, head in self.heads.items()}
        return {"encoder": self.encoder, **heads} | {
            f"objective.{key}": objective for key, objective in self.objectives.items()
        }

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keeps the length of the run and of its epochs in steps, processes, and scores.

        Raises:
            NotFiniteError: A weight is not finite: it would take the place of one that is.
        """
        self.finite.check(self, self.trainer.optimizers, self.global_step)
        checkpoint["total"], checkpoint["epoch_steps"] = self.total, self.epoch_steps
        checkpoint["processes"] = self.trainer.world_size
        logged = self.trainer.callback_metrics
        checkpoint["scores"] = {k: float(v) for k, v in logged.items() if k.startswith("val/")}

    def current_weights(self) -> dict[str, float]:
        """Weights of the objectives at this step."""
        if self.plan is None:
            raise TactileForgeError("the curriculum is known once training starts")
        return self.plan.weights(self.global_step)

    def prepare(self, clips: Clips) -> None:
        """Lets heads and objectives measure the training data, before a new run's first step."""
        for part in (*self.heads.values(), *self.objectives.values()):
            if isinstance(part, Prepared):
                part.prepare(clips)

    def terms(
        self, batch: Batch, weights: Mapping[str, float], universal: float = 0.0
    ) -> dict[str, Term]:
        """Computes the term of each objective on a batch.

        Args:
            batch: See `tactileforge.contracts`, on this module's device.
            weights: Objectives that are absent or have weight 0 are not computed.
            universal: Chance of the universal sensor tokens.
        """
        views = views_of(self.encoder, batch, universal)
        return {key: self._term(key, views, batch) for key in self.objectives if weights.get(key)}

    def _term(self, key: str, views: Any, batch: Batch) -> Term:
        with moves.explained(self.heads[key], self.objectives[key]):
            prediction = self.heads[key](views, batch)
            return term_of(key, self.objectives[key], prediction, batch)

    def losses(
        self, batch: Batch, weights: Mapping[str, float], universal: float = 0.0
    ) -> tuple[Tensor, dict[str, Mean]]:
        """The weighted loss, and what to log: each objective's loss and its further scalars.

        Args:
            batch: See `terms`.
            weights: See `terms`.
            universal: See `terms`.
        """
        terms = self.terms(batch, weights, universal)
        total = torch.zeros((), device=self.device)
        for key, term in terms.items():
            total = total + weights[key] * term.loss.value
        return total, logs_of(terms)

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """One step of all objectives whose weight is above 0."""
        if self.augment:
            batch = self.augment(batch)
        seed_step(self.seed, self.trainer.fit_loop.total_batch_idx, 0)
        assert self.plan is not None
        for place, (part, name) in self._changing.items():
            setattr(part, name, self.plan.values[place](self.global_step))
        weights = self.current_weights()
        universal = self.plan.universal(self.global_step)
        terms = self.terms(batch, weights, universal)
        losses = {key: term.loss.value for key, term in terms.items()}
        self.finite.note(losses, self.global_step)
        total: Tensor = self.balance(losses, weights, self.global_step, self.encoder)
        if not total.requires_grad:  # every objective is still asleep
            raise ConfigError(
                f"no objective has a weight above 0 at step {self.global_step}; let one start at 0"
            )
        if (self.global_step + 1) % log_interval(self.trainer) == 0:
            self._log_step(total.detach(), logs_of(terms), weights, universal)
        return total

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Metrics are logged by the step; of a run made longer, Lightning counts one too many."""
        loop: Any = self.trainer.fit_loop.epoch_loop
        loop._batches_that_stepped = self.global_step

    def on_train_start(self) -> None:
        """Initialises the EMA copies with the encoder's weights; takes the rate of this step."""
        if self.global_step == 0:
            self._follow(0)
        self.finite.start(self)
        optimizer: Any = self.optimizers()
        for group in optimizer.param_groups:
            if "fused" in group:
                group["fused"] = self._is_fused()  # a resumed run may have another precision
        schedule: Any = self.lr_schedulers()
        set_rate(schedule)  # a resumed run may have another length

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        """Takes one optimiser step, then updates the EMA copies."""
        super().optimizer_step(*args, **kwargs)
        self._follow(self.global_step + 1)

    def _follow(self, step: int) -> None:
        for part in (*self.heads.values(), *self.objectives.values()):
            if isinstance(part, AfterStep):
                part.after_step(self.encoder, step, self.total)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Sums up losses on held-out clips, with the same masks each time.

        Every process has all of them, so that it is the same with any number of processes.
        """
        seed_step(self.seed, batch_idx, -1)
        weights = self.current_weights()
        if not batch.get("paired", True):
            paired = [k for k, v in self.objectives.items() if getattr(v, "pairs", False)]
            weights |= dict.fromkeys(paired, 0.0)
        with alone():
            views = views_of(self.encoder, batch, 0.0)
            for key in self.objectives:
                if weights.get(key):
                    self._add_loss(key, self._term(key, views, batch), batch)

    def _add_loss(self, key: str, term: Term, batch: Batch) -> None:
        """Adds to the means over the split, in which a clip without a label has no part."""
        logs = logs_of({key: term})
        if isinstance(objective := self.objectives[key], Scored):
            sums = objective.sums(term.prediction, batch)
            self._sums[key] = self._sums[key] + sums if key in self._sums else sums
            logs = {key: logs[key]}  # its scores are those of the whole split
        for name, mean in logs.items():
            weighed = torch.where(mean.count > 0, mean.value * mean.count, 0.0)
            row = torch.stack([weighed, mean.count]).float()
            self._losses[name] = self._losses[name] + row if name in self._losses else row

    def on_validation_epoch_end(self) -> None:
        """Losses and scores of the whole split, over all ranks; none where nothing is labelled."""
        if self._losses:
            rows = sum_over_ranks(torch.stack(list(self._losses.values()))).tolist()
            named = zip(self._losses, rows, strict=True)
            self.log_dict({f"val/{name}": row[0] / row[1] for name, row in named if row[1]})
        self._losses = {}
        for key, sums in self._sums.items():
            objective: Any = self.objectives[key]
            scores: dict[str, float] = objective.scores(sum_over_ranks(sums))
            self.log_dict({f"val/{key}/{name}": value for name, value in scores.items()})
        self._sums = {}

    def configure_optimizers(self) -> Any:
        """See `optim.build_optimizer`."""
        total = int(self.trainer.estimated_stepping_batches)
        return build_optimizer(self.named_parameters(), self.optim, total, self._is_fused())

    def _is_fused(self) -> bool:
        return self.trainer.precision not in ("16", "16-mixed", "16-true")

    def configure_gradient_clipping(
        self,
        optimizer: Any,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clips the gradient; Lightning itself refuses to where the optimiser is fused."""
        if gradient_clip_val is not None and gradient_clip_algorithm == "value":
            nn.utils.clip_grad_value_(self.parameters(), gradient_clip_val)
        elif gradient_clip_val is not None:
            nn.utils.clip_grad_norm_(self.parameters(), gradient_clip_val)

    def _log_step(
        self,
        total: Tensor,
        means: Mapping[str, Mean],
        weights: Mapping[str, float],
        universal: float,
    ) -> None:
        logs, total = self._shared(means, total)
        if not torch.isfinite(total):
            raise NotFiniteError(f"step {self.global_step}{self.finite.began()}")
        self.unlabelled = [key for key in self.objectives if key in means and key not in logs]
        optimizer: Any = self.optimizers()
        row = {f"train/{key}": value for key, value in logs.items()} | {"train/loss": total}
        kept: Any = self.trainer._results  # Lightning would show the values of an older step
        for name in [name for name in kept or () if name.startswith("training_step.train/")]:
            if name.removeprefix("training_step.") not in row:
                del kept[name]
        self.log_dict(row)
        self.log_dict(self.balance.logs(weights))
        self.log_dict({place: getattr(*owner) for place, owner in self._changing.items()})
        self.log_dict({"universal": universal, "lr": float(optimizer.param_groups[0]["lr"])})

    def _shared(self, means: Mapping[str, Mean], total: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Means over ranks, of which each has its share of the joint loss; one message.

        What no rank has a label for is left out.
        """
        *values, total = mean_over_ranks(
            torch.stack([*(mean.value for mean in means.values()), total])
        ).unbind()
        counts = torch.stack([mean.count for mean in means.values()]).tolist()
        rows = zip(means, values, counts, strict=True)
        return {name: value for name, value, count in rows if count}, total


def _epoch_batches(trainer: L.Trainer) -> float:
    """Batches of an epoch; infinite where the data does not tell."""
    data = getattr(trainer, "datamodule", None)
    if math.isfinite(trainer.num_training_batches) or not isinstance(data, TouchData):
        return float(trainer.num_training_batches)
    # of a run that ends by its steps Lightning has not looked at the data yet
    accumulate = trainer.accumulate_grad_batches
    return len(data.stream(trainer.global_rank, trainer.world_size, accumulate))


def log_interval(trainer: L.Trainer) -> int:
    """Number of steps between logged ones."""
    every: int = trainer.log_every_n_steps  # type: ignore[attr-defined]
    return every
