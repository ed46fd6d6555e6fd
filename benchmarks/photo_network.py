"""The frozen photo network with norms folded into convolutions, against the unfolded one.

Both take turns in one process, on one thread. CPU time counts, excluding other programs; the
medians leave out the first round.

Run: python benchmarks/photo_network.py
"""

from __future__ import annotations

import time
from functools import partial

import torch
from common import ratio, save, side_by_side

from tactileforge.encoders.efficientnet_lite import Lite0

PICTURES, SIZE, ROUNDS = 32, 128, 5


def one_by_one() -> Lite0:
    """The same network with convolutions and norms computed one after another."""
    network = Lite0().eval()
    # Training mode turns the folding off; the norms stay in evaluation mode for equal outputs.
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
    maps: dict[str, torch.Tensor] = {}

    def look(name: str) -> None:
        maps[name] = networks[name].features(pictures)[-1]

    with torch.no_grad():
        subjects = {name: partial(look, name) for name in networks}
        times = side_by_side(subjects, ROUNDS, clock=time.process_time)
    first, second = maps.values()
    save(
        "photo_network",
        {
            "what": f"maps of EfficientNet-Lite0, {PICTURES} pictures of {SIZE} x {SIZE}",
            "how": f"CPU seconds of one thread, median of {ROUNDS} rounds, in turn",
            "cpu_s": {name: round(value["median_s"], 3) for name, value in times.items()},
            "in one, times as fast": ratio(times, "in one", "one by one"),
            "largest difference, of the largest value": float(
                (first - second).abs().max() / second.abs().max()
            ),
        },
    )


if __name__ == "__main__":
    main()
