import json
import os
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from functools import partial
from pathlib import Path

import pytest
import yaml

from tactileforge.cli import dispatch
from tactileforge.cli.plugins import _paths
from tactileforge.errors import ConfigError, PluginError, SensorError
from tactileforge.plugins import metadata, registry

main = partial(dispatch, "plugins")

ROOT = Path(__file__).parents[2]

TOYS = """
from tactileforge.contracts import SensorSpec
class Good:
    spec = SensorSpec(name="g", height=6, width=8, fps=30, area_mm=None, force_scale=(1., 1., 1.))
    def __init__(self, gain: float = 1.0, size: int = 1):
        if gain > 2: raise ValueError("too loud")
    def discover(self): return []
    def open(self): raise OSError("no device")
    def read(self, timeout=1.0): raise NotImplementedError
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *error): pass
"""
ENTRY_POINTS = "[tactileforge.sensors]\ntoy = toy_plugins:Good"


@pytest.fixture
def toy(installed):
    source = TOYS.replace("raise NotImplementedError", "raise TactileForgeError('closed')")
    source = "from tactileforge.errors import TactileForgeError\n" + source
    installed("toy-plugins", ENTRY_POINTS, {"toy_plugins.py": source})


def test_a_container_is_checked_on_a_file(monkeypatch):
    monkeypatch.setitem(metadata.registered, ("containers", "grain"), object)
    with pytest.raises(PluginError, match=r"'grain' is a container, .*check_container\(FILE\)"):
        main(["check", "grain"])


