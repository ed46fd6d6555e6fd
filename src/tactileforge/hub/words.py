"""Words for clips, in the space shared by a model and language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.absent import AbsentTower
from tactileforge.errors import ConfigError, PluginError
from tactileforge.hub import cards
from tactileforge.hub.classify import Classes
from tactileforge.hub.header import Header
from tactileforge.plugins import registry

#: Temperature of models whose file keeps none: the first one of CLIP, TVL and AnyTouch 1.
TEMPERATURE = 0.07
#: A text tower, or the name on the model hub, or the folder, of the CLIP that has it.
TextEncoder: TypeAlias = str | Path | nn.Module


@dataclass(frozen=True)
class WordMatches(Classes):
    """Words for clips.

    Attributes:
        names: The words.
        probability: float32 (words,), or (B, words) for a batch; softmax of ``cosine`` divided by
            ``temperature``.
        cosine: Cosine similarities of touch and words, in the shape of ``probability``.
        temperature: Temperature of the softmax.
    """

    cosine: Tensor
    temperature: float


@dataclass(frozen=True)
class Language:
    """Text side of a model.

    Attributes:
        model: Name of the model in errors.
        width: Size of a vector of touch.
        tower: Text tower, or the name on the model hub of the CLIP with it.
        project: Linear layer from the tower to the shared space; None where that is the tower's.
        template: Sentence of a word, with ``{}`` for the word.
        temperature: Temperature of the softmax over words.
    """

    model: str
    width: int
    tower: TextEncoder
    project: nn.Linear | None
    template: str
    temperature: float

    def vectors(
        self,
        words: Sequence[str],
        template: str | None = None,
        text_encoder: TextEncoder | None = None,
        device: torch.device | str = "cpu",
    ) -> Tensor:
        """Vectors of words in the shared space, float32 (words, width), of unit length.

        Args:
            words: Words, each once.
            template: Sentence of a word; None takes ``template`` of the model.
            text_encoder: Text tower, or its CLIP, in place of the default one.
            device: Device of the computation.

        Raises:
            ConfigError: Words or template are not what they should be, or the tower does not fit.
            PluginError: The tower cannot be loaded; says what to install.
        """
        sentences = sentences_of(words, self.template if template is None else template)
        tower = self._opened(text_encoder).to(device).eval()
        with torch.no_grad():
            vectors: Tensor = tower(sentences)
            if self.project is not None:
                project = self.project.to(device)
                vectors = project(vectors.to(project.weight.dtype))
        return F.normalize(vectors.float(), dim=-1)

    def _opened(self, given: TextEncoder | None) -> nn.Module:
        # a tower that was trained with the model is in its file: no other goes with it
        own = isinstance(self.tower, nn.Module) and not isinstance(self.tower, AbsentTower)
        if own and given is not None:
            raise ConfigError(
                f"text_encoder: the file of {self.model} has the text tower that it was trained "
                "with; leave text_encoder out"
            )
        tower = self.tower if given is None else given
        if isinstance(tower, AbsentTower):
            raise ConfigError(
                f"{self.model} was aligned with the text tower {tower.name}, which is not in its "
                "file: give text_encoder=, its name on the model hub or its folder"
            )
        opened = tower if isinstance(tower, nn.Module) else self._load(str(tower))
        modality, size = getattr(opened, "modality", "touch"), getattr(opened, "width", 0)
        needed = self.width if self.project is None else self.project.in_features
        if modality != "text" or size != needed:
            fix = f"give text_encoder={self.tower}" if isinstance(self.tower, str) else "give its"
            raise ConfigError(
                f"text_encoder: it encodes {modality} to {size} numbers, and {self.model} was "
                f"aligned with text of {needed}: {fix}"
            )
        return opened

    def _load(self, place: str) -> nn.Module:
        try:
            return _clip(place)
        except PluginError as error:
            reason = " ".join(str(error).split())
            raise PluginError(f"the text tower of {self.model} is absent: {reason}") from error


@lru_cache(maxsize=1)  # loading one takes seconds
def _clip(place: str) -> nn.Module:
    """CLIP's text tower from its name on the model hub, or its folder."""
    node = {"name": "clip", "path": str(Path(place).expanduser()), "tower": "text"}
    tower: nn.Module = registry.build("encoders", node)
    return tower


