"""The sensor packages in plugins/: listed, checked, and their own tests, installed for real."""

import os
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace

import cv2
import pytest

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.errors import PluginError
from tactileforge.hub import cards
from tactileforge.hub.file_checks import check_plugin
from tactileforge.plugins import distributions, metadata, registry
from tactileforge.specs.published import spec
from tactileforge.testing.results import CheckSubject, run_check
from tactileforge.testing.trained_encoders import exported_it_is_the_same
from tactileforge.training import parts

ROOT = Path(__file__).parents[1]
NAMES = ("anyskin", "digit", "dmtac", "flexitac", "ft", "gelsight")
OURS = ("tactileforge-arrays",)  # installed beside the core, and what others build on
PACKAGES = [ROOT / f"plugins/tactileforge-{name}" for name in NAMES]
SENSORS = {
    "anyskin": ("array", (3, 3)),
    "ati_netft": ("wrench", (0, 0)),
    "digit": ("image", (320, 240)),
    "dmtac": ("image", (288, 384)),
    "dmtac_sdk": ("image", (288, 384)),
    "flexitac": ("array", (12, 32)),
    "gelsight_mini": ("image", (240, 320)),
    "gelsight_mini_markers": ("image", (240, 320)),
    "reskin": ("array", (3, 3)),
    "robotiq": ("wrench", (0, 0)),
}


@pytest.mark.parametrize("path", PACKAGES, ids=NAMES)
def test_without_it_the_package_of_a_sensor_is_named(path: Path) -> None:
    project = tomllib.loads((path / "pyproject.toml").read_text())["project"]
    for name in project["entry-points"]["tactileforge.sensors"]:
        with pytest.raises(PluginError, match=f"pip install .*/plugins/{project['name']}( |$)"):
            registry.get("sensors", name)


@pytest.fixture
def only(monkeypatch):
    """Hides all packages but those named."""

    def hide(*kept):
        def found(group):
            return [entry for entry in entry_points(group=group) if entry.dist.name in kept]

        for module in (metadata, distributions):
            monkeypatch.setattr(module, "entry_points", found)
        clear()

    def clear():
        metadata.entries.cache_clear()
        cards.card_names.cache_clear()
        cards.read_card.cache_clear()

    yield hide
    clear()


@pytest.fixture
def alone(only):
    """As if no package but the core were installed."""
    only("tactileforge")


@pytest.fixture
def without_policies(only):
    """As if the core, the simulator and the bench were installed, and no other package."""
    only("tactileforge", "tactileforge-bench", "tactileforge-sim")


@pytest.mark.usefixtures("without_policies")
@pytest.mark.parametrize(
    "words",
    [
        ["rollout", "task=chip", "policy=expert"],
        ["demos", "task=chip", "out=x"],
        ["train", "recipe=imitation"],
        ["train", "data=demonstrations", "data.root=x"],
        ["train", "data=recordings", "data.root=x", "objective=[imitate]"],
        ["train", "data=recordings", "objective=[pixel]", "+head@head.pixel=act"],
        ["bench", "suite=manipulation"],
        ["zoo", "show", "imitation"],
    ],
    ids=" ".join,
)
def test_without_the_package_of_policies_it_is_named(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(words) == 1
    said = capsys.readouterr().err
    assert said.rstrip().endswith("/plugins/tactileforge-policies")
    assert said.count("\n") == 1


@pytest.mark.usefixtures("alone")
def test_a_run_whose_package_is_gone_names_it(tmp_path):
    row = {"name": "imitate", "weight": 1.0}
    with pytest.raises(PluginError, match=r"pip install \./plugins/tactileforge-policies$"):
        parts.build_parts(
            {"encoder": {"name": "pixels"}, "objective": {"imitate": row}, "head": {}}, frozenset()
        )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("data lerobot data=sim out=set", "data lerobot comes with tactileforge-lerobot"),
        ("data embed data=sim out=set", "data embed comes with tactileforge-lerobot"),
        ("export model=anytouch2.tiny", "export comes with tactileforge-export"),
        ("data inspect data=sim out=page.html", "data inspect comes with tactileforge-inspect"),
        ("train data=lerobot data.root=set", "data=lerobot comes with tactileforge-lerobot"),
        ("data pack data=lerobot out=set", "data=lerobot comes with tactileforge-lerobot"),
        ("train data=episodes data.root=set", "data=episodes comes with tactileforge-episodes"),
        ("data pack data=univtac out=set", "data=univtac comes with tactileforge-episodes"),
        ("train data=fota data.root=set", "data=fota comes with tactileforge-datasets"),
        ("train recipe=imitation", "recipe=imitation comes with tactileforge-policies"),
        ("train data=public_samples", "data=public_samples comes with tactileforge-datasets"),
        ("train data=rosbags data.root=set", "data=rosbags comes with tactileforge-rosbags"),
        ("train data=sim_array", "data=sim_array comes with tactileforge-arrays"),
        ("train", "data=sim comes with tactileforge-sim"),
        ("data pack data=sim out=set", "data=sim comes with tactileforge-sim"),
        ("bench suite=sim model=[pixels]", "bench comes with tactileforge-bench"),
        ("zoo gate touch.tiny runs/bench", "zoo gate comes with tactileforge-bench"),
        ("calibrate data=sim", "calibrate comes with tactileforge-live"),
        ("live sensor=sim", "live comes with tactileforge-live"),
        ("record sensor=sim out=set", "record comes with tactileforge-live"),
        ("sim out=set", "sim comes with tactileforge-sim"),
        (
            "train recipe=anytouch2_array data=recordings",
            "recipe=anytouch2_array comes with tactileforge-arrays",
        ),
        ("zoo show anytouch2_array", "anytouch2_array comes with tactileforge-arrays"),
    ],
)
def test_without_a_package_what_it_brings_is_named_in_a_line(words, said, alone, capsys):
    assert cli.run(words.split()) == 1
    command = f"pip install ./plugins/{said.split()[-1]}"
    assert capsys.readouterr().err == f"error: {said}: {command}\n"


