"""Where a package of ours is installed from: as this one was."""

import json
from pathlib import Path

import pytest

from tactileforge.plugins import distributions
from tactileforge.plugins.distributions import how_to_get, install_command

CLONE = Path(__file__).parents[2]


@pytest.fixture
def origin(monkeypatch, tmp_path):
    """Says where this package was installed from; its sources are not beside it."""

    def note(said):
        class Installed:
            def read_text(self, name):
                assert name == "direct_url.json"
                return said and json.dumps(said)

        known = distributions.distribution
        monkeypatch.setattr(
            distributions,
            "distribution",
            lambda name: Installed() if name == "tactileforge" else known(name),
        )
        monkeypatch.setattr(distributions, "__file__", str(tmp_path / "a/b/c/d/distributions.py"))

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


def test_no_message_names_one_of_our_packages_to_an_index():
    """The messages of the core and of our packages: all of them ask `install_command`."""
    sources = [*(CLONE / "src").rglob("*.py"), *(CLONE / "plugins").glob("*/src/**/*.py")]
    assert len(sources) > 300
    for source in sources:
        text = source.read_text("utf-8")
        for package in distributions._OURS:
            assert f"install {package}\n" not in text, source
            assert f'install {package}"' not in text, source
        if source.name != "distributions.py":
            # `_slips` has the packages of Hydra's launchers
            assert source.name == "_slips.py" or "pip install {package}" not in text, source
