"""Origins of installed packages: that of this one."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from tactileforge.plugins import distributions
from tactileforge.plugins.distributions import how_to_get, install_command
from tactileforge.util import origin as place

CLONE = Path(__file__).parents[2]


@pytest.fixture
def origin(monkeypatch, tmp_path):
    """Says where this package was installed from; its sources are not beside it."""

    def note(said):
        class Installed:
            requires = ('av>=14; extra == "av"', "torch>=2.6", 'b[c]>=1 ; extra == "av"')

            def read_text(self, name):
                assert name == "direct_url.json"
                return said and json.dumps(said)

        known = place.distribution
        monkeypatch.setattr(
            place,
            "distribution",
            lambda name: Installed() if name == "tactileforge" else known(name),
        )
        monkeypatch.setattr(place, "__file__", str(tmp_path / "a/b/c/d/origin.py"))

    return note


@pytest.mark.parametrize("editable", [True, False])
def test_from_a_clone_it_is_a_folder_of_that_clone(origin, monkeypatch, tmp_path, editable):
    origin({"url": CLONE.as_uri(), "dir_info": {"editable": editable}})
    monkeypatch.chdir(CLONE)
    assert install_command("tactileforge-depth") == "pip install ./plugins/tactileforge-depth"
    monkeypatch.chdir(tmp_path)
    assert (
        install_command("tactileforge-depth") == f"pip install {CLONE}/plugins/tactileforge-depth"
    )


def test_it_comes_with_what_it_needs_of_ours(origin, monkeypatch):
    origin({"url": CLONE.as_uri(), "dir_info": {}})
    monkeypatch.chdir(CLONE)
    monkeypatch.setattr(distributions, "_is_installed", lambda package: False)
    both = "./plugins/tactileforge-bench ./plugins/tactileforge-sim"
    said = install_command("tactileforge-bench")
    assert said.startswith(f"pip install {both}")
    assert "tactileforge-datasets" not in said, "an extra is not needed"
    monkeypatch.setattr(distributions, "_is_installed", lambda package: True)
    assert install_command("tactileforge-bench") == "pip install ./plugins/tactileforge-bench"


def test_from_a_wheel_it_is_the_wheel_beside_it(origin, tmp_path):
    folder = tmp_path / "my wheels"
    folder.mkdir()
    core = folder / "tactileforge-0.1.0-py3-none-any.whl"
    origin({"url": core.as_uri(), "archive_info": {}})
    wheel = folder / "tactileforge_sim-0.1.0-py3-none-any.whl"
    assert "WHEELS/tactileforge_sim-*.whl" in install_command("tactileforge-sim"), "none is there"
    wheel.touch()
    said = install_command("tactileforge-sim")
    assert said == f"pip install --find-links '{folder}' '{wheel}'"


def test_from_a_repository_it_is_a_folder_of_the_same_commit(origin):
    origin(
        {
            "url": "https://example.org/tf.git",
            "vcs_info": {"vcs": "git", "commit_id": "0f" * 20},
        }
    )
    assert install_command("tactileforge-sim") == (
        f"pip install 'tactileforge-sim @ git+https://example.org/tf.git@{'0f' * 20}"
        "#subdirectory=plugins/tactileforge-sim'"
    )


def test_without_a_note_no_index_is_asked_for_our_name(origin):
    origin(None)
    said = install_command("tactileforge-sim")
    assert "WHEELS/tactileforge_sim-" in said
    assert "install tactileforge-sim" not in said, "a stranger may have that name"


def test_every_package_is_found_in_this_clone(monkeypatch):
    monkeypatch.chdir(CLONE)
    for package in distributions._OURS:
        words = install_command(package).split()
        assert words[:2] == ["pip", "install"]
        for word in words[2:]:
            assert (CLONE / word / "pyproject.toml").is_file(), package


def test_what_no_package_of_ours_has_is_said_by_nothing():
    assert how_to_get("datasets", "lerobot").startswith("comes with tactileforge-lerobot: pip ")
    assert how_to_get("datasets", "nothing_of_ours") == ""


@pytest.mark.parametrize("editable", [True, False])
def test_an_extra_from_a_clone_is_of_its_folder(origin, monkeypatch, tmp_path, editable):
    origin({"url": CLONE.as_uri(), "dir_info": {"editable": editable}})
    edit = "-e " if editable else ""
    monkeypatch.chdir(CLONE)
    assert install_command("tactileforge[av]") == f"pip install {edit}'.[av]'"
    said = install_command("tactileforge-export[onnx]")  # as that package is installed here
    assert said == "pip install -e './plugins/tactileforge-export[onnx]'"
    monkeypatch.chdir(tmp_path)
    assert install_command("tactileforge[av]") == f"pip install {edit}'{CLONE}[av]'"


def test_an_extra_without_a_clone_is_what_it_requires(origin):
    origin({"url": "file:///w/tactileforge-0.1.0-py3-none-any.whl", "archive_info": {}})
    assert install_command("tactileforge[av]") == "pip install 'av>=14' 'b[c]>=1'"
    said = install_command("tactileforge-export[onnx]")
    assert said == "pip install 'onnx>=1.17' 'onnxruntime>=1.20' 'onnxscript>=0.3'"


def _arguments(text):
    """Words of each `pip install` of a text; braces are expanded."""
    for found in re.finditer(r"pip install ((?:[^`#)|\n]|\n(?=\./))+)", text):
        words = []
        for word in found[1].rstrip("\\n").replace("\\", "").split():
            word = word.strip("'\"").rstrip(",.;:").rstrip("'\"")
            many = re.fullmatch(r"(.*)\{([\w,-]+)\}(.*)", word)
            words += [many[1] + one + many[3] for one in many[2].split(",")] if many else [word]
        yield words


def _sources():
    code = [*(CLONE / "src").rglob("*.py"), *(CLONE / "plugins").glob("*/src/**/*.py")]
    assert len(code) > 300
    pages = [CLONE / "README.md", CLONE / "CONTRIBUTING.md", *(CLONE / "plugins").glob("*/*.md")]
    for folder in ("docs", "zoo", "conf"):
        for ending in ("md", "ipynb", "yaml"):
            pages += (CLONE / folder).rglob(f"*.{ending}")
    assert len(pages) > 100
    return [*code, *pages]


def test_no_message_or_page_names_one_of_our_packages_to_an_index():
    """Messages ask `install_command` or `install_extra`; pages install folders of a clone."""
    ours = re.compile(r"(tactileforge|lerobot_camera_tactileforge)([\[=<>~!].*)?")
    found = []
    for source in _sources():
        text = source.read_text("utf-8")
        for words in _arguments(text):
            for word in words:
                name = re.split(r"[\[=<>~!]", word)[0]
                if ours.fullmatch(word) or name in distributions._OURS:
                    found.append(f"{source.relative_to(CLONE)}: {word}")
        if source.suffix == ".py" and source.name not in ("distributions.py", "_slips.py"):
            # `_slips` has the packages of Hydra's launchers
            assert "pip install {package}" not in text, source
    # the page that says what comes of it
    assert found == ["docs/install.md: tactileforge-sim"]


def test_pages_install_a_package_of_ours_with_those_it_needs():
    """pip would look for these on an index."""
    seen = 0
    for source in _sources():
        if source.suffix == ".py":
            continue
        for words in _arguments(source.read_text("utf-8")):
            names = {word.partition("plugins/")[2].partition("[")[0] for word in words} - {""}
            names = {name for name in names if (CLONE / "plugins" / name).is_dir()}
            for name in names:
                seen += 1
                project = CLONE / "plugins" / name / "pyproject.toml"
                needs = tomllib.loads(project.read_text("utf-8"))["project"]["dependencies"]
                own = {need.split(">")[0] for need in needs if need.startswith("tactileforge-")}
                assert own <= names, f"{source.relative_to(CLONE)}: {name} needs {own - names}"
    assert seen > 60


def test_an_install_for_an_index_is_found():
    text = "`pip install 'tactileforge[av]'`\n%pip install -q tactileforge\npip install x \\\n./y"
    assert list(_arguments(text)) == [["tactileforge[av]"], ["-q", "tactileforge"], ["x", "./y"]]
    assert list(_arguments("(`pip install ./p/a-{b,c}` d)")) == [["./p/a-b", "./p/a-c"]]
