"""Compiled blocks compute the same as the others, under the same names."""

import shutil
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from torch._dynamo.utils import counters
from torch.utils.flop_counter import FlopCounterMode

import tactileforge
from tactileforge.cli._compose import compose
from tactileforge.contracts import Batch
from tactileforge.encoders.compiled import compile_blocks
from tactileforge.encoders.preprocess import Preprocess
from tactileforge.encoders.transformer import Block
from tactileforge.errors import ConfigError
from tactileforge.testing import batch as make_batch
from tactileforge.training.module import TouchModule

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("g++"), reason="kernels for a CPU need g++"),
    pytest.mark.filterwarnings("ignore"),  # what torch's compiler meets
]

#: Kernels sum in another order: float32 has 24 bits, and gradients pass through 6 blocks.
LOSS, GRADIENT = 1e-5, 1e-4


@pytest.fixture(autouse=True)
def _new_compiler() -> None:
    """Functions compiled by other tests would be neither compiled again nor counted."""
    torch.compiler.reset()
    counters.clear()


def build() -> TouchModule:
    words = ["scale=demo", "encoder.image_size=32", "encoder.depth=2"]
    config: Any = OmegaConf.to_container(compose("anytouch2", words), resolve=True)
    torch.manual_seed(0)
    return TouchModule.from_config(config, {"text", "image"})


def step(module: TouchModule, batch: Batch) -> dict[str, torch.Tensor]:
    """Losses of a step; the gradients stay."""
    torch.manual_seed(1)
    module.zero_grad()
    total, logs = module.losses(batch, dict.fromkeys(module.objectives, 1.0))
    total.backward()
    return logs


def operations(module: TouchModule, batch: Batch) -> int:
    with FlopCounterMode(display=False) as counter:
        step(module, batch)
    return counter.get_total_flops()


def test_a_compiled_step_is_the_same_step() -> None:
    plain, compiled = build(), build()
    towers = ("text_encoder", "image_encoder")
    parts = [
        name
        for name, part in compiled.named_modules()
        if isinstance(part, Block | Preprocess) and not any(word in name for word in towers)
    ]
    assert compile_blocks(compiled) == len(parts) == 1 + 2 + 2 * 2
    assert list(plain.state_dict()) == list(compiled.state_dict())
    batch = make_batch(size=4, frames=4, image=32)
    left, right = step(plain, batch), step(compiled, batch)
    assert {k: v.item() for k, v in right.items()} == pytest.approx(
        {k: v.item() for k, v in left.items()}, rel=LOSS
    )
    grads = dict(compiled.named_parameters())
    for name, parameter in plain.named_parameters():
        if parameter.grad is not None:
            error = (grads[name].grad - parameter.grad).abs().max()
            assert error <= GRADIENT * parameter.grad.abs().max() + 1e-7, name
    graphs = counters["stats"]["unique_graphs"]
    assert graphs >= 3  # a block of the encoder, and two kinds of the decoder
    with torch.no_grad():
        compiled.eval().losses(batch, dict.fromkeys(compiled.objectives, 1.0))
    assert counters["stats"]["unique_graphs"] > graphs  # kernels without gradients
    assert not counters["graph_break"]
    assert not counters["recompile_limit"]
    assert operations(plain, batch) == operations(compiled, batch)  # what MFU is computed from


def test_what_encode_calls_is_compiled() -> None:
    """Unlike by `torch.nn.Module.compile`: it compiles calls of the model alone."""
    plain, compiled = tactileforge.load("anytouch2.tiny"), tactileforge.load("anytouch2.tiny")
    frames = torch.randint(0, 255, (2, compiled.frames, 64, 64, 3), dtype=torch.uint8)
    given: Any = {"background": "first", "sensor": "digit"}
    compiled.compile()
    found = compiled.encode(frames, **given)
    assert counters["stats"]["unique_graphs"] > 0
    torch.testing.assert_close(found, plain.encode(frames, **given), rtol=1e-3, atol=1e-4)


def test_an_encoder_without_blocks_says_no() -> None:
    model = tactileforge.load("anytouch2.tiny")
    model.encoder, model.heads = torch.nn.Linear(2, 2), torch.nn.ModuleDict()
    with pytest.raises(ConfigError, match="the encoder tactile_vit has no blocks to be compiled"):
        model.compile()
