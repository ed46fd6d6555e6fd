"""Time to import the package, to list the zoo, and to load models of the zoo's and paper's size."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import torch
from common import save, side_by_side
from safetensors.torch import load_file

from tactileforge import load
from tactileforge.hub import files
from tactileforge.plugins import registry

ROUNDS = 9
#: Encoders of `scale=demo` and of the paper.
NODES = {
    "tiny": {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 64, "patch": 8},
    "base": {"name": "tactile_vit", "size": "base", "frames": 4},
}


def python(*words: str) -> Callable[[], object]:
    """Runs a new interpreter."""
    return lambda: subprocess.run([sys.executable, *words], check=True, capture_output=True)


def main() -> None:
    torch.set_num_threads(1)
    starts = side_by_side(
        {
            "python": python("-c", "pass"),
            "import tactileforge": python("-c", "import tactileforge"),
            "plugins list": python("-m", "tactileforge", "plugins", "list"),
            "zoo list": python("-m", "tactileforge", "zoo", "list"),
            "zoo show": python("-m", "tactileforge", "zoo", "show", "anytouch2"),
        },
        ROUNDS,
    )
    result: dict[str, object] = {"new_process": starts}
    with tempfile.TemporaryDirectory() as folder:
        for size, node in NODES.items():
            encoder = registry.build("encoders", node)
            path = Path(folder) / f"{size}.safetensors"
            header = files.make_header(encoder, node, licence="MIT", spacing=1 / 15)
            files.save_checkpoint(path, encoder, header, "float16")
            subjects: dict[str, Callable[[], object]] = {
                "load": lambda path=path: load(path),  # type: ignore[misc]
                "safetensors": lambda path=path: load_file(path),  # type: ignore[misc]
            }
            times = side_by_side(subjects, ROUNDS)
            result[f"load_{size}"] = times | {"mb": round(path.stat().st_size / 1e6, 2)}
    save("hub", result)


if __name__ == "__main__":
    main()