def test_list_aligns_its_columns(toy, capsys):
    assert main(["list"]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split() == ["name", "kind", "distribution", "version", "status"]
    row = next(row for row in rows if row.startswith("toy "))
    assert row.split() == ["toy", "sensor", "toy-plugins", "1.0", "ok"]
    assert row.index("toy-plugins") == header.index("distribution")
    assert row.index("ok") == header.index("status")


def test_list_as_json(toy, capsys):
    assert main(["list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {
        "name": "toy",
        "kind": "sensor",
        "target": "toy_plugins:Good",
        "distribution": "toy-plugins",
        "version": "1.0",
        "status": "ok",
    } in rows
    assert [row["name"] for row in rows if row["kind"] == "objective"][:2] == ["align", "classify"]


def test_list_imports_nothing_heavy(lightly):
    assert "tactile_vit" in lightly(
        ["plugins", "list"], without="torch lightning hydra omegaconf cv2"
    )


def test_check_prints_each_result_and_the_sum(toy, capsys):
    assert main(["check", "toy"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("sensor toy\n  ran      name is snake case\n")
    assert "  skipped  frames are as specified: it cannot be opened, and no device is found" in out
    assert out.endswith("11 ran, 0 failed, 0 expected, 4 skipped\n")


def test_check_passes_options_on_and_fails_by_exit_code(toy, capsys):
    assert main(["check", "toy", "--kind", "sensor", "gain=3.5"]) == 1
    said = capsys.readouterr().out
    once = r"failed   constructing does no io and 8 more checks: \S+\.py:\d+: ValueError: too loud"
    assert re.search(once, said)
    assert said.count("too loud") == 1


@pytest.mark.slow
def test_check_takes_every_kind_that_has_the_name(capsys):
    assert main(["check", "clip", "replay"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if not line.startswith("  ")]
    assert lines[:2] == ["sensor replay", "encoder clip"]


PARTS = (
    TOYS
    + """
import torch
from torch import nn
from tactileforge.encoders import TactileViT
class Sign(torch.optim.Optimizer):
    def __init__(self, params, lr: float = 1e-3): super().__init__(params, {"lr": lr})
    @torch.no_grad()
    def step(self, closure=None):
        with torch.enable_grad():
            loss = closure() if closure is not None else None
        for group in self.param_groups:
            for one in group["params"]:
                if one.grad is not None: one -= group["lr"] * one.grad.sign()
        return loss
class Read(nn.Module):
    def __init__(self, encoder, width: int = 8):
        super().__init__()
        self.layer = nn.Linear(encoder.projected, width)
    def forward(self, views, batch): return self.layer(views.full.cls)
class Small(nn.Module):
    head, needs = Read, frozenset()
    def forward(self, prediction, batch): return prediction.square().mean(), {}
class Net(TactileViT): pass
class Odd: pass
def rate(step, warm, total): return 1.0
"""
)


def own_module(folder, monkeypatch, words, said):
    """Writes the classes above as a module, of a name of its own in this process."""
    name = f"own_{folder.name}"
    monkeypatch.chdir(folder)
    Path(f"{name}.py").write_text(PARTS)
    return [word.replace("OWN", name) for word in words], said.replace("OWN", name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "first", "last"),
    [
        (["OWN:Good"], "sensor OWN:Good", "8 ran, 1 failed, "),
        (["OWN:Good", "gain=3.5"], "sensor OWN:Good", "4 ran, 9 failed, "),
        (["./OWN.py:Sign"], "optimizer ./OWN.py:Sign", "10 ran, 0 failed, "),
        (["OWN:Read", "width=4"], "head OWN:Read", "10 ran, 0 failed, "),
        (["OWN:Small"], "objective OWN:Small", "11 ran, 0 failed, "),
        (["OWN:Net", "kind=head"], "head OWN:Net", " failed, 0 expected"),
    ],
)
def test_check_takes_a_class_of_ones_own(words, first, last, tmp_path, monkeypatch, capsys):
    words, first = own_module(tmp_path, monkeypatch, words, first)
    assert main(["check", *words]) == int(", 0 failed, " not in last)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == first
    assert last in lines[-1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["OWN:Odd"], "nothing tells which kind of plugin Odd is: give kind=, one of sensor"),
        (["OWN:rate"], "nothing tells which kind of plugin function is"),
        (["OWN:Odd", "kind=dataset"], r"OWN:Odd has no recordings, no provides"),
        (["OWN:Smal"], r"OWN has no 'Smal'.*'Small'"),
        (["OWN.Small"], "A class of yours is OWN:Small"),
    ],
)
def test_check_of_what_is_no_plugin_is_one_line(words, message, tmp_path, monkeypatch):
    words, message = own_module(tmp_path, monkeypatch, words, message)
    with pytest.raises(PluginError, match=message):
        main(["check", *words])


def test_the_kind_of_a_class_is_known():

    from tactileforge.checks import Check
    from tactileforge.encoders import TactileViT
    from tactileforge.heads import PixelHead
    from tactileforge.testing import kind_of

    class Own(Check):
        pass

    Replay = registry.get("sensors", "replay")
    assert [kind_of(one) for one in (Own, TactileViT, PixelHead, Replay)] == [
        *("checks", "encoders", "heads", "sensors")
    ]


def test_check_of_attached_sensors_opens_each_device(installed, capsys):
    """Two devices are attached, and the second cannot be opened."""
    source = """
from tactileforge.errors import SensorError
from tactileforge_sim.sensors.sim_wrench import SimWrench
class Bench(SimWrench):
    def __init__(self, port: str = "", fps: float = 100.0):
        super().__init__(fps=fps)
        self.port = port
    def discover(self):
        return ["/dev/one", "/dev/two"]
    def open(self):
        if self.port != "/dev/one": raise SensorError(f"{self.port}: busy")
        super().open()
"""
    installed("bench-plugins", "[tactileforge.sensors]\nbench = bench:Bench", {"bench.py": source})
    assert main(["check", "bench", "replay", "pixel", "--attached"]) == 1
    out = capsys.readouterr().out
    one, two = out.removeprefix("sensor bench port=/dev/one\n").split(
        "sensor bench port=/dev/two\n"
    )
    assert "failed" not in one
    assert "ran      frames are as specified" in one
    assert "failed   frames are as specified and 3 more checks: SensorError: /dev/two: busy" in two
    assert "replay" not in out  # its path is not given
    assert "pixel" not in out


def test_check_of_attached_sensors_where_there_are_none(toy):
    with pytest.raises(SensorError, match="none of the sensors is attached: plug one in"):
        main(["check", "toy", "--attached"])


def test_check_of_attached_sensors_names_a_broken_one(installed, capsys):
    installed("broken", "[tactileforge.sensors]\nbroken = broken:X", {"broken.py": "1 / 0"})
    assert main(["check", "broken", "--attached"]) == 1
    assert "failed   it can be imported" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "error", "message"),
    [
        (
            ["check", "pixle"],
            PluginError,
            r"'pixle'; did you mean 'pixel'\? \d+ are known. See them",
        ),
        (
            ["check", "real"],
            PluginError,
            "'real' is a suite, .*bench suite=real --cfg job composes",
        ),
        (
            ["check", "cosine"],
            PluginError,
            "'cosine' is a schedule, which has no conformance suite",
        ),
        (["new", "objective", "shiny", "fron=a:B"], ConfigError, "'fron'; did you mean 'from'"),
        (["check", "bench", "arrays"], PluginError, "'arrays' is a package of options, which has"),
        (["check", "pixel", "--kind", "sensor"], PluginError, "unknown sensor 'pixel'"),
        (["check", "pixel", "a=1"], ConfigError, "a= is an option of one plugin, and 2"),
        (["new", "sensor", "MySensor"], ConfigError, "use snake_case, e.g. my_sensor"),
        (["new", "sensor", "none"], ConfigError, "'none' is not a name"),
        (["new", "objective", "pixel"], ConfigError, "an installed objective has the name 'pixel'"),
        (
            ["new", "check", "digit"],
            ConfigError,
            "tactileforge-digit is a package of tactileforge's",
        ),
    ],
)
def test_words_that_do_not_fit(argv, error, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=message):
        main(argv)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words", [["objective", "shiny"], ["objective", "shiny", "from=OWN:Small"]]
)
@pytest.mark.parametrize("licence", [None, "MIT", "LicenseRef-lab"])
def test_new_says_how_to_publish_and_takes_a_licence(words, licence, tmp_path, monkeypatch):
    words, _ = own_module(tmp_path, monkeypatch, words, "")
    assert main(["new", *words, *([f"licence={licence}"] if licence else [])]) == 0
    folder = tmp_path / "tactileforge-shiny"
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    assert project.get("license") == licence
    assert project["dependencies"][0] == "tactileforge>=0.1,<0.2"
    readme = (folder / "README.md").read_text()
    assert "Apache" not in readme, "that is the example's"
    section = readme.partition("## Publish it\n")[2]
    assert "python -m build\ntwine upload dist/*\n" in section
    assert "`pip install tactileforge-shiny`" in section
    assert ("It has no licence yet" in section) == (licence is None)
    assert (f"Its licence is {licence}" in section) == (licence is not None)


