"""Strategies for several processes: DDP with one static graph per phase, and FSDP2."""

from __future__ import annotations

import gc
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from lightning.pytorch.strategies import DDPStrategy, ModelParallelStrategy, Strategy
from torch import Tensor, nn

from tactileforge.encoders.transformer import Block
from tactileforge.errors import ConfigError
from tactileforge.util.distributed import sum_over_ranks, world

if TYPE_CHECKING:
    from torch.distributed.device_mesh import DeviceMesh


class PhasedDDP(DDPStrategy):
    """DDP with a static graph, recorded anew in the first step of each phase.

    A phase is the steps with the same objectives of non-zero weight. No step searches for unused
    parameters, and gradients are sent while others are still computed.
    """

    def __init__(self) -> None:
        super().__init__(static_graph=True)
        self._phase: frozenset[str] | None = None

    def training_step(self, *args: Any, **kwargs: Any) -> Any:
        """Takes a step; the first of a phase starts with a new graph."""
        # torch fixes a static graph in the first step of its DDP wrapper, and a new phase uses
        # other parameters: only a new wrapper can record them. The plain way, a search for unused
        # parameters, adds 21 ms to a step of 54 ms, not 17 ms (benchmarks/processes.py)
        module: Any = self.lightning_module
        phase = frozenset(key for key, weight in module.current_weights().items() if weight)
        if self._phase not in (None, phase):
            self.model = None
            gc.collect()  # frees the old wrapper's hooks on the parameters before new ones are set
            self.model = self._setup_model(module)
            self._register_ddp_hooks()
        self._phase = phase
        return super().training_step(*args, **kwargs)


class ShardedStrategy(ModelParallelStrategy):
    """FSDP2 over all processes: each keeps its share of weights, gradients and AdamW's averages.

    Checkpoints are whole, as those of a single process, and can be read by any number of processes.
    """

    def __init__(self) -> None:
        super().__init__(tensor_parallel_size=1, save_distributed_checkpoint=False)

    def setup_environment(self) -> None:
        """Starts the processes, all of them in one data-parallel row."""
        # "auto" counts nodes alone, and processes are known only here; there is no public setter
        self._data_parallel_size = self.num_nodes * self.num_processes
        super().setup_environment()

    def load_checkpoint(
        self, checkpoint_path: str | Path, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Loads weights and optimiser averages of a run of any number of processes.

        Lightning refuses averages without an entry for each parameter, and the parameters of an
        objective still at weight 0 have none.
        """
        from torch.distributed.checkpoint import state_dict as states  # takes a second

        assert self.model is not None
        path = Path(self.broadcast(checkpoint_path))
        checkpoint: dict[str, Any] = self.checkpoint_io.load_checkpoint(path)
        whole = states.StateDictOptions(full_state_dict=True, broadcast_from_rank0=True)
        states.set_model_state_dict(self.model, checkpoint.pop("state_dict"), options=whole)
        states_of = zip(self.optimizers, checkpoint["optimizer_states"], strict=True)
        for optimizer, state in states_of:
            named = _completed(state, self.model)
            states.set_optimizer_state_dict(self.model, optimizer, named, options=whole)
        return checkpoint


def _completed(state: Mapping[str, Any], module: nn.Module) -> dict[str, Any]:
    """AdamW's averages by the names of parameters; 0 for parameters without a gradient so far.

    Args:
        state: State of the optimiser in a checkpoint, whole, with parameters by number.
        module: Sharded module with the parameters.
    """
    from torch.distributed.fsdp import FullyShardedDataParallel, OptimStateKeyType

    named: dict[str, Any] = FullyShardedDataParallel.rekey_optim_state_dict(
        dict(state), OptimStateKeyType.PARAM_NAME, module
    )
    parameters = dict(module.named_parameters())
    for group in named["param_groups"]:
        for name in group["params"]:
            if name not in named["state"]:
                zeros = [torch.zeros(parameters[name].shape) for _ in range(2)]
                fresh = dict(zip(("exp_avg", "exp_avg_sq"), zeros, strict=True))
                named["state"][name] = {"step": torch.zeros(()), **fresh}
    return named


def shard(module: nn.Module, mesh: DeviceMesh) -> None:
    """Shards a module over processes, block by block; in place.

    Args:
        module: Module with ``training_step`` and ``validation_step`` in place of ``forward``.
        mesh: Mesh with a dimension ``data_parallel``.
    """
    from torch.distributed.fsdp import fully_shard, register_fsdp_forward_method  # takes a second

    row = mesh["data_parallel"]
    # blocks before the whole: each becomes a group of its own, gathered just before it is used
    for part in list(module.modules()):
        if isinstance(part, Block):
            fully_shard(part, mesh=row)
    # fully_shard does not take scalars: each process keeps them, and averages their gradients
    scalars = {p for p in module.parameters() if not p.ndim}
    for scalar in scalars:
        scalar.register_post_accumulate_grad_hook(_average)  # type: ignore[no-untyped-call]
    fully_shard(module, mesh=row, ignored_params=scalars)
    # FSDP gathers parameters in hooks of forward, and Lightning calls these methods instead
    for name in ("training_step", "validation_step"):
        register_fsdp_forward_method(module, name)


def _average(parameter: Tensor) -> None:
    """Averages the gradient of a parameter over ranks, to the gradient of the joint batch.

    A part accumulated before is equal on all ranks already, and the average leaves it unchanged.
    """
    assert parameter.grad is not None
    parameter.grad = sum_over_ranks(parameter.grad) / world()[1]


def choose_strategy(
    name: Any, processes: int, static: bool, balance: str | None
) -> str | Strategy | Any:
    """Chooses the strategy of Lightning's trainer for ``trainer.strategy``.

    Args:
        name: ``auto``, ``fsdp2``, or a strategy of Lightning.
        processes: Number of processes.
        static: Whether the encoder uses the same parameters for every batch, and every batch ends
            with a step.
        balance: Name of the balance; None for no balance.

    Raises:
        ConfigError: FSDP2 with a balance, which needs whole gradients.
    """
    if name == "fsdp2":
        if balance not in (None, "none"):
            raise ConfigError(
                f"trainer.strategy=fsdp2 has no whole gradients for balance={balance} to measure; "
                "give balance=none, or trainer.strategy=auto"
            )
        return ShardedStrategy()
    if name != "auto" or processes == 1:
        return name
    return PhasedDDP() if static else "ddp_find_unused_parameters_true"


def check_started(devices: Any) -> None:
    """Checks torchrun's number of processes against ``trainer.devices``.

    Args:
        devices: Value of ``trainer.devices``: a number, or another choice, which is not checked.

    Raises:
        ConfigError: torchrun started another number of processes.
    """
    started = os.environ.get("LOCAL_WORLD_SIZE")
    if started and str(devices).isdecimal() and int(devices) != int(started):
        raise ConfigError(
            f"torchrun started {started} processes on this machine and trainer.devices={devices}; "
            f"give trainer.devices={started}, or torchrun --nproc-per-node={devices}"
        )
