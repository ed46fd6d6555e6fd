"""Encoders to compare: models of the zoo, files, runs, and untrained baselines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from tactileforge.errors import ConfigError, home_path, unknown
from tactileforge.hub import (
    Header,
    card_names,
    fetch_weights,
    find_card,
    is_available,
    list_cards,
    make_header,
    open_model,
    open_run,
    read_header,
)
from tactileforge.plugins import registry, sha256
from tactileforge.runs import read_config, split_best
from tactileforge_bench.fit.baselines import BASELINES
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder

#: Draws of random weights that are compared.
UNTRAINED = 3


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """A row of the tables, before anything is loaded.

    Attributes:
        name: The word users type.
        title: Name in print.
        open: Constructors of its encoders, each from a training of its own.
        group: ``model`` or ``ablation``.
        recipe: Recipe of its training; "" if unknown.
        folders: Runs that trained it.
    """

    name: str
    title: str
    open: Sequence[Callable[[], FrozenEncoder]]
    group: str = "model"
    recipe: str = ""
    folders: Sequence[Path] = field(default_factory=tuple)


def model_entry(
    word: str,
    composed: Sequence[str] = (),
    device: str = "cpu",
    runs: Mapping[str, Path] | None = None,
) -> ModelEntry:
    """Resolves a model by its word.

    Args:
        word: A name of the zoo, ``file:PATH``, ``run:FOLDER``, ``timm:NAME`` or another encoder
            plugin and the name of its network (see `named_network`), ``untrained:WORD`` (new random
            weights in the shape of another model, or of a recipe), or one of
            `baselines.BASELINES`.
        composed: Overrides with which a recipe is composed for ``untrained:RECIPE``.
        device: Device of the computation.
        runs: Folders of the models trained here, by name, for ``untrained:NAME``.

    Raises:
        ConfigError: There is no such model.
        DataError: The file or folder is none of a model; `DataNotFoundError` for an absent one.
    """
    if word in BASELINES:
        # opened later: all rows are known before the first model is loaded
        title = BASELINES[word][1]
        return ModelEntry(name=word, title=title, open=[lambda: baseline_encoder(word, device)])
    # prefixes first: behind one, a dot is part of a path, and not of NAME.TAG
    if word.startswith("untrained:"):
        of = word.removeprefix("untrained:")
        if runs and of in runs:
            shape = f"run:{runs[of]}"
        else:
            shape = of
            _check_shape(of, composed)
        return ModelEntry(
            name=word,
            title=word,
            # several seeds: the spread of random networks is the interval of this baseline
            open=[
                partial(
                    lambda seed: untrained_encoder(word, header_of(shape, composed), device, seed),
                    seed,
                )
                for seed in range(UNTRAINED)
            ],
        )
    if word.startswith("run:"):
        folder = home_path(word.removeprefix("run:"))
        read_config(split_best(folder)[0])
        return ModelEntry(
            name=word,
            title=word,
            open=[lambda: encoder_of_run(word, folder, device)],
            folders=[split_best(folder)[0]],
        )
    if word.startswith("file:"):
        path = home_path(word.removeprefix("file:"))
        read_header(path)
        return ModelEntry(name=word, title=word, open=[lambda: _of_file(word, path, device)])
    if network := named_network(word):
        with torch.device("meta"):  # a wrong name is an error now, weights are read later
            registry.build("encoders", network)
        return ModelEntry(
            name=word,
            title=word,
            open=[lambda: FrozenEncoder(word, *built_network(network), device=device)],
        )
    if word.partition(".")[0] not in card_names() and "/" not in word:
        known = [*BASELINES, *(name for name, _, row in list_cards() if row)]
        fix = (
            "Also file:PATH, run:FOLDER, timm:NETWORK, and untrained: before one of these or of a "
            "recipe"
        )
        raise ConfigError(unknown("model", word, known, fix))
    card, weight = find_card(word)
    return ModelEntry(
        name=word,
        title=word,
        open=[lambda: _of_file(word, fetch_weights(card, weight), device)],
        recipe=card.name,
    )


def named_network(word: str) -> dict[str, Any] | None:
    """Configuration of a network of an encoder plugin, ``timm:resnet18``; None for another word.

    Its weights are those that the plugin has for the name; ``timm:resnet18:FILE`` reads them from a
    file.
    """
    plugin, _, rest = word.partition(":")
    if not rest or plugin not in registry.names("encoders"):
        return None
    option = getattr(registry.get("encoders", plugin), "named_by", None)
    if option is None:
        return None
    network, _, path = rest.partition(":")
    start: dict[str, Any] = {"path": path} if path else {"pretrained": True}
    return {"name": plugin, option: network, **start}


def built_network(node: Mapping[str, Any]) -> tuple[Any, Header]:
    """A network of `named_network` with its weights, and a header for it."""
    encoder = registry.build("encoders", node)
    header = make_header(
        encoder,
        node,
        licence="NOASSERTION",
        spacing=getattr(encoder, "spacing", 0.0) if encoder.frames > 1 else 0.0,
    )
    return encoder.requires_grad_(False).eval(), header


def _check_shape(of: str, composed: Sequence[str]) -> None:
    """Check the word behind ``untrained:``: of a model, or of a recipe."""
    if of.startswith(("run:", "file:")):
        model_entry(of)
    elif named_network(of):
        return
    elif "." in of:
        find_card(of)
    else:
        from hydra.errors import MissingConfigException

        from tactileforge import compose

        try:
            compose(of, composed)
        except MissingConfigException as error:
            known = card_names()
            raise ConfigError(unknown("model or recipe behind untrained:", of, known)) from error


def encoder_of_run(name: str, folder: Path, device: str = "cpu") -> FrozenEncoder:
    """The encoder of a run, from its last checkpoint."""
    encoder, heads, header = open_run(folder)
    return FrozenEncoder(name, encoder, header, device=device, heads=heads)


def untrained_encoder(
    name: str, header: Header, device: str = "cpu", seed: int = 0
) -> FrozenEncoder:
    """Random weights in the shape of a model."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        encoder = registry.build("encoders", header.encoder)
    # steps and origin are those of the trained weights, not of these
    return FrozenEncoder(name, encoder, replace(header, source={}), device=device)


