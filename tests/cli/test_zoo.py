"""``tactileforge zoo``: light for lists, and true in each word."""

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import tactileforge
from tactileforge.cli import dispatch
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.runs.folder import LAST
from tactileforge.training.checkpoints import AtomicCheckpointIO

main = partial(dispatch, "zoo")


@pytest.mark.parametrize("words", [["list"], ["show", "anytouch2"], ["list", "--markdown"]])
def test_light_verbs_import_no_torch(words: list[str], lightly: Callable[..., str]) -> None:
    heavy = "torch lightning hydra cv2 numpy safetensors"
    assert "anytouch2" in lightly(["zoo", *words], without=heavy)


def test_load_needs_torch_only_when_it_loads() -> None:
    code = (
        "import sys, tactileforge\n"
        "try: tactileforge.load('nothing')\n"
        "except Exception as error: print(error)\n"
        "tactileforge.list_models()\n"
        "sys.exit('torch' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "unknown model 'nothing'" in done.stdout


def test_list_says_what_can_be_loaded(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "tvl.*"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["name", "title", "licence", "weights"]
    assert [row.split() for row in rows] == [
        ["tvl.vitb", "TVL", "Apache-2.0", "import"],
        ["tvl.vits", "TVL", "Apache-2.0", "import"],
        ["tvl.vittiny", "TVL", "Apache-2.0", "import"],
    ]
    with pytest.raises(ConfigError, match="no model matches"):
        main(["list", "nothing*"])


def test_show(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "mae", "details=true"]) == 0
    out = capsys.readouterr().out
    assert "CC-BY-NC-4.0" in out
    assert "1953.82 mN" in out
    assert "tactileforge train recipe=mae" in out
    assert main(["show", "clip"]) == 0
    assert "importer only" in capsys.readouterr().out
    assert main(["show", "anytouch2.base-2f", "details=true"]) == 0
    out = capsys.readouterr().out
    assert "2 frames, 0.2 s apart" in out
    assert "1076.33 mN" in out
    assert "894.32 mN" not in out
    assert "recipe=anytouch2" in out


@pytest.mark.parametrize(
    ("name", "purpose"),
    [
        ("anytouch2.tiny", "forces, shear and depth of the gel"),
        ("anytouch2.tiny-real", "objects, classes and other probes, of touches by a GelSight Mini"),
    ],
)
def test_show_begins_with_purpose_loading_licence_and_gate(
    name: str, purpose: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["show", name]) == 0
    first, second, third, *rest = capsys.readouterr().out.splitlines()
    assert first == f"{name}: {purpose}"
    load = f'load it: tactileforge.load("{name}"); licence of the weights: Apache-2.0'
    assert second == f"{load}; a demonstration"
    assert third.startswith("release gate: fails with ")
    assert len(rest) < 20
    assert rest[-1].endswith(f"zoo show {name} details=true")


def test_show_says_what_has_to_be_done_before_loading(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "anytouch2"]) == 0
    first, second, third, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("anytouch2.base: A CLIP-style vision transformer on")
    assert second.startswith("load it: tactileforge zoo get anytouch2.base --from FILE, then ")
    assert second.endswith("licence of the weights: NOASSERTION")
    assert third == "release gate: not measured"
    assert main(["show", "clip"]) == 0
    assert "load it: tactileforge zoo get clip.vitb16 accept=MIT, then " in capsys.readouterr().out
    assert main(["show", "imitation"]) == 0
    assert "\nno weights: tactileforge train recipe=imitation\n" in capsys.readouterr().out


def test_get_without_a_file_says_where_to_get_it() -> None:
    with pytest.raises(ConfigError, match=r"no licence: read .*zoo get anytouch2.base --from FILE"):
        main(["get", "anytouch2"])
    with pytest.raises(ConfigError, match=r"^accept='MIT': .* are under NOASSERTION: accept="):
        main(["get", "anytouch2", "accept=MIT"])
    with pytest.raises(DataNotFoundError, match="no such file; download it from https"):
        main(["get", "anytouch2", "--from", "nothing.pth"])


def test_pack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder with the files of a run is enough."""
    vit = TactileViT("tiny", frames=2, image_size=32)
    state = {f"encoder.{key}": value for key, value in vit.state_dict().items()}
    AtomicCheckpointIO().save_checkpoint({"state_dict": state, "global_step": 7}, tmp_path / LAST)
    (tmp_path / "config.yaml").write_text(
        "encoder: {name: tactile_vit, size: tiny, frames: 2, image_size: 32}\n"
        "batch: {spacing: 0.1}\ndata: {name: sim}\n"
    )
    out = tmp_path / "a.safetensors"
    assert main(["pack", str(tmp_path), f"out={out}", "dtype=float16", "name=a.b"]) == 0
    printed = capsys.readouterr().out
    assert f'tactileforge.load("file:{out}")' in printed
    model = tactileforge.load(f"file:{out}")
    assert (model.header.name, model.spacing) == ("a.b", 0.1)
    assert main(["show", f"file:{out}"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0] == "a.b: tactile_vit of tactileforge"
    assert f'load it: tactileforge.load("file:{out}")' in shown[1]
    assert "clip 2 frames, 0.1 s apart, 32 x 32" in [" ".join(line.split()) for line in shown]
    with pytest.raises(DataNotFoundError, match="nothing"):
        main(["show", "file:nothing.safetensors"])
    assert model.header.source == {"steps": 7, "encoder": "trained"}
    with pytest.raises(ConfigError, match="found none; give encoder=trained"):
        main(["pack", str(tmp_path), "encoder=slow"])
    with pytest.raises(ConfigError, match="did you mean 'dtype'"):
        main(["pack", str(tmp_path), "dtipe=float16"])
    with pytest.raises(ConfigError, match="float32 or float16"):
        main(["pack", str(tmp_path), "dtype=int8"])


def test_packing_does_not_depend_on_the_clock(tmp_path: Path) -> None:
    vit = TactileViT("tiny", frames=2, image_size=32)
    header = make_header(vit, {"name": "tactile_vit"}, licence="MIT", spacing=0.1)
    for name in ("a", "b"):
        save_checkpoint(tmp_path / name, vit, header)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
