"""Run by test_ddp.py in every process: gradients and losses of the first step, in a
file.

Usage: python ddp_gradients.py OUT [local] [gradnorm]; RANK, WORLD_SIZE, MASTER_ADDR, MASTER_PORT as
torch wants them. With `local` the force objective is wrong on purpose: each rank divides by its own
labels. With `gradnorm` objectives are balanced, and what the balance found is written too.
"""

import os
import sys

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from tactileforge.contracts import Batch
from tactileforge.objectives import force
from tactileforge.testing import batch as make_batch
from tactileforge.training.module import TouchModule
from tactileforge.util.means import Mean

CONFIG = {
    "seed": 0,
    "encoder": {"name": "tactile_vit", "size": "tiny", "image_size": 32},
    "text_encoder": {"name": "byte", "width": 64, "depth": 1, "heads": 2},
    "image_encoder": {"name": "vit", "depth": 1},
    "head": {
        "pixel": {"name": "pixel", "width": 64, "depth": 1, "heads": 2},
        "diff": {"name": "diff", "width": 64, "depth": 1, "heads": 2},
        "align": {"name": "align"},
        "force": {"name": "force"},
        "jepa": {"name": "jepa", "width": 64, "depth": 1, "heads": 2},
        "dino": {"name": "dino", "prototypes": 16, "hidden": 32, "bottleneck": 8},
        "classify": {"name": "classify", "classes": 16},
    },
    "objective": {
        name: {"name": name}
        for name in ("pixel", "diff", "align", "force", "jepa", "dino", "classify")
    },
    "curriculum": {},
    "optim": {},
}


class Losses(nn.Module):
    def __init__(self, module: TouchModule) -> None:
        super().__init__()
        self.module = module

    def forward(self, batch: Batch) -> Tensor:
        weights = dict.fromkeys(self.module.objectives, 1.0)
        terms = self.module.terms(batch, weights, universal=0.5)
        losses = {key: term.loss.value for key, term in terms.items()}
        total: Tensor = self.module.balance(losses, weights, 0, self.module.encoder)
        return total


def local_mean(losses: Tensor, valid: Tensor) -> Mean:
    return Mean(torch.where(valid, losses, 0.0).sum() / valid.sum().clamp(min=1), valid.sum())


def rows_of(batch: Batch, rows: slice) -> Batch:
    return {key: value[rows] for key, value in batch.items()}


def main() -> None:
    rank, world = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
    if "local" in sys.argv[2:]:
        force.masked_mean = local_mean
    config = CONFIG | ({"balance": {"name": "gradnorm"}} if "gradnorm" in sys.argv[2:] else {})
    torch.manual_seed(0)
    module = TouchModule.from_config(config, {"text", "image", "force"})
    batch = make_batch(size=8, frames=4, image=32)
    batch["force_valid"][[3, 5, 6, 7]] = False
    batch["force_valid"][2, :2] = False  # z alone
    batch["text"] = ["a", "b", "", "", "c", "d", "e", ""]
    batch["image_valid"] = torch.tensor([True, False, False, False, True, True, True, True])
    torch.manual_seed(7)
    losses: nn.Module = Losses(module)
    if world > 1:
        dist.init_process_group("gloo", rank=rank, world_size=world)
        losses = DistributedDataParallel(losses, find_unused_parameters=True)
    share = 8 // world
    total = losses(rows_of(batch, slice(rank * share, (rank + 1) * share)))
    total.backward()
    logged, mean = module._shared({"all": Mean(total.detach(), torch.ones(()))}, total.detach())
    if rank == 0:
        grads = {k: p.grad for k, p in module.named_parameters() if p.grad is not None}
        balance = {f"balance.{k}": v for k, v in module.balance.state_dict().items()}
        torch.save(grads | balance | {"logged": logged["all"], "loss": mean}, sys.argv[1])
    if world > 1:
        dist.barrier()
        # Without an end in order: Gloo's takes its lock while it holds Python's, and its thread,
        # which has just finished the barrier, waits for them the other way round now and then.
        os._exit(0)


main()