def sentences_of(words: Sequence[str], template: str) -> list[str]:
    """Puts each word into a sentence.

    Example:
        >>> sentences_of(["wood", "metal"], "a touch of {}")
        ['a touch of wood', 'a touch of metal']

    Raises:
        ConfigError: No words, an empty one, one given twice, or a template without ``{}``.
    """
    if isinstance(words, str) or not words or not all(isinstance(x, str) and x for x in words):
        raise ConfigError(f"words={words!r}: give a list of words, e.g. ['wood', 'metal']")
    if twice := sorted({word for word in words if list(words).count(word) > 1}):
        raise ConfigError(f"words: {twice[0]!r} is there twice; give it once")
    if template.count("{}") != 1:
        raise ConfigError(
            f"template={template!r}: give one {{}} for the word, e.g. 'feels like {{}}'"
        )
    return [template.replace("{}", word) for word in words]


def match_vectors(
    touch: Tensor, text: Tensor, words: Sequence[str], temperature: float
) -> WordMatches:
    """Words for vectors of touch.

    Args:
        touch: float32 (width,) or (B, width).
        text: Vectors of the words, float32 (words, width), of unit length.
        words: The words.
        temperature: Temperature of the softmax.

    Raises:
        ConfigError: The temperature is not positive.
    """
    if not 0 < temperature < float("inf"):
        raise ConfigError(f"temperature={temperature}: give a number above 0")
    cosine = F.normalize(touch, dim=-1) @ text.to(touch.device).T
    return WordMatches(tuple(words), (cosine / temperature).softmax(-1), cosine, float(temperature))


def language_of(header: Header, heads: Mapping[str, Any], model: str, width: int) -> Language:
    """Text side of a model.

    Args:
        header: Header of its file.
        heads: Heads of its file, by name.
        model: Name of the model in errors.
        width: Size of a vector of touch.

    Raises:
        ConfigError: It is not aligned with language, or its file has no aligned head.
    """
    if "align" in heads:
        head = heads["align"]
        temperature = 1 / float(head.scale.detach())
        return Language(model, width, head.text_encoder, head.text_project, "{}", temperature)
    weight = _weight(header)
    if weight is None or not weight.text_encoder:
        raise ConfigError(_why_none(header, model))
    kept = header.source.get("temperature", TEMPERATURE)
    return Language(model, width, weight.text_encoder, None, weight.template, kept)


def _weight(header: Header) -> cards.Weight | None:
    """Weights on the card of an imported model; its file has no say."""
    # a file could name any place to load a tower from: only a card of ours may
    if not header.source.get("layout"):
        return None
    try:
        return cards.find_card(header.name)[1]
    except ConfigError:
        return None


def _why_none(header: Header, model: str) -> str:
    """Error text for a model without a text side."""
    trained = _plain(header.recipe.get("objective"))
    if "align" not in trained:
        known = ", ".join(name for name, _, row in cards.list_cards() if row and row.text_encoder)
        return (
            f"{model} is not aligned with language; models that are: {known}, and runs with "
            "objective=[...,align] on data with captions"
        )
    if "align" in header.heads:
        return f"{model}: frames= or image_size= left its heads out; load it without them"
    if _plain(header.recipe.get("text_encoder")).get("frozen") is False:
        return (
            f"{model}: its text tower was trained with it, and is too large to be kept in a file; "
            "train with text_encoder.frozen=true"
        )
    if header.source.get("encoder") == "slow":
        return f"{model}: the slow copy of an encoder is not aligned; pack with encoder=trained"
    return (
        f"{model} has no head that is aligned with text: its data had no captions, or its file is "
        "older than such heads; pack its run again: tactileforge zoo pack RUN"
    )


def _plain(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
