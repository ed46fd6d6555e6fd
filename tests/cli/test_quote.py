"""Values with special characters: one rule on every verb."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from PIL import Image

from tactileforge import cli
from tactileforge.cli._quote import at_home, for_hydra, quoted, split, unquoted
from tactileforge.errors import command

NAMES = [
    *("in/Prüfstand", "a b", "touches (1)", "touches(1)", "a=b", "数据", "a,b", "it's", 'say "x"'),
    *("a\\b", "a\\", "a\\'b", "2024_05", "2024", "true", "a$b", "a;b", "a#b", "a&b", "!a", "100%"),
    *("a'b,c", "C:\\x y\\", "a]", "{x}", "(", "~", "~/ü"),
]


@pytest.mark.parametrize("name", NAMES)
def test_a_path_is_what_was_typed(name: str) -> None:
    word = for_hydra(f"data.root={name}")
    assert OverridesParser.create().parse_override(word).value() == at_home(name)
    assert for_hydra(word) == word, "a word that is quoted stays as it is"


def test_what_hydra_reads_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    kept = ["optim.lr=1e-3", "objective=[pixel,diff]", "labels={who: ana}", "data.root=null"]
    kept += ["hydra.run.dir=runs/${now:%Y}", "a='b c'", "objective=[pixel,diff", "~augment", "a="]
    assert [for_hydra(word) for word in kept] == kept
    assert for_hydra("data.root=a,ü", sweeps=True) == "data.root='a','ü'"
    assert for_hydra("seed=range(3)", sweeps=True) == "seed=range(3)"
    assert for_hydra("model=[file:ü.safetensors,pixels]") == "model=['file:ü.safetensors',pixels]"
    assert for_hydra("labels={who: Jürg}") == "labels={who: 'Jürg'}"
    Path("a,b").mkdir()
    assert for_hydra("data.root=a,b", sweeps=True) == "data.root='a,b'", "it is a folder"


def test_home_is_found_behind_the_equals_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/jü")
    assert at_home("~/a") == "/home/jü/a"
    assert at_home("file:~/a") == "file:/home/jü/a"
    assert at_home("[~/a,b]") == "[/home/jü/a,b]"
    assert at_home("a~/b") == "a~/b"
    assert at_home("~nobody-of-this-name/a") == "~nobody-of-this-name/a"


def test_quotes_are_taken_off_once() -> None:
    for name in ("it's", "a\\", "a b", 'x"y'):
        assert unquoted(quoted(name)) == name
    assert unquoted("'a','b'") == "'a','b'"
    assert split("a,[b,c],'d,e',it's,f") == ["a", "[b,c]", "'d,e'", "it's", "f"]


LAYOUT = 'layouts:\n  x: {images: "*.png", each: touch, sensor: digit, background: none}\n'


@pytest.mark.parametrize("folder", ["Prüfstand", "a b (1)", "a=b,c", "数据's"])
@pytest.mark.parametrize("way", ["data.root={}", "data.root='{}'", "--data.root"])
def test_recordings_in_any_folder(
    folder: str,
    way: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(folder).mkdir()
    pixels = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
    Image.fromarray(pixels).save(Path(folder) / "0.png")
    (Path(folder) / "tactileforge.yaml").write_text(LAYOUT)
    escaped = folder.replace("'", "\\'") if "'{}'" in way else folder
    words = [way.format(escaped)] if "{}" in way else [way, folder]
    assert cli.run(["data", "inspect", "data=recordings", *words, f"out={folder}.html"]) == 0
    assert capsys.readouterr().out.startswith("1 recordings, 1 frames")
    assert Path(f"{folder}.html").is_file()


@pytest.mark.parametrize("way", ["{}", "'{}'", '"{}"'])
def test_a_verb_without_hydra_has_the_same_rule(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "hö me"))
    (tmp_path / "hö me").mkdir()
    words = ["plugins", "new", "objective", "mine"]
    assert cli.run([*words, f"out={way.format('~/a b')}"]) == 0
    folder = tmp_path / "hö me" / "a b" / "tactileforge-mine"
    assert folder.is_dir()
    printed = capsys.readouterr().out.partition("next: ")[2].partition(" && ")[0]
    said = subprocess.run(["bash", "-c", f"printf '%s\\n' {printed}"], capture_output=True)
    assert said.stdout.decode().splitlines()[-1] == str(folder), "it can be pasted"


def test_a_command_that_is_printed_can_be_pasted(capsys: pytest.CaptureFixture[str]) -> None:
    line = command("train", "data=sim", "data.cache=in/a b (1)'s", "--cfg", "job")
    said = subprocess.run(["bash", "-c", f"printf '%s\\n' {line}"], capture_output=True, text=True)
    assert cli.run(said.stdout.splitlines()[1:]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["data"]["cache"] == "in/a b (1)'s"
