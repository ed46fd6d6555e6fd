"""Features of a network of timm as tokens, of whatever layout it has, and back."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError

Kind: TypeAlias = Literal["sequence", "first", "last"]


class Layout:
    """The layout of a network's features: a sequence of tokens, or a map.

    Args:
        network: A network of timm without classifier.
        model: Its name, for errors.
        size: Height and width of its input, pixels.

    Attributes:
        kind: ``sequence`` (B, L, C), ``first`` for maps (B, C, h, w), ``last`` for (B, h, w, C).
        width: Channels of a place.
        head_width: Length of the network's vector; see `vector`.
        prefix: Tokens before the places: class and register tokens.
        stride: Pixels of the input for one place, down and right.
        grid: Rows and columns of places.

    Raises:
        ConfigError: The features of this network are no map of its input.
    """

    def __init__(self, network: Any, model: str, size: tuple[int, int]) -> None:
        self.model = model
        self.stride = _stride(network, model)
        self.grid = (size[0] // self.stride, size[1] // self.stride)
        self.width = int(network.num_features)
        self.head_width = int(getattr(network, "head_hidden_size", self.width))
        self.prefix = int(getattr(network, "num_prefix_tokens", 0))
        self.kind: Kind = "first"
        if hasattr(network, "num_prefix_tokens") or type(network).__name__ == "MlpMixer":
            self.kind = "sequence"
        elif str(getattr(network, "output_fmt", "")).endswith("NHWC"):
            self.kind = "last"

    def tokens(self, found: Tensor, hidden: bool = False) -> Tensor:
        """Features as tokens, (B, prefix + places, C).

        Args:
            found: Output of ``forward_features``.
            hidden: Whether places were left out or tokens added, so that their number is unknown.

        Raises:
            ConfigError: They are not of the declared layout.
        """
        rows, columns = self.grid
        shapes: dict[Kind, tuple[int, ...]] = {
            "sequence": (self.prefix + rows * columns, self.width),
            "first": (self.width, rows, columns),
            "last": (rows, columns, self.width),
        }
        shape = tuple(found.shape[1:]) if isinstance(found, Tensor) else type(found).__name__
        if shape != shapes[self.kind] and not (hidden and self.kind == "sequence"):
            fits = [kind for kind, one in shapes.items() if one == shape and not self.prefix]
            if not fits:
                raise ConfigError(
                    f"model={self.model}: its features have the shape {shape}, and a map of places "
                    f"would have {shapes[self.kind]}; choose another model"
                )
            self.kind = fits[0]  # timm does not say which: known with the first features
        if self.kind == "sequence":
            return found
        return found.flatten(2).mT if self.kind == "first" else found.flatten(1, 2)

    def vector(self, network: Any, tokens: Tensor) -> Tensor:
        """The network's own vector of tokens: pooled, and normed as in timm.

        Args:
            network: The network.
            tokens: float (B, prefix + any number of places, C).

        Returns:
            float (B, head_width), as ``network(x)`` gives it without a classifier.
        """
        if self.kind == "first":
            tokens = tokens.mT.unsqueeze(-1)
        elif self.kind == "last":
            tokens = tokens.unsqueeze(2)
        out: Tensor = network.forward_head(tokens, pre_logits=True)
        return out.flatten(1)


class PlaceHeads(nn.Module):
    """The network's head at each place, where its vector has another size than its map.

    Args:
        network: The network, which stays a part of another module.
        layout: Its layout.
    """

    def __init__(self, network: nn.Module, layout: Layout) -> None:
        super().__init__()
        # in a tuple: no part of this module, whose weights would be named twice
        self._network = (network,)
        self._layout = layout

    def forward(self, tokens: Tensor) -> Tensor:
        """Projects tokens (B, L, C) to (B, L, head_width)."""
        found = self._layout.vector(self._network[0], tokens.flatten(0, 1).unsqueeze(1))
        return found.view(*tokens.shape[:2], -1)


def own_size(network: Any, model: str) -> tuple[int, int]:
    """Height and width expected by a network of timm.

    One that takes any size has the nearest that its stride divides.

    Args:
        network: The network.
        model: Its name, for errors.
    """
    facts = network.pretrained_cfg
    stride = _stride(network, model)
    height, width = (
        side if facts.get("fixed_input_size") else max(1, round(side / stride)) * stride
        for side in facts["input_size"][1:]
    )
    return height, width


def _stride(network: Any, model: str) -> int:
    """Pixels for one place of the last map; the same down and right."""
    try:
        stride = network.feature_info[-1]["reduction"]
    except (AttributeError, IndexError, KeyError, TypeError):
        stride = None
    if isinstance(stride, tuple | list) and len(set(stride)) == 1:
        stride = stride[0]
    if not isinstance(stride, int):
        raise ConfigError(f"model={model}: timm does not say the stride of its map; choose another")
    return stride


def own_pixels(network: Any) -> dict[str, Any]:
    """Preprocessing of a network's training in timm, as options of an encoder.

    Frames are squashed to the network's size, where timm crops photographs: a touch may be at the
    border of its frame. No background is subtracted.

    Args:
        network: The network.
    """
    from timm.data import resolve_model_data_config

    with torch.device("cpu"):
        facts = resolve_model_data_config(network)
    return {
        "offset": None,
        "fit": "squash",
        "filter": "bilinear" if facts["interpolation"] == "bilinear" else "bicubic",
        "mean": [float(x) for x in facts["mean"]],
        "std": [float(x) for x in facts["std"]],
    }
