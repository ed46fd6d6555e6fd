"""Export of models to files for other runtimes: ``export``, and ``read_facts`` for their metadata.

- `facts`: metadata of a file; needs no torch
- `program`: the graph, by ``torch.export``; clips to compare it with the module
- `onnx_file`: the graph as ONNX; weights as int8
- `write`: from a model to a file, run and compared
- `verb`: ``tactileforge export``
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tactileforge_export.facts import Exported, read_facts

if TYPE_CHECKING:
    from tactileforge_export.write import export

__all__ = ["Exported", "export", "read_facts"]


def __getattr__(name: str) -> Any:
    if name == "export":
        from tactileforge_export.write import export

        return export
    raise AttributeError(f"module 'tactileforge_export' has no attribute {name!r}")
