"""Callbacks of a run by name: Lightning's, those of packages, and the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import lightning as L
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch import callbacks as lightning_callbacks
from lightning.pytorch.callbacks import Callback

from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import registry

#: Name of the sum of the validation losses, for callbacks that monitor a number.
TOTAL = "val/loss"


class EarlyStopping(lightning_callbacks.EarlyStopping):
    """Ends a run once a number no longer improves; Lightning's, with a default of its own.

    Args:
        monitor: Name in the metrics; ``val/loss`` is the sum of the validation losses.
        min_delta: Smallest change that is an improvement.
        patience: Validations without one, before the end.
        mode: ``min`` or ``max``.
        stopping_threshold: Value at which the run ends at once; None for none.
        divergence_threshold: Value beyond which it ends at once; None for none.
    """

    def __init__(
        self,
        monitor: str = TOTAL,
        min_delta: float = 0.0,
        patience: int = 3,
        mode: str = "min",
        stopping_threshold: float | None = None,
        divergence_threshold: float | None = None,
    ) -> None:
        super().__init__(
            monitor,
            min_delta,
            patience,
            mode=mode,
            stopping_threshold=stopping_threshold,
            divergence_threshold=divergence_threshold,
            check_on_train_epoch_end=False,
        )


class WeightAveraging(lightning_callbacks.EMAWeightAveraging):
    """Averages the weights exponentially, validates and ends with the averages; Lightning's.

    Args:
        decay: Share of the averages that is kept at an update.
        update_every_n_steps: Steps between two updates.
        update_starting_at_step: Step of the first update; None for the first step.
    """

    def __init__(
        self,
        decay: float = 0.999,
        update_every_n_steps: int = 1,
        update_starting_at_step: int | None = None,
    ) -> None:
        super().__init__(
            decay=decay,
            update_every_n_steps=update_every_n_steps,
            update_starting_at_step=update_starting_at_step,
        )


def build_callbacks(config: Mapping[str, Any] | None) -> dict[str, Callback]:
    """Builds the callbacks of a run, by key.

    Args:
        config: Options by key, with the ``name`` of the callback.

    Raises:
        PluginError: A callback is not installed, or is not a callback of Lightning.
        ConfigError: An unknown option, or one that its constructor refuses.
    """
    nodes = {key: dict(node) for key, node in (config or {}).items() if node is not None}
    return {key: _build(key, {"name": key, **node}) for key, node in nodes.items()}


def check_monitored(trainer: L.Trainer, error: Exception) -> None:
    """Raises the error of a callback again, if its monitor is not logged.

    Raises:
        ConfigError: It does; lists what is logged.
    """
    for one in trainer.callbacks:  # type: ignore[attr-defined]
        monitor = getattr(one, "monitor", None)
        if monitor and monitor not in trainer.callback_metrics and str(monitor) in str(error):
            what = f"monitor of {type(one).__name__}"
            raise ConfigError(unknown(what, monitor, trainer.callback_metrics)) from error


def _build(key: str, node: dict[str, Any]) -> Callback:
    where = f"callbacks.{key}"
    try:
        made = registry.build("callbacks", node, where)
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise ConfigError(f"{where}: {error}") from error
    if not isinstance(made, Callback):
        raise PluginError(f"{where}: {node['name']} is no lightning.pytorch.callbacks.Callback")
    return made