@pytest.mark.usefixtures("alone")
def test_in_python_a_recipe_names_the_package_of_its_data():
    with pytest.raises(PluginError, match=r"^data=sim comes with tactileforge-sim: pip install"):
        compose("anytouch2", ["scale=demo"])


@pytest.mark.usefixtures("alone")
def test_a_file_imported_before_the_move_names_the_package_of_its_encoder():
    header = SimpleNamespace(
        encoder={"name": "resnet18"}, package="tactileforge", package_version="0.1.0"
    )
    with pytest.raises(PluginError, match=r"pip install \./plugins/tactileforge-published$"):
        check_plugin(Path("univtac.safetensors"), header)


@pytest.mark.usefixtures("without_policies")
@pytest.mark.parametrize(
    ("suite", "given"),
    [
        ("public_samples", ["public_samples.root=."]),
        ("real", []),
        ("sparsh", ["task=sparsh_slip_digit", "tasks.sparsh_slip_digit.data.root=."]),
    ],
)
def test_a_suite_of_published_sets_names_their_package(suite, given, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["bench", f"suite={suite}", *given, "model=[pixels]", "out=x"]
    assert cli.run(words) != 0
    said = "".join(capsys.readouterr())
    assert "plugins/tactileforge-datasets" in said


@pytest.mark.usefixtures("alone")
def test_without_the_package_of_published_encoders_an_import_names_it(capsys):
    assert cli.run(["zoo", "get", "anytouch2.base", "--from", "checkpoint-4frames.pth"]) == 1
    said = capsys.readouterr().err
    assert said.rstrip().endswith("pip install ./plugins/tactileforge-published")
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("kind", "name", "package"),
    [
        ("encoders", "vqgan", "tactileforge-published"),
        ("encoders", "timm", "tactileforge-timm"),
        ("encoders", "timm_image", "tactileforge-timm"),
        ("heads", "published_force", "tactileforge-published"),
        ("datasets", "octopi", "tactileforge-datasets"),
        ("datasets", "webdataset", "tactileforge-datasets"),
        ("datasets", "feats", "tactileforge-datasets"),
        ("datasets", "lerobot", "tactileforge-lerobot"),
        ("datasets", "sim", "tactileforge-sim"),
        ("datasets", "sim_array", "tactileforge-arrays"),
        ("datasets", "episodes", "tactileforge-episodes"),
        ("sensors", "serial_array", "tactileforge-arrays"),
        ("sensors", "sim_robot", "tactileforge-sim"),
    ],
)
def test_without_a_package_a_configuration_that_needs_it_names_it(kind, name, package, alone):
    with pytest.raises(PluginError, match=rf"pip install \./plugins/{package}$"):
        registry.build(kind, {"name": name})


@pytest.mark.usefixtures("alone")
def test_without_the_package_of_export_its_check_is_skipped():
    subject = CheckSubject("encoders", registry.get("encoders", "pixels"), "pixels", {})
    result = run_check(exported_it_is_the_same, subject)
    assert result.status == "skipped"
    assert result.detail.endswith("pip install ./plugins/tactileforge-export")