def test_new_refuses_a_licence_that_is_none(tmp_path):
    with pytest.raises(ConfigError, match=r"licence.*'MTI'"):
        main(["new", "sensor", "shiny", "licence=MTI", f"out={tmp_path}"])
    assert not any(tmp_path.iterdir())


def test_new_refuses_to_overwrite(tmp_path):
    assert main(["new", "sensor", "my_sensor", "--out", str(tmp_path)]) == 0
    kept = tmp_path / "tactileforge-my-sensor/README.md"
    kept.write_text("mine")
    with pytest.raises(ConfigError, match="tactileforge-my-sensor exists"):
        main(["new", "sensor", "my_sensor", "--out", str(tmp_path)])
    assert kept.read_text() == "mine"


FILES = {
    "sensor": {"sensor.py", "synthetic.py", "test_sensor.py"},
    "dataset": {"dataset.py", "synthetic.py", "test_dataset.py"},
    "encoder": {"encoder.py", "test_encoder.py"},
    "objective": {"objective.py", "head.py", "test_objective.py"},
    "optimizer": {"optimizer.py", "test_optimizer.py"},
    "container": {"container.py", "test_container.py"},
    "verb": {"verb.py", "test_verb.py"},
    "suite": {"shiny_thing.yaml", "test_suite.py"},
}


@pytest.mark.parametrize("kind", FILES)
def test_what_new_copies_is_shipped(kind):
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    shipped = setuptools["package-data"]["tactileforge.example"]
    for path in _paths(kind):
        name = f"tactileforge-example/{path}"
        assert (ROOT / "plugins" / name).is_file()
        assert any(fnmatch(name, pattern) for pattern in shipped)


