"""The Lightning module: an encoder, heads and objectives under a curriculum."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import lightning as L
import torch
from torch import Tensor, nn

from tactileforge.contracts import AfterStep, Batch, Prepared, Ramped, Scored, Views
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.encoders.views import views_of
from tactileforge.errors import ConfigError, PluginError
from tactileforge.plugins import moves, registry
from tactileforge.runs.checkpoint_file import find_checkpoint
from tactileforge.training import balance as balances
from tactileforge.training.callbacks import TOTAL
from tactileforge.training.curriculum import Curriculum, from_config, without_waiting
from tactileforge.training.finite import FiniteWatch, NotFiniteError
from tactileforge.training.optim import build_optimizer, set_rate
from tactileforge.training.parts import (
    Term,
    build_parts,
    changing,
    check_scalars,
    logs_of,
    plain,
    term_of,
)
from tactileforge.training.strategies import shard
from tactileforge.util.distributed import alone, mean_over_ranks, seed_step, sum_over_ranks
from tactileforge.util.means import Mean

if TYPE_CHECKING:
    from tactileforge.data.batches.clips import Clips

#: Keys of a configuration that a module is built from.
_KEPT = (
    *("encoder", "head", "objective", "text_encoder", "image_encoder", "curriculum", "optim"),
    *("seed", "balance", "freeze", "columns", "facts"),
)


class TouchModule(L.LightningModule):
    """Trains an encoder with several objectives at once.

    A step asks the encoder for at most one pass of each view, however many objectives there are. An
    objective whose weight is 0 is not computed, nor a view that only it needs. All randomness of a
    step is a function of (seed, batch number, rank): a resumed run continues exactly as it would
    have without the stop.

    Args:
        encoder: A touch encoder.
        heads: Head of each objective, by the name of the objective.
        objectives: Objectives by name.
        weights: Largest weight of each objective.
        curriculum: Configuration of the curriculum; see `curriculum.from_config`.
        optim: Configuration of the optimiser; see `optim.parse_optim`.
        augment: Module that changes a batch on the device; None for no augmentation.
        seed: Seed of the run.
        balance: Configuration of the balance; see `balance.build_balance`. None leaves weights
            unchanged.
        freeze: Whether the encoder is frozen, in evaluation mode.
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
        #: Sums of the validation so far: of scores; and (2,) of loss times labels, and of labels.
        self._sums: dict[str, Tensor] = {}
        self._losses: dict[str, Tensor] = {}
        #: Objectives without a label in the last logged step.
        self.unlabelled: list[str] = []
        self._sharded = False
        #: Numbers changed by the curriculum, by place: the part, and the name of its attribute.
        self._changing: dict[str, tuple[Any, str]] = {}
        self.finite = FiniteWatch(list(objectives))
        #: Objectives whose first term had the shapes of the contract.
        self._seen: set[str] = set()

    @classmethod
    def from_config(
        cls,
        config: Mapping[str, Any],
        provides: AbstractSet[str],
        augment: nn.Module | None = None,
    ) -> Self:
        """Builds every part from a finished configuration (see `tactileforge.compose`).

        Its part for the module, and the labels, are the module's ``hparams``.

        Args:
            config: Finished configuration, with the encoder of `build_data`.
            provides: Labels of the data; towers for other labels are not built.
            augment: Module that changes a batch on the device; None for no augmentation.
        """
        config = plain(config)
        encoder, heads, objectives = build_parts(config, provides)
        weights = {k: float(node.get("weight", 1.0)) for k, node in config["objective"].items()}
        module = cls(
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
        kept = {key: config[key] for key in _KEPT if key in config}
        # loggers of a run of ours log the whole configuration
        module.save_hyperparameters({"config": kept, "provides": sorted(provides)}, logger=False)
        return module

    @classmethod
    def load_from_checkpoint(  # type: ignore[override]
        cls,
        checkpoint_path: str | Path,
        map_location: Any = None,
        hparams_file: Any = None,
        strict: bool | None = None,
        weights_only: bool | None = None,
        classes: Mapping[str, Any] | None = None,
        **parts: Any,
    ) -> Self:
        """Builds the module of a checkpoint, with its weights; nothing in the file is executed.

        Args:
            checkpoint_path: Checkpoint of a run, or its folder, or a checkpoint of one's own
                `lightning.Trainer`.
            map_location: Device of the weights; None for the CPU.
            hparams_file: Not used: the configuration is in the checkpoint.
            strict: Whether all weights have to fit; None for True.
            weights_only: Not used: a checkpoint is always read without executing code.
            classes: Classes of your own by the names that the checkpoint has for them, such as
                ``{"my_module:Contrast": Contrast}``.
            parts: Arguments of the constructor, for a module built by hand.

        Raises:
            DataNotFoundError: No checkpoint is there.
            ConfigError: The file is not a checkpoint of a `TouchModule`, or its module was built by
                hand and ``parts`` are missing.
            PluginError: A part is a local class that was neither typed nor registered.
        """
        for name, given in (classes or {}).items():
            registry.give(name, given)
        path = find_checkpoint(checkpoint_path)
        try:
            state = torch.load(path, map_location or "cpu", weights_only=True)
        except Exception as error:  # of damaged bytes it is of any kind
            raise ConfigError(
                f"{path}: not a checkpoint: damaged, or something else; a model in one file is "
                f"read by tactileforge.load({str(path)!r})"
            ) from error
        if not isinstance(state, dict) or "state_dict" not in state:
            raise ConfigError(f"{checkpoint_path}: no checkpoint of Lightning")
        built = state.get("hyper_parameters") or {}
        if not parts and not built:
            raise ConfigError(
                f"{checkpoint_path}: its module was built by hand; give its parts again: "
                "TouchModule.load_from_checkpoint(path, encoder=..., heads=..., objectives=..., "
                "weights=..., curriculum=..., optim=...)"
            )
        if not parts and not {"config", "provides"} <= {*built}:
            raise ConfigError(
                f"{path}: a checkpoint of another LightningModule: its own class loads it"
            )
        module = (
            cls(**parts)
            if parts
            else cls.from_config(built["config"], frozenset(built["provides"]))
        )
        module.load_state_dict(state["state_dict"], strict=strict is not False)
        return module

    def train(self, mode: bool = True) -> Self:
        """Sets the mode; a frozen encoder stays in evaluation mode."""
        super().train(mode)
        if self.freeze_encoder:
            self.encoder.eval()
        return self

    def configure_model(self) -> None:
        """Shards the parameters, if the strategy asks for it (`strategies.Sharded`)."""
        if self.device_mesh is not None and not self._sharded:
            shard(self, self.device_mesh)
            self._sharded = True

    def setup(self, stage: str) -> None:
        """Reads the curriculum, once the length of the run is known.

        A run shorter than the logging interval logs its last step, and an epoch shorter than the
        validation interval is validated at its end.
        """
        every = self.trainer.val_check_interval
        if isinstance(every, int) and self.trainer.check_val_every_n_epoch is not None:
            self.trainer.val_check_interval = int(min(every, _epoch_batches(self.trainer)))
        total = self.total = int(self.trainer.estimated_stepping_batches)
        trainer: Any = self.trainer
        trainer.log_every_n_steps = max(1, min(log_interval(trainer), total))
        batches = _epoch_batches(self.trainer) / self.trainer.accumulate_grad_batches
        self.epoch_steps = max(1, math.ceil(batches)) if math.isfinite(batches) else total
        own = {k: x.ramp for k, x in self.objectives.items() if isinstance(x, Ramped)}
        config = without_waiting(self.curriculum_config, self.weights)
        self.plan = from_config(config, self.weights, total, self.epoch_steps, own)
        parts = {"encoder": self.encoder}
        parts |= {f"head.{key}": head for key, head in self.heads.items()}
        parts |= {f"objective.{key}": objective for key, objective in self.objectives.items()}
        self._changing = {place: changing(place, parts) for place in self.plan.values}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Adds the steps of the run and of an epoch, the number of processes, and scores.

        Raises:
            NotFiniteError: A weight is not finite: the file would replace a good checkpoint.
        """
        self.finite.check(self, self.trainer.optimizers, self.global_step)
        checkpoint["total"], checkpoint["epoch_steps"] = self.total, self.epoch_steps
        checkpoint["processes"] = self.trainer.world_size
        logged = self.trainer.callback_metrics
        checkpoint["scores"] = {k: float(v) for k, v in logged.items() if k.startswith("val/")}

    def current_weights(self) -> dict[str, float]:
        """Weights of the objectives at this step; the largest ones before a trainer is there."""
        return dict(self.weights) if self.plan is None else self.plan.weights(self.global_step)

    def prepare(self, clips: Clips) -> None:
        """Lets heads and objectives measure the training data, before the first step of a run."""
        for part in (*self.heads.values(), *self.objectives.values()):
            if isinstance(part, Prepared):
                part.prepare(clips)

    def terms(
        self, batch: Batch, weights: Mapping[str, float], universal: float = 0.0
    ) -> dict[str, Term]:
        """Computes the term of each objective on a batch.

        Args:
            batch: Batch on this module's device; see `tactileforge.contracts`.
            weights: Weight of each objective; those absent or 0 are not computed.
            universal: Chance of the universal sensor tokens, 0 to 1.
        """
        awake = [key for key in self.objectives if weights.get(key)]
        views = self._views(batch, awake, universal)
        return {key: self._term(key, views, batch) for key in awake}

    def _views(self, batch: Batch, awake: Sequence[str], universal: float) -> Views:
        reads = {view for key in awake for view in getattr(self.heads[key], "reads", ())}
        # each measured gradient of one objective would pass through both views
        measured = self.balance.every and torch.is_grad_enabled()
        return views_of(self.encoder, batch, universal, set() if measured else reads)

    def _term(self, key: str, views: Any, batch: Batch) -> Term:
        with moves.explained(self.heads[key], self.objectives[key]):
            prediction = self.heads[key](views, batch)
            term = term_of(key, self.objectives[key], prediction, batch)
        if key not in self._seen:  # shapes are those of its class, not of a batch
            check_scalars(key, term)
            self._seen.add(key)
        return term

    def losses(
        self, batch: Batch, weights: Mapping[str, float], universal: float = 0.0
    ) -> tuple[Tensor, dict[str, Mean]]:
        """The weighted loss; and for the log, each objective's loss and further scalars.

        Args:
            batch: Batch on this module's device; see `tactileforge.contracts`.
            weights: Weight of each objective; those absent or 0 are not computed.
            universal: Chance of the universal sensor tokens, 0 to 1.
        """
        terms = self.terms(batch, weights, universal)
        losses = {key: term.loss.value for key, term in terms.items()}
        return balances.weighted_sum(losses, weights, self.device), logs_of(terms)

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Weighted loss of one batch, over all objectives with a weight above 0.

        In a loop of one's own, without a trainer, ``batch_idx`` is the number of the batch in the
        run, weights are the largest of the curriculum, and nothing is logged.
        """
        if self.augment:
            batch = self.augment(batch)
        if self._trainer is None:
            seed_step(self.seed, batch_idx, 0)
            return self.losses(batch, self.current_weights())[0]
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
        if not total.requires_grad:
            if cut := [key for key in losses if weights.get(key)]:
                raise PluginError(
                    f"the loss of {' and '.join(map(repr, cut))} has no gradient: it is made of "
                    "constants, or of what was detached or computed without torch"
                )
            # every objective still has weight 0
            raise ConfigError(
                f"no objective has a weight above 0 at step {self.global_step}: the curriculum "
                "starts them later. Add objective=pixel, or give curriculum=constant"
            )
        if (self.global_step + 1) % log_interval(self.trainer) == 0:
            self._log_step(total.detach(), logs_of(terms), weights, universal)
        return total

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Sets Lightning's counter of logged steps to the optimiser step."""
        # in a run that was made longer Lightning counts one step too many; it has no public setter
        loop: Any = self.trainer.fit_loop.epoch_loop
        loop._batches_that_stepped = self.global_step

    def on_train_start(self) -> None:
        """Initialises the EMA copies of a new run, and sets the learning rate of this step."""
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

        Every process computes all of them, so that the result is the same with any number of
        processes.
        """
        # a stream of its own: training draws the same with any number of validations
        seed_step(self.seed, batch_idx, -1)
        weights = self.current_weights()
        if not batch.get("paired", True):
            paired = [k for k, v in self.objectives.items() if getattr(v, "pairs", False)]
            weights |= dict.fromkeys(paired, 0.0)
        with alone():
            for key, term in self.terms(batch, weights).items():
                self._add_loss(key, term, batch)

    def _add_loss(self, key: str, term: Term, batch: Batch) -> None:
        """Adds a batch to the means over the split; clips without a label do not count."""
        logs = logs_of({key: term})
        if isinstance(objective := self.objectives[key], Scored):
            sums = objective.sums(term.prediction, batch)
            self._sums[key] = self._sums[key] + sums if key in self._sums else sums
            logs = {key: logs[key]}  # its scores are computed from the whole split
        for name, mean in logs.items():
            # without labels the value has no meaning, and 0 times NaN would be NaN
            weighed = torch.where(mean.count > 0, mean.value * mean.count, 0.0)
            row = torch.stack([weighed, mean.count]).float()
            self._losses[name] = self._losses[name] + row if name in self._losses else row

    def on_validation_epoch_end(self) -> None:
        """Logs losses and scores of the whole split over all ranks, but none without labels."""
        if self._losses:
            rows = sum_over_ranks(torch.stack(list(self._losses.values()))).tolist()
            named = zip(self._losses, rows, strict=True)
            means = {f"val/{name}": row[0] / row[1] for name, row in named if row[1]}
            self.log_dict(means)
            losses = [means[name] for key in self.objectives if (name := f"val/{key}") in means]
            if losses and self._trainer is not None:
                self.log(TOTAL, sum(losses), logger=False)  # for callbacks that monitor it
        self._losses = {}
        for key, sums in self._sums.items():
            objective: Any = self.objectives[key]
            scores: dict[str, float] = objective.scores(sums)  # every rank has the whole split
            self.log_dict({f"val/{key}/{name}": value for name, value in scores.items()})
        self._sums = {}

    def configure_optimizers(self) -> Any:
        """Builds the optimiser and its schedule; see `optim.build_optimizer`."""
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
        """Clips the gradient; Lightning itself refuses to with a fused optimiser."""
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
        kept: Any = self.trainer._results  # else Lightning shows values of an older step
        for name in [name for name in kept or () if name.startswith("training_step.train/")]:
            if name.removeprefix("training_step.") not in row:
                del kept[name]
        self.log_dict(row)
        self.log_dict(self.balance.logs(weights))
        self.log_dict({place: getattr(*owner) for place, owner in self._changing.items()})
        self.log_dict({"universal": universal, "lr": float(optimizer.param_groups[0]["lr"])})

    def _shared(self, means: Mapping[str, Mean], total: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Averages logged values and the loss over ranks, in one message.

        The value of a rank is its share of the joint mean. Values without a label on any rank are
        left out.
        """
        *values, total = mean_over_ranks(
            torch.stack([*(mean.value for mean in means.values()), total])
        ).unbind()
        counts = torch.stack([mean.count for mean in means.values()]).tolist()
        rows = zip(means, values, counts, strict=True)
        return {name: value for name, value, count in rows if count}, total


def _epoch_batches(trainer: L.Trainer) -> float:
    """Batches of an epoch; infinite if the data does not state it."""
    data = getattr(trainer, "datamodule", None)
    if math.isfinite(trainer.num_training_batches) or not isinstance(data, TouchData):
        return float(trainer.num_training_batches)
    # in a run that ends by steps, Lightning has not read the length of the data yet
    accumulate = trainer.accumulate_grad_batches
    return len(data.stream(trainer.global_rank, trainer.world_size, accumulate))


def log_interval(trainer: L.Trainer) -> int:
    """Steps between two logged ones."""
    every: int = trainer.log_every_n_steps  # type: ignore[attr-defined]
    return every
