"""Cost of DDP: measured on two processes of one machine, projected to 8 and 64 GPUs.

Measured: CPU seconds of a step in each of two gloo processes of one thread, without DDP, with a
static graph (ours) and with a search for unused parameters. CPU time excludes other programs and
waiting for the other process: the difference is the work of DDP itself.

Projected: DDP sends gradients in a ring during backward, two thirds of a step. A GPU sends
``2 (N - 1) / N`` times the bytes of the gradients, at the rate of the slowest link; the part beyond
backward, and at least the last bucket of 25 MiB, is waited for. Efficiency is the time of a step
over that with the wait. Flops are `train_subjects.step_flops`; links and MFU are assumed, and
listed in the result.

Run: python processes.py
"""

from __future__ import annotations

import os
import socket
import statistics
import time
from collections.abc import Mapping
from typing import Any

import torch
import torch.distributed as dist
from common import save
from omegaconf import OmegaConf
from torch import Tensor, nn
from torch.multiprocessing.spawn import spawn
from torch.nn.parallel import DistributedDataParallel
from train_subjects import Case, config_of, step_flops

from tactileforge import compose
from tactileforge.contracts import Batch
from tactileforge.testing import batch as make_batch
from tactileforge.training import TouchModule

ROUNDS, CLIPS = 30, 4
WAYS: dict[str, dict[str, Any] | None] = {
    "alone": None,
    "static graph": {"static_graph": True},
    "search for unused": {"find_unused_parameters": True},
}
#: Dense bf16 peak of an H100 SXM, FLOP/s.
PEAK = 989e12
#: Number of GPUs, and rate of a ring in bytes/s: that of NVLink, or of the ports between machines.
LINKS = {
    "8 GPUs, NVLink": (8, 300e9),
    "64 GPUs, eight 400 Gb/s ports a machine": (64, 300e9),
    "64 GPUs, one 400 Gb/s port a machine": (64, 40e9),
}
#: Assumed MFU, size of DDP's buckets (bytes), and bytes of a gradient's number.
MFU, BUCKET, BYTES = 0.4, 25 * 2**20, 4


class Losses(nn.Module):
    """Sum of the losses without align: its gathering is not work of DDP."""

    def __init__(self) -> None:
        super().__init__()
        words = ["scale=demo", "encoder.image_size=32", "objective=[pixel,diff,force]"]
        config: Any = OmegaConf.to_container(compose("anytouch2", words), resolve=True)
        torch.manual_seed(0)
        self.module = TouchModule.from_config(config, {"text", "image"})

    def forward(self, batch: Batch) -> Tensor:
        """The sum of the losses."""
        return self.module.losses(batch, dict.fromkeys(self.module.objectives, 1.0))[0]


def process(rank: int, port: int, out: str) -> None:
    """Entry point of one of the two processes: rounds of steps, the ways in turn."""
    os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    torch.set_num_threads(1)
    dist.init_process_group("gloo", rank=rank, world_size=2)
    models: dict[str, nn.Module] = {}
    for name, options in WAYS.items():
        losses = Losses()
        models[name] = losses if options is None else DistributedDataParallel(losses, **options)
    batch = make_batch(size=CLIPS, frames=4, image=32)
    times: dict[str, list[float]] = {name: [] for name in WAYS}
    for number in range(2 + ROUNDS):
        for name, model in models.items():
            start = time.process_time()
            torch.autograd.backward(model(batch))
            model.zero_grad()
            if number > 1:  # the first two rounds warm up
                times[name].append(time.process_time() - start)
    if rank == 0:
        weights = sum(p.numel() for p in models["alone"].parameters() if p.requires_grad)
        medians = {name: statistics.median(values) for name, values in times.items()}
        torch.save({"cpu_s": medians, "parameters": weights}, out)
    dist.destroy_process_group()


def projected(case: Case, parameters: int, gpus: int, rate: float) -> dict[str, float]:
    """Projected efficiency of data-parallel training; see the module's docstring.

    Args:
        case: Step of each GPU.
        parameters: Number of parameters with gradients.
        gpus: Number of GPUs.
        rate: Sending rate of a GPU, bytes/s.
    """
    step = step_flops(case) / (MFU * PEAK)
    share = 2 * (gpus - 1) / gpus
    sent = share * BYTES * parameters / rate
    wait = max(sent - 2 / 3 * step, share * BUCKET / rate)
    return {
        "step_ms": round(1e3 * step, 2),
        "sent_ms": round(1e3 * sent, 2),
        "efficiency": round(step / (step + wait), 3),
    }


def on_paper() -> Mapping[str, Any]:
    """Projections for base and large."""
    rows: dict[str, Any] = {}
    for size, batch in (("base", 64), ("large", 32)):
        case = Case("pixel+diff", size, batch=batch)
        with torch.device("meta"):
            module = TouchModule.from_config(config_of(case), set())
        count = sum(p.numel() for p in module.parameters())
        for name, (gpus, rate) in LINKS.items():
            rows[f"{size}, {batch} clips a GPU, {name}"] = {
                "parameters": count,
                **projected(case, count, gpus, rate),
            }
    return rows


def main() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    out = f"/tmp/processes-{os.getpid()}.pt"
    spawn(process, (port, out), nprocs=2)  # type: ignore[no-untyped-call]
    measured = torch.load(out, weights_only=True)
    os.unlink(out)
    cpu = {name: round(value, 4) for name, value in measured["cpu_s"].items()}
    save(
        "processes",
        {
            "what": f"forward and backward of {CLIPS} clips of 32 pixels, scale=demo, in two",
            "cpu_s": cpu,
            "parameters": measured["parameters"],
            "share of a step that is not DDP": {
                name: round(cpu["alone"] / value, 3) for name, value in cpu.items()
            },
            "assumed": {"peak": PEAK, "mfu": MFU, "gpus, bytes_per_s": LINKS},
            "on paper": on_paper(),
        },
    )


if __name__ == "__main__":
    main()