@pytest.mark.parametrize("kind", FILES)
def test_two_new_packages_share_no_name(kind, tmp_path):
    """Entry points, tasks of suites, codes of checks."""
    own = []
    for name in ("soft_skin", "worn_skin"):
        assert main(["new", kind, name, "--out", str(tmp_path)]) == 0
        folder = tmp_path / f"tactileforge-{name.replace('_', '-')}"
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        names = {(group, one) for group, all in project["entry-points"].items() for one in all}
        for path in folder.rglob("conf/*/*.yaml"):
            names |= {("task", task) for task in yaml.safe_load(path.read_text())["tasks"]}
        for path in folder.rglob("check.py"):
            (code,) = re.findall(r'code = "([A-Z]{2,4}[0-9]{3})"', path.read_text())
            names.add(("code", code))
        own.append(names)
    assert not own[0] & own[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_new_package_passes_its_own_tests_once_installed(kind, tmp_path, capsys, warm):
    assert main(["new", kind, "shiny_thing", "--out", str(tmp_path)]) == 0
    folder = tmp_path / "tactileforge-shiny-thing"
    assert f"pip install -e {folder}" in capsys.readouterr().out
    files = {path.name for path in folder.rglob("*") if path.is_file()}
    assert files == {"pyproject.toml", "README.md", "__init__.py"} | FILES[kind]
    text = "".join(path.read_text() for path in folder.rglob("*") if path.is_file())
    words = ("tactileforge-example", "tactileforge_example", "dummy", "Dummy", "contact_area")
    for old in (*words, "small_cnn", "npy_folder", "NpyFolder"):
        assert old not in text
    groups = tomllib.loads((folder / "pyproject.toml").read_text())["project"]["entry-points"]
    several = {"objective": {"heads", "objectives"}, "optimizer": {"optimizers", "schedules"}}
    expected = (several | {"suite": {"conf"}}).get(kind, {f"{kind}s"})
    assert set(groups) == {f"tactileforge.{group}" for group in expected}

    _passes_its_tests(folder, tmp_path / "site", warm)


def _passes_its_tests(folder, site, warm):
    """Installs a package into a folder of its own, and runs its tests there."""
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*pip, "--target", str(site), str(folder)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [warm.bin / "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


OWN = """
import torch
from torch import nn


class TwoCrops(nn.Module):
    def __init__(self, encoder, width: int = 64) -> None:
        super().__init__()
        self.layer = nn.Linear(encoder.projected, width)

    def forward(self, views, batch):
        crop = {key: batch[key][..., 8:, 8:] for key in ("frames", "background")}
        return self.layer(views.full.cls), self.layer(views.other({**batch, **crop}).full.cls)


class Contrast(nn.Module):
    head, needs = TwoCrops, frozenset()

    def forward(self, prediction, batch):
        first, second = (nn.functional.normalize(x, dim=-1) for x in prediction)
        same = torch.arange(len(first), device=first.device)
        return nn.functional.cross_entropy(5 * first @ second.T, same), {}
"""


@pytest.fixture
def _own_losses(tmp_path, monkeypatch):
    """A module of one's own in the working directory, forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "own_losses.py").write_text(OWN)
    yield
    for name in ("own_losses", "own_split"):
        sys.modules.pop(name, None)


@pytest.mark.slow
@pytest.mark.usefixtures("_own_losses")
def test_a_package_of_a_local_class_passes_its_own_tests_once_installed(tmp_path, capsys, warm):
    assert main(["new", "objective", "from=own_losses:Contrast"]) == 0
    assert "plugins check contrast" in capsys.readouterr().out
    folder = tmp_path / "tactileforge-contrast"
    assert (folder / "src/tactileforge_contrast/objective.py").read_text() == OWN
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    assert project["dependencies"] == ["tactileforge>=0.1,<0.2", "torch"]
    assert {k: dict(v) for k, v in project["entry-points"].items()} == {
        "tactileforge.heads": {"contrast": "tactileforge_contrast.objective:TwoCrops"},
        "tactileforge.objectives": {"contrast": "tactileforge_contrast.objective:Contrast"},
    }
    _passes_its_tests(folder, tmp_path / "site", warm)


@pytest.mark.usefixtures("_own_losses")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["objective"], "give a name: plugins new objective my_objective"),
        (["objective", "from=own_losses:Contrats"], "did you mean 'Contrast'"),
        (["sensor", "x", "from=own_losses:Contrast"], "has no discover, no open"),
        (["verb", "x", "from=own_losses:Contrast"], "unknown kind with from= 'verb'"),
        (["objective", "from=own_split:Contrast"], "line 1 of own_split.py imports own_losses"),
        (["objective", "from=own_losses:Contrast", "name=pixel"], "has the name 'pixel'"),
    ],
)
def test_a_package_is_made_of_one_file_with_the_contract(words, said, tmp_path):
    (tmp_path / "own_split.py").write_text(
        "import own_losses\nclass Contrast(own_losses.Contrast): pass\n"
        "class TwoCrops(own_losses.TwoCrops): pass\nContrast.head = TwoCrops"
    )
    with pytest.raises((ConfigError, PluginError), match=said):
        main(["new", *words])
    assert not list(tmp_path.glob("tactileforge-*"))


def test_a_plugin_that_exits_ends_neither_the_check_nor_the_others(installed, capsys):
    entry_points = "[tactileforge.sensors]\ngone = gone_plugins:Gone\ntoy = toy_plugins:Good"
    source = TOYS.replace("raise NotImplementedError", "raise TactileForgeError('closed')")
    modules = {
        "gone_plugins.py": "import sys\nsys.exit(3)",
        "toy_plugins.py": "from tactileforge.errors import TactileForgeError\n" + source,
    }
    installed("two-plugins", entry_points, modules)
    assert main(["check", "gone", "toy"]) == 1
    gone, toy = capsys.readouterr().out.split("sensor toy")
    assert "cannot be loaded: SystemExit: 3" in gone
    assert "  ran" in toy
    assert ", " in toy.splitlines()[-1], "the sum"


@pytest.mark.parametrize("name", ["ycb_slide", "recordings", "shards", "cloth"])
def test_a_data_set_that_needs_a_folder_is_skipped_with_that_word(name, capsys):
    assert main(["check", name, "--kind", "dataset"]) == 0
    out = capsys.readouterr().out
    assert "give options to check this: root=..." in out
    assert " 0 failed" in out
