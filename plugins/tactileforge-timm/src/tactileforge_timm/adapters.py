"""LoRA by peft: a large network stays as it is, and small matrices beside its layers train."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import nn

from tactileforge.errors import ConfigError, PluginError
from tactileforge.plugins import install_command

#: Alpha of LoRA over its rank: what the matrices give is scaled by it (Hu et al. 2021).
_SCALE = 2


def add_lora(network: nn.Module, rank: int, layers: Sequence[str]) -> None:
    """Puts LoRA beside layers of a network, in place; all other weights of it are frozen.

    Args:
        network: The network.
        rank: Rank of the matrices.
        layers: Ends of the names of layers; none takes all linear layers or, in a network with few
            of them, its convolutions over all channels.

    Raises:
        PluginError: peft is not installed.
        ConfigError: The rank is below 1, or no layer has such a name.
    """
    if rank < 1:
        raise ConfigError(f"lora={rank}: give the rank of its matrices, 1 or more; 0 for none")
    try:
        import peft
    except ImportError as error:
        how = install_command("tactileforge-timm[lora]")
        raise PluginError(f"lora needs peft: {how}") from error
    chosen = _chosen(network, layers)
    if not chosen:
        known = sorted({name.rpartition(".")[2] for name, part in _candidates(network)})
        raise ConfigError(f"lora_layers={list(layers)}: no such layer; known: {', '.join(known)}")
    config: Any = peft.LoraConfig(r=rank, lora_alpha=_SCALE * rank, target_modules=chosen)
    # freezes everything else
    peft.inject_adapter_in_model(config, network)


def _candidates(network: nn.Module) -> list[tuple[str, nn.Module]]:
    return [
        (name, part)
        for name, part in network.named_modules()
        if isinstance(part, nn.Linear) or (isinstance(part, nn.Conv2d) and part.groups == 1)
    ]


def _chosen(network: nn.Module, layers: Sequence[str]) -> list[str]:
    found = _candidates(network)
    if layers:
        return [n for n, _ in found if any(f".{n}".endswith(f".{end}") for end in layers)]
    linear = [name for name, part in found if isinstance(part, nn.Linear)]
    return linear if len(linear) > len(found) // 2 else [name for name, _ in found]
