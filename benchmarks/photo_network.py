"""The frozen network of photographs, its norms in its convolutions, against both one by one.

Both take turns in one process, on one thread. CPU time counts, so that other programs do not;
medians are kept, without the first round.

Run: python benchmarks/photo_network.py
"""

from __future__ import annotations

import statistics
import time

import torch
from common import save

from tactileforge.encoders.efficientnet_lite import Lite0

PICTURES, SIZE, ROUNDS = 32, 128, 6


def one_by_one() -> Lite0:
    """The same network whose convolutions and norms are computed one after another."""
    network = Lite0().eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            continue
        module.training = True
    return network


def main() -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    networks = {"in one": Lite0().eval(), "one by one": one_by_one()}
    networks["one by one"].load_state_dict(networks["in one"].state_dict())
    pictures = torch.rand(PICTURES, 3, SIZE, SIZE)
    seconds: dict[str, list[float]] = {name: [] for name in networks}
    maps: dict[str, torch.Tensor] = {}
    with torch.no_grad():
        for _ in range(ROUNDS):
            for name, network in networks.items():
                start = time.process_time()
                maps[name] = network.features(pictures)[-1]
                seconds[name].append(time.process_time() - start)
    median = {name: statistics.median(spent[1:]) for name, spent in seconds.items()}
    first, second = maps.values()
    save(
        "photo_network",
        {
            "what": f"maps of EfficientNet-Lite0, {PICTURES} pictures of {SIZE} x {SIZE}",
            "how": f"CPU seconds of one thread, median of {ROUNDS - 1} rounds, in turn",
            "cpu_s": {name: round(value, 3) for name, value in median.items()},
            "in one, times as fast": round(median["one by one"] / median["in one"], 2),
            "largest difference, of the largest value": float(
                (first - second).abs().max() / second.abs().max()
            ),
        },
    )


if __name__ == "__main__":
    main()
