"""Export of models to files for other runtimes: ``export``, and ``read_facts`` for their metadata.

- `export.facts`: metadata of a file; needs no torch
- `export.program`: the graph, by ``torch.export``; clips to compare it with the module
- `export.onnx_file`: the graph as ONNX; weights as int8
- `export.write`: from a model to a file, run and compared
- ``tactileforge export`` is in `cli.export`
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tactileforge.export.facts import Exported, read_facts

if TYPE_CHECKING:
    from tactileforge.export.write import export

__all__ = ["Exported", "export", "read_facts"]


def __getattr__(name: str) -> Any:
    if name == "export":
        from tactileforge.export.write import export

        return export
    raise AttributeError(f"module 'tactileforge.export' has no attribute {name!r}")
