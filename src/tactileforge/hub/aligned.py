"""The text side of a head aligned with language, in a file and out of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from tactileforge.hub.file_checks import towers_of
from tactileforge.plugins import registry

#: Name of the head of the objective ``align``, and of its entry in a header.
ALIGN = "align"
_TOWER = "text_encoder."


def reads_files(node: Mapping[str, Any]) -> bool:
    """Whether an encoder reads other files on construction, as CLIP's towers do."""
    plugin = registry.get("encoders", node["name"])
    return "constructing does no io" in getattr(plugin, "expected_failures", {})


def aligned_head(
    config: Mapping[str, Any], encoder: Any, state: Mapping[str, Tensor]
) -> tuple[nn.Module, dict[str, Any], dict[str, Tensor]] | None:
    """The text side of a run's aligned head; camera images are left out.

    A tower that reads files where it is built is left out too, where training did not change it.

    Args:
        config: Configuration of the run.
        encoder: Encoder of the run.
        state: Tensors of the head.

    Returns:
        The head, its entry of the header and its tensors; None where nothing was aligned with text,
        or the tower was trained and cannot be kept.
    """
    if "text_project.weight" not in state:
        return None
    # no method of `Model` reads camera images
    kept = {key: tensor for key, tensor in state.items() if not key.startswith("image_")}
    tower = config["text_encoder"]
    entry: dict[str, Any] = {"node": dict(config["head"][ALIGN])}
    if reads_files(tower):
        if not tower.get("frozen", True):
            return None
        kept = {key: tensor for key, tensor in kept.items() if not key.startswith(_TOWER)}
        entry["text_width"] = state["text_project.weight"].shape[1]
        entry["text_name"] = tower["name"]
    else:
        entry["text_encoder"] = dict(tower)
    head = registry.build("heads", entry["node"], encoder=encoder, **towers_of(Path(), entry))
    return head, entry, kept
