"""The settings of verbs: one YAML in conf/ each, changed by ``key=value``."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import cast

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tactileforge.errors import ConfigError, unknown


def text(verb: str) -> str:
    """The YAML of a verb, which explains its keys."""
    return (files("tactileforge.conf") / f"{verb}.yaml").read_text()


def load(verb: str, words: Sequence[str]) -> DictConfig:
    """The settings of a verb that composes no plugins.

    Args:
        verb: Name of a YAML in conf/.
        words: ``key=value`` strings; values are YAML.

    Raises:
        ConfigError: A word is no ``key=value``, names no key, or a key has no value yet.
    """
    known = cast(DictConfig, OmegaConf.create(text(verb)))
    for word in words:
        key, equals, _ = word.partition("=")
        if not equals:
            raise ConfigError(f"{word!r} is not key=value; tactileforge {verb} --help lists keys")
        if key not in known.keys():  # noqa: SIM118  a key without a value is not "in" it
            raise ConfigError(unknown("key", key, [str(key) for key in known]))
    try:
        config = cast(DictConfig, OmegaConf.merge(known, OmegaConf.from_dotlist(list(words))))
    except OmegaConfBaseException as error:
        raise ConfigError(f"{' '.join(words)}: {error}") from error
    require(config)
    return config


def require(config: DictConfig) -> None:
    """Raises a ConfigError where keys have no value yet; names them."""
    missing = sorted(map(str, OmegaConf.missing_keys(config)))
    if missing:
        raise ConfigError(f"give {' '.join(f'{key}=...' for key in missing)}")