def test_our_packages_bring_what_is_said_of_them():
    for package, kinds in distributions._OURS.items():
        folder = ROOT / "plugins" / package
        entries = project(folder).get("entry-points", {})
        places = list(entries.get("tactileforge.conf", {}).values())
        yamls = {
            f"{path.parent.name}/{path.stem}"
            for place in places
            for path in (folder / "src" / place.replace(".", "/")).glob("*/*.yaml")
        }
        for kind, names in kinds.items():
            group = "data" if kind == "datasets" else kind
            known = {*entries.get(f"tactileforge.{kind}", ())}
            assert {name for name in names if f"{group}/{name}" not in yamls} <= known, package
        brought = {kind.removeprefix("tactileforge."): {*names} for kind, names in entries.items()}
        for kind in ("datasets", "encoders", "heads", "objectives", "sensors", "verbs"):
            assert brought.get(kind, set()) <= {*kinds.get(kind, ())}, (package, kind)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of all of them installed, beside their sources."""
    work = tmp_path_factory.mktemp("packages")
    sources = [str(shutil.copytree(path, work / "sources" / path.name)) for path in PACKAGES]
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*command, "--target", str(work / "site"), *sources], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return work / "site"


@pytest.fixture
def known(installed, monkeypatch):
    """Their entry points, as if they were installed: quicker than pip."""
    for folder in PACKAGES:
        entries = project(folder).get("entry-points", {})["tactileforge.sensors"]
        lines = [f"{name} = {target}" for name, target in entries.items()]
        monkeypatch.syspath_prepend(folder / "src")
        installed(folder.name, "\n".join(["[tactileforge.sensors]", *lines]), {})


def project(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text())["project"]


@pytest.fixture
def run(site, warm):
    def run(name, *words):
        path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")]))
        return subprocess.run(
            [warm.bin / name, *words],
            cwd=site.parent,
            env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
        )

    return run


def test_each_package_has_what_a_package_needs():
    for folder in PACKAGES:
        facts = project(folder)
        assert facts["name"] == folder.name
        assert facts["license"] == "Apache-2.0"
        assert facts["dependencies"][0] == "tactileforge>=0.1,<0.2"
        assert {one.split(">")[0] for one in facts["dependencies"]} <= {"tactileforge", *OURS}
        readme = (folder / "README.md").read_text()
        for name in facts["entry-points"]["tactileforge.sensors"]:
            assert f"`{name}`" in readme or f"sensor={name}`" in readme
        assert list((folder / "tests").glob("test_*.py"))


def test_their_sensors_are_built_and_are_what_they_say(known):
    names = [folder.name for folder in PACKAGES]
    ours = {plugin.name for plugin in registry.list_plugins() if plugin.distribution in names}
    assert ours == set(SENSORS)
    for name, (kind, shape) in SENSORS.items():
        spec_built = registry.build("sensors", {"name": name}).spec
        assert (spec_built.kind, (spec_built.height, spec_built.width)) == (kind, shape)
        assert spec(spec_built.name).name == spec_built.name  # data sets and encoders look it up


@pytest.mark.slow
def test_they_are_checked_by_the_command_line(run):
    """With nothing attached."""
    done = run("tactileforge", "plugins", "check", "--kind", "sensor", *SENSORS)
    assert done.returncode == 0, done.stdout
    assert ", 0 failed, 0 expected, " in done.stdout.splitlines()[-1]
    for name in SENSORS:
        assert f"sensor {name}\n" in done.stdout


@pytest.mark.slow
def test_their_own_tests_pass(site, run):
    tests = [str(site.parent / "sources" / path.name / "tests") for path in PACKAGES]
    config = str(site.parent / "sources" / PACKAGES[0].name / "pyproject.toml")
    options = ["-q", "-p", "no:cacheprovider", "-c", config, "--rootdir", str(site.parent)]
    done = run("pytest", *options, *tests)
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout


#: What timm and its package need beside the environment of the core: no torch, nor what it brings.
OF_TIMM = ("timm>=1.0.20", "torchvision", "peft>=0.17", "accelerate", "psutil")


@pytest.fixture(scope="module")
def timm_site(tmp_path_factory):
    """The folder of timm's package installed with timm, beside the environment of the core."""
    work = tmp_path_factory.mktemp("timm")
    source = shutil.copytree(ROOT / "plugins/tactileforge-timm", work / "source")
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-compile"]
    install += ["--target", str(work / "site")]
    # any torchvision does: its networks are not used, and tests declare operators that it misses
    done = subprocess.run([*install, *OF_TIMM], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"timm cannot be installed here: {done.stderr.strip().splitlines()[-1]}")
    done = subprocess.run(
        [*install, "--no-build-isolation", str(source)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return work / "site"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_tests_of_the_package_of_timm_pass(timm_site):
    shared = ROOT / "tests/helpers"  # graphs are traced faster, and figures not drawn
    places = [str(timm_site), str(shared), os.environ.get("PYTHONPATH", "")]
    path = os.pathsep.join(filter(None, places))
    plugins = ["-p", "shared_fixtures", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *plugins, "tests"],
        cwd=ROOT / "plugins/tactileforge-timm",  # beside its page, whose code is run, too
        env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


@pytest.mark.realdata
def test_the_real_video_of_a_gel_with_markers(known, realdata):
    """A recording already cut: nothing more is cut off."""
    path = str(realdata / "gelsight_mini_marker_video" / "mini_example.avi")
    capture = cv2.VideoCapture(path)
    width, height = (int(capture.get(c)) for c in (cv2.CAP_PROP_FRAME_WIDTH, 4))
    capture.release()
    options = {"device": path, "width": width, "height": height, "border": 0.0}
    name = "gelsight_mini_markers"
    with registry.build("sensors", {"name": name, **options}) as sensor:
        frame = sensor.read()
    assert frame.array.shape == (240, 320, 3)
    grey = cv2.cvtColor(frame.array, cv2.COLOR_RGB2GRAY)
    dark = cv2.connectedComponentsWithStats((grey < 70).astype("uint8"))[2][1:, cv2.CC_STAT_AREA]
    assert 40 <= sum(dark > 20) <= 100  # 7 x 9 to 8 x 10 markers
