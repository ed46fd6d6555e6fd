"""Headers with a bent structure: a model is loaded, or the file is named."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bent import bent

import tactileforge
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import DataError, TactileForgeError
from tactileforge.hub.files import make_header, save_checkpoint

NODE = {"name": "tactile_vit", "size": "tiny", "depth": 1, "frames": 2, "image_size": 32}
FACTS: dict[str, Any] = {
    "recipe": {"data": {"name": "x"}},
    "data": {"name": "x", "licences": ["MIT"]},
    "source": {"steps": 3},
}


class Bent:
    """A model file, and the same with another table of tensors or header."""

    def __init__(self, path: Path) -> None:
        vit = TactileViT("tiny", depth=1, frames=2, image_size=32)
        save_checkpoint(path, vit, make_header(vit, NODE, licence="MIT", spacing=0.1, **FACTS))
        raw = path.read_bytes()
        end = 8 + int.from_bytes(raw[:8], "little")
        self.path, self.numbers = path, raw[end:]
        self.table: dict[str, Any] = json.loads(raw[8:end])
        self.header = json.loads(self.table.pop("__metadata__")["tactileforge"])
        del self.header["sha256"]  # it would be another: structure alone is looked at

    def write(self, table: Any, header: Any) -> None:
        metadata = {"tactileforge": json.dumps(header)}
        text = json.dumps({"__metadata__": metadata, **table}).encode()
        self.path.write_bytes(len(text).to_bytes(8, "little") + text + self.numbers)

    def is_named(self) -> bool:
        try:
            model = tactileforge.load(self.path)
            assert 0 <= model.spacing < np.inf
            model.encode(np.zeros((model.frames, 32, 32, 3), np.uint8), "first", "digit")
        except TactileForgeError:
            return True
        return False


@pytest.fixture
def file(tmp_path: Path) -> Bent:
    return Bent(tmp_path / "a.safetensors")


@pytest.mark.slow
def test_a_table_of_tensors_that_is_bent_is_named(file: Bent) -> None:
    some = dict(list(file.table.items())[:2])
    rest = {name: entry for name, entry in file.table.items() if name not in some}
    file.write(some | rest, file.header)
    assert not file.is_named()
    changes = [(what, table) for what, table in bent(some) if table.items() != some.items()]
    assert len(changes) > 150
    for what, changed in changes:
        file.write(changed | rest, file.header)
        harmless = ("twice" in what and what.count(".")) or "offsets.0 = False" in what
        assert file.is_named() or harmless, what


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* was trained on:UserWarning")
def test_a_header_that_is_bent_is_named_or_loaded(file: Bent) -> None:
    named = 0
    for _, changed in list(bent(file.header, levels=3))[::7]:
        file.write(file.table, changed)
        named += file.is_named()
    assert named > 40


@pytest.mark.parametrize("recipe", [{}, {"data": None}])
def test_weights_without_a_recipe_are_loaded(file: Bent, recipe: dict[str, Any]) -> None:
    file.write(file.table, file.header | {"recipe": recipe})
    assert not file.is_named()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spacing": -0.1}, "spacing is -0.1, not seconds"),
        ({"spacing": float("inf")}, "spacing is inf"),
        ({"sensors": {"digit": -1}}, "sensors have rows"),
        ({"encoder": NODE | {"image_size": []}}, "tactile_vit cannot be built from its header"),
        ({"recipe": {"data": [1]}}, "recipe.data: expected names and values, found list"),
        (
            {"heads": {"force": {"node": {"name": "force"}, "scale": {"digit": [1, -2, 3]}}}},
            r"no newtons for digit: \[1, -2, 3\]",
        ),
    ],
)
def test_numbers_that_make_no_sense_are_named(
    file: Bent, change: dict[str, Any], message: str
) -> None:
    file.write(file.table, file.header | change)
    with pytest.raises(DataError, match=message):
        tactileforge.load(file.path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": [-1, -1536]}, "its shape, "),
        ({"shape": None}, "its shape, None, is not that of bytes"),
        ({"dtype": "F7"}, "is of type 'F7'; known: BOOL"),
        ({"data_offsets": [0]}, "has no data_offsets"),
        ({"data_offsets": [8, 4]}, "its shape, "),
    ],
)
def test_a_tensor_that_cannot_be_is_named(file: Bent, change: dict[str, Any], message: str) -> None:
    name = next(iter(file.table))
    file.write(file.table | {name: file.table[name] | change}, file.header)
    with pytest.raises(DataError, match=f"tensor '{name}' ?{message}|tensor '{name}': {message}"):
        tactileforge.load(file.path)
