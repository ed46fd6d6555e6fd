"""Policies for tactileforge: policy heads, simulated tasks, demonstrations, and rollouts.

``import tactileforge_policies`` does not import torch: names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactileforge_policies.policy import Policy, load_policy

__all__ = ["Policy", "load_policy"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from tactileforge_policies import policy

        return getattr(policy, name)
    raise AttributeError(f"module 'tactileforge_policies' has no attribute {name!r}")
