import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from tactileforge.errors import ConfigError
from tactileforge.packing import PackOptions, pack
from tactileforge.strict import build

GIVEN = {"codec": "png", "shard_frames": 24, "processes": 2, "executor": "ray"}


@pytest.mark.slow
def test_ray_gives_the_same_shards_though_a_worker_dies(
    packable: ModuleType, command: Callable[..., "subprocess.Popen[str]"], tmp_path: Path
) -> None:
    pytest.importorskip("ray")
    pack(
        packable.Touches(), "touches", tmp_path / "here", PackOptions(codec="png", shard_frames=24)
    )
    deaths = tmp_path / "deaths"
    deaths.mkdir()
    process = command(tmp_path / "ray", GIVEN, deadly=str(deaths))
    _, said = process.communicate(timeout=180)
    assert process.returncode == 0, said
    assert len(list(deaths.iterdir())) == 1
    for path in (tmp_path / "here").rglob("*"):
        if path.is_file():
            there = tmp_path / "ray" / path.relative_to(tmp_path / "here")
            assert there.read_bytes() == path.read_bytes(), path.name


@pytest.mark.slow
def test_a_worker_that_dies_twice_names_the_shard(
    command: Callable[..., "subprocess.Popen[str]"], tmp_path: Path
) -> None:
    pytest.importorskip("ray")
    deaths = tmp_path / "deaths"
    deaths.mkdir()
    process = command(tmp_path / "ray", GIVEN, deadly=str(deaths), deaths=9)
    _, said = process.communicate(timeout=180)
    assert process.returncode == 1, said
    assert len(list(deaths.iterdir())) == 2
    assert "the process that made it was killed, twice" in said
    assert "train/2/" in said


def test_without_ray_the_error_says_how_to_get_it(
    packable: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ConfigError, match=r"pip install 'tactileforge\[ray\]'"):
        pack(packable.Touches(), "touches", tmp_path, build(PackOptions, "pack", GIVEN))
