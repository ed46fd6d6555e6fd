"""Choice of the strategy of several processes; their results are in test_ddp.py."""

from typing import Any

import pytest

from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.training.strategies import (
    PhasedDDP,
    ShardedStrategy,
    check_started,
    choose_strategy,
)
from tactileforge.util.distributed import count_processes


@pytest.mark.parametrize(
    ("options", "world", "expected"),
    [
        ({}, "", 1),
        ({"devices": 1, "num_nodes": 4}, "", 4),
        ({"devices": "8", "num_nodes": 2}, "", 16),
        ({"devices": "0,1"}, "", 2),
        ({"devices": "auto"}, "", 1),
        ({"devices": -1, "num_nodes": 3}, "", 3),
        ({}, "6", 6),
    ],
)
def test_processes_are_counted(
    options: dict[str, Any], world: str, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WORLD_SIZE", world or "1")
    given = {"devices": 1, "num_nodes": 1, "accelerator": "cpu"} | options
    assert count_processes(given) == expected


def test_the_strategy_follows_the_encoder() -> None:
    assert choose_strategy("auto", 1, True, None) == "auto"
    assert choose_strategy("ddp", 8, True, None) == "ddp"
    static = choose_strategy("auto", 8, True, "gradnorm")
    assert isinstance(static, PhasedDDP)
    assert static._ddp_kwargs == {"static_graph": True}
    assert choose_strategy("auto", 8, False, None) == "ddp_find_unused_parameters_true"
    assert isinstance(choose_strategy("fsdp2", 8, True, "none"), ShardedStrategy)
    with pytest.raises(ConfigError, match=r"fsdp2 .*balance=gradnorm"):
        choose_strategy("fsdp2", 8, True, "gradnorm")


def test_torchrun_starts_what_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LOCAL_WORLD_SIZE", raising=False)
    check_started(1)
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "2")
    for devices in (2, "2", "auto", "0,1"):
        check_started(devices)
    with pytest.raises(ConfigError, match=r"2 processes.*give trainer.devices=2, or .*node=1"):
        check_started(1)


def test_a_stem_a_sensor_is_not_static() -> None:
    stems: dict[str, Any] = {"stems": 2, "stem_depth": 1, "sensors": {"digit": 0, "gelsight": 1}}
    assert TactileViT("tiny", image_size=32).static_graph
    assert PlainViT("tiny", image_size=32).static_graph
    assert not PlainViT("tiny", image_size=32, **stems).static_graph
