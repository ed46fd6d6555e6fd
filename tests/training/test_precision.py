"""Choice of precision, by invented times; a run keeps its choice."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.runs import folder as run_folder
from tactileforge.training import precision
from tactileforge.training.assemble import build_data
from tactileforge.training.module import TouchModule
from tactileforge.training.precision import Timing, choose_precision, native_bf16, step_times

AUTO = {"precision": "auto", "accelerator": "cpu", "devices": 1, "num_nodes": 1}
TINY = ["scale=demo", "encoder.image_size=32", "batch.size=8", "batch.workers=0"]
TINY += ["data.scenes=3", "data.val=1", "data.size=32", "debug=steps"]


@pytest.mark.parametrize(
    ("options", "native", "times", "name", "reason"),
    [
        ({}, "AMX", (2.0, 1.0), "bf16-mixed", "AMX: a step in bf16 is 2.00 times as fast"),
        ({}, "AMX", (1.3, 1.0), "bf16-mixed", "1.30 times"),
        ({}, "AMX", (1.2, 1.0), "32-true", "1.20 times as fast as in fp32, and 1.3 is asked for"),
        ({}, "", None, "32-true", "this CPU has no fast bf16"),
        ({"devices": 2}, "AMX", None, "32-true", "several processes"),
        ({"devices": "4"}, "AMX", None, "32-true", "several processes"),
        ({"num_nodes": 2}, "AMX", None, "32-true", "several processes"),
        ({"max_steps": 49}, "AMX", None, "32-true", "not tried for less than 50 steps"),
        ({"max_steps": 50}, "AMX", (2.0, 1.0), "bf16-mixed", "2.00 times"),
        ({"max_steps": -1}, "AMX", (2.0, 1.0), "bf16-mixed", "2.00 times"),
        ({"precision": "64-true"}, "AMX", None, "64-true", "as asked for"),
    ],
)
def test_what_is_chosen(
    options: dict[str, Any], native: str, times: Timing | None, name: str, reason: str
) -> None:
    def measure() -> Timing:
        assert times is not None, "measured without need"
        return times

    chosen = choose_precision(AUTO | options, measure, native)
    assert chosen.name == name
    assert reason in chosen.reason


@pytest.mark.parametrize(("native", "name"), [(True, "bf16-mixed"), (False, "32-true")])
def test_an_accelerator_is_asked(monkeypatch: pytest.MonkeyPatch, native: bool, name: str) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: native)
    for devices in (1, 8):
        options = AUTO | {"accelerator": "auto", "devices": devices}
        assert choose_precision(options, lambda: (1.0, 1.0)).name == name


def test_one_of_several_processes_does_not_measure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert choose_precision(AUTO, lambda: (9.0, 1.0), "AMX").name == "32-true"


@pytest.mark.parametrize(
    ("abilities", "name"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, "AMX"),
        ({"amx_bf16": False, "avx512_bf16": True}, "AVX-512 BF16"),
        ({"avx512_f": True}, ""),
    ],
)
def test_abilities_of_a_cpu(
    monkeypatch: pytest.MonkeyPatch, abilities: dict[str, bool], name: str
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: abilities)
    assert native_bf16() == name


@pytest.mark.slow
def test_the_probe_times_both_and_changes_nothing() -> None:
    config: Any = OmegaConf.to_container(compose("anytouch2", TINY), resolve=True)
    data, config["encoder"] = build_data(config)
    module = TouchModule.from_config(config, data.summary("train").labels)
    assert data.train is not None
    module.prepare(data.train)
    before = {key: value.clone() for key, value in module.state_dict().items()}
    torch.manual_seed(3)
    expected = torch.rand(4)
    torch.manual_seed(3)
    single, half = step_times(module, data.train)
    assert min(single, half) > 0
    assert torch.equal(torch.rand(4), expected)
    assert all(torch.equal(value, before[key]) for key, value in module.state_dict().items())
    assert all(parameter.grad is None for parameter in module.parameters())
    print(f"a step in bf16 is {single / half:.2f} times as fast")


@pytest.mark.slow
def test_a_run_keeps_what_was_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precision, "native_bf16", lambda: "AMX")
    monkeypatch.setattr(precision, "step_times", lambda module, clips: (3.0, 2.0))
    monkeypatch.setattr(precision, "_STEPS", 2)
    train(compose("anytouch2", TINY), tmp_path)
    config = run_folder.read_config(tmp_path)
    assert config["trainer"]["precision"] == "bf16-mixed"
    kept = json.loads((tmp_path / "versions.json").read_text())
    assert "AMX: a step in bf16 is 1.50 times as fast" in json.dumps(kept)
    assert "bf16-mixed: AMX: a step in bf16 is 1.50" in (tmp_path / "report.html").read_text()

    def probed(*_: object) -> Timing:
        raise AssertionError("probed again")

    monkeypatch.setattr(precision, "step_times", probed)
    module = train(config | {"resume": str(tmp_path)}, tmp_path)
    assert module.trainer.precision == "bf16-mixed"
