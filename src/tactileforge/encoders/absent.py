"""The place of a text tower outside of a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from torch import nn

from tactileforge.errors import ConfigError


class AbsentTower(nn.Module):
    """A text tower absent from its file: CLIP's, unchanged by training.

    Args:
        width: Size of its vectors.
        name: Name of its plugin.
    """

    modality = "text"

    def __init__(self, width: int, name: str = "clip") -> None:
        super().__init__()
        self.width = width
        self.name = name

    def forward(self, text: Sequence[str]) -> NoReturn:
        """Raises a ConfigError: there is nothing to encode with."""
        raise ConfigError(f"the text tower {self.name} is not in this file")
