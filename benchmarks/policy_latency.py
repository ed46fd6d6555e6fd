"""From a robot's observation to its command: the time of `Policy.step`, p50 and p99.

Two fingers of 320 x 240, a camera of 96 x 96 and six numbers of state, with noise. Steps with the
prediction of a chunk, and steps with the next command of a chunk, are timed separately. Weights do
not affect the time: the encoder is ``anytouch2.tiny``, the head is untrained. ``--size paper``
takes the paper's U-Net.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import torch
from common import save
from omegaconf import OmegaConf
from tactileforge_policies.policy import Policy
from tactileforge_policies.robot import Robot

import tactileforge
from tactileforge import compose
from tactileforge.plugins import registry

ROBOT = Robot(
    fingers=("left", "right"),
    sensors=("digit", "digit"),
    state_size=6,
    action_size=4,
    rate=6.0,
    image_size=48,
)


def build(size: str) -> Policy:
    """An untrained policy of the recipe ``diffusion_policy``, at a scale."""
    words = [f"scale={size}", "data=demonstrations", "data.root=-"]
    node: Any = OmegaConf.to_container(
        compose("diffusion_policy", words).head.denoise, resolve=True
    )
    encoder = tactileforge.load("anytouch2.tiny").encoder
    return Policy(encoder, registry.build("heads", node, encoder=encoder, facts=ROBOT.facts))


def run(policy: Policy, count: int) -> dict[str, dict[str, float]]:
    """Wall and CPU milliseconds of steps with and without a prediction."""
    rng = np.random.default_rng(0)
    touches = rng.integers(0, 255, (8, 240, 320, 3)).astype(np.uint8)
    camera = rng.integers(0, 255, (96, 96, 3)).astype(np.uint8)
    policy.reset({name: touches[0] for name in policy.fingers})
    clock: list[float] = []
    cpu: list[float] = []
    for number in range(2 * count + 8):
        frames = {name: touches[number % 8] for name in policy.fingers}
        start, busy = time.perf_counter(), time.process_time()
        policy.step(frames, np.zeros(6), camera)
        clock.append(1000 * (time.perf_counter() - start))
        cpu.append(1000 * (time.process_time() - busy))
    found = {}
    for name, first in (("predicts", 8), ("takes_the_next", 9)):
        p50, p99 = np.percentile(clock[first::2], [50, 99])
        busy = float(np.median(cpu[first::2]))
        found[name] = {"p50_ms": round(float(p50), 2), "p99_ms": round(float(p99), 2)}
        found[name]["cpu_p50_ms"] = round(busy, 2)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", nargs="*", default=["tiny"], help="tiny, demo or paper")
    parser.add_argument("--count", type=int, default=500, help="steps that predict")
    parser.add_argument("--threads", type=int, default=2)
    words = parser.parse_args()
    torch.set_num_threads(words.threads)
    found = {size: run(build(size), words.count) for size in words.size}
    save("policy_latency", {"encoder": "anytouch2.tiny", "fingers": 2, "sizes": found})


if __name__ == "__main__":
    main()
