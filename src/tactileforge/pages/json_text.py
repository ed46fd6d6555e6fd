"""JSON of measured values."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def to_json(message: Mapping[str, Any]) -> str:
    """Plain data as JSON, with null for NaN and infinite numbers.

    Args:
        message: Lists, mappings, numbers and text.

    Example:
        >>> to_json({"force": [float("nan"), 0.5], "difference": float("inf")})
        '{"force": [null, 0.5], "difference": null}'
    """
    try:
        return json.dumps(message, allow_nan=False)
    except ValueError:  # NaN is not JSON (RFC 8259); it is rare, so only then all is copied
        return json.dumps(_finite(message), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
