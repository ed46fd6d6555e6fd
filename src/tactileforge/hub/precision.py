"""Number types of a loaded model's computation."""

from __future__ import annotations

from typing import Literal, get_args

import torch

from tactileforge.errors import ConfigError, unknown
from tactileforge.hub.int8_linear import quantise_linears
from tactileforge.hub.parts import Parts

Precision = Literal["auto", "float32", "bfloat16", "int8"]


def set_precision(model: Parts, dtype: str) -> None:
    """Makes a model compute in another type, in place; frames are prepared in float32 in any.

    Args:
        model: Float32.
        dtype: ``float32``; ``bfloat16``, weights and sums of half the size; ``int8``, linear layers
            of the encoder with weights of eight bits, on a CPU; ``auto``, bfloat16 where the device
            has units for it (a GPU, a CPU with AMX) and else float32.

    Raises:
        ConfigError: An unknown type, or int8 on a GPU.
    """
    if dtype not in get_args(Precision):
        raise ConfigError(unknown("dtype", str(dtype), get_args(Precision)))
    if dtype == "auto":
        dtype = "bfloat16" if has_bfloat16_units(model.device) else "float32"
    if dtype == "float32":
        return
    # before weights are rounded: a calibration of the model fits its rounded copy, too
    model.keep_fingerprint()
    if dtype == "bfloat16":
        model.bfloat16()
    elif model.device.type == "cpu":
        quantise_linears(model.encoder)
    else:
        raise ConfigError(f"dtype=int8 is for a CPU; on {model.device} give dtype=bfloat16")


def has_bfloat16_units(device: torch.device) -> bool:
    """Whether a device multiplies matrices of bfloat16 faster than of float32."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    return device.type == "cpu" and bool(torch.cpu._is_amx_tile_supported())