def baseline_encoder(word: str, device: str = "cpu") -> FrozenEncoder:
    """No encoder of touch at all: see `baselines.BASELINES`."""
    encoder = BASELINES[word][0]()
    # its two frames are as far apart as the first and the last of a clip
    header = make_header(encoder, {"name": word}, licence="Apache-2.0", spacing=0.2)
    return FrozenEncoder(word, encoder, header, device=device)


def header_of(word: str, composed: Sequence[str] = ()) -> Header:
    """Header of a model; for a recipe without weights, of the encoder that it would train."""
    if word.startswith(("run:", "file:")):
        return model_entry(word).open[0]().header
    if node := named_network(word):
        return built_network(registry.without_start("encoders", node))[1]
    name, _, tag = word.partition(".")
    if tag and is_available(*find_card(word)):
        return model_entry(word).open[0]().header
    from omegaconf import OmegaConf

    from tactileforge import compose

    config = compose(name, composed)
    plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    with torch.random.fork_rng(devices=[]):
        encoder = registry.build("encoders", plain["encoder"])
    spacing = plain["batch"]["spacing"] if encoder.frames > 1 else 0.0
    return make_header(
        encoder, plain["encoder"], licence="Apache-2.0", spacing=spacing, recipe=plain
    )


def _of_file(name: str, path: Path, device: str) -> FrozenEncoder:
    encoder, heads, header = open_model(path)
    return FrozenEncoder(name, encoder, header, sha256(path), device, heads)
