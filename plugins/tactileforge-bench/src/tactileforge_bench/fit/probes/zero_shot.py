"""The probe ``zero_shot``: the class with the nearest name, without training clips."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge_bench.fit.probes.base import Probe, Values
from tactileforge_bench.tasks.targets import TargetPart


class ZeroShot(Probe):
    """The class with the name nearest to a clip, by cosine, in the space of touch and language.

    It is `Model.match_words` on the names of the classes. Source: CLIP (arXiv 2103.00020), section
    3.1.

    Args:
        width: Size of the projected class token.
        parts: Parts of the target; each is one column of classes.
        template: Sentence of a name, with ``{}`` for the name; None takes the model's own.
        text_encoder: CLIP on the model hub, or its folder, in place of the model's text tower.

    Attributes:
        words: Names of the classes of each part, in words: underscores are spaces.

    Raises:
        ConfigError: A part has no classes to name.
    """

    tap: ClassVar[str] = "projected"
    trained: ClassVar[bool] = False
    fitted: ClassVar[bool] = False

    def __init__(
        self,
        width: int,
        parts: Mapping[str, TargetPart],
        template: str | None = None,
        text_encoder: str | None = None,
    ) -> None:
        super().__init__(width, parts)
        for name, part in parts.items():
            if part.kind != "classes" or part.truth.shape[1] != 1:
                raise ConfigError(
                    f"probe zero_shot: {name} is not one class of a clip; give a target with names "
                    "of classes, such as label:COLUMN"
                )
        self.template = template
        self.text_encoder = text_encoder
        self.words = {
            name: [label.replace("_", " ") for label in part.names] for name, part in parts.items()
        }

    def choose(self, asked: Tensor, text: Mapping[str, Tensor]) -> Values:
        """Class indices, (n, 1) of each part.

        Args:
            asked: Features of the clips, (n, width).
            text: Vectors of the names of each part, (classes, width), of unit length.
        """
        touch = F.normalize(asked, dim=1)
        return {
            name: (touch @ rows.to(touch).T).argmax(1, keepdim=True).float()
            for name, rows in text.items()
        }
