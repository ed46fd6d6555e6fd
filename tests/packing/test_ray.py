import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from filelock import FileLock
from waiting import wait_until

from tactileforge.errors import ConfigError
from tactileforge.packing import PackOptions, pack
from tactileforge.util.strict import build

GIVEN = {"codec": "png", "shard_frames": 24, "processes": 2, "executor": "ray"}


@pytest.fixture(autouse=True)
def _one_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cluster at a time, over the workers of pytest: a second one may join the first."""
    root = tmp_path_factory.getbasetemp()
    shared = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    with FileLock(shared / "ray.lock"):
        yield


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
    same_files(tmp_path / "here", tmp_path / "ray")


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
    assert len(list(deaths.iterdir())) == 2, said
    assert "the process that made it was killed, twice" in said
    assert "train/2/" in said


CLUSTER = """
import sys
from ray.cluster_utils import Cluster

cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
node = cluster.add_node(num_cpus=1)
print(cluster.address, flush=True)
sys.stdin.readline()
cluster.remove_node(node, allow_graceful=False)
print("killed", flush=True)
sys.stdin.readline()
cluster.shutdown()
"""


@pytest.mark.slow
def test_two_nodes_give_the_same_shards_though_one_is_killed(
    packable: ModuleType,
    command: Callable[..., "subprocess.Popen[str]"],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both nodes are processes of this machine, and see the same folder."""
    pytest.importorskip("ray")
    options = {"codec": "png", "shard_frames": 24}
    pack(packable.Touches(objects=8), "touches", tmp_path / "here", PackOptions(**options))
    words = [sys.executable, "-c", CLUSTER]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as cluster:
        assert cluster.stdin
        assert cluster.stdout
        monkeypatch.setenv("RAY_ADDRESS", cluster.stdout.readline().strip())
        given = options | {"executor": "ray"}
        process = command(tmp_path / "ray", given, objects=8, delay=0.05)
        wait_until(lambda: any((tmp_path / "ray").rglob("*.tar")), 60)
        cluster.stdin.write("\n")
        cluster.stdin.flush()
        assert cluster.stdout.readline() == "killed\n"
        assert process.poll() is None, "packing had ended before"
        _, said = process.communicate(timeout=180)
        cluster.stdin.close()
    assert process.returncode == 0, said
    same_files(tmp_path / "here", tmp_path / "ray")


def same_files(folder: Path, other: Path) -> None:
    """Every file of a folder is in another, to the byte."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert files
    for path in files:
        assert (other / path.relative_to(folder)).read_bytes() == path.read_bytes(), path.name


def test_without_ray_the_error_says_how_to_get_it(
    packable: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ConfigError, match=r"pip install .*\[ray\]'"):
        pack(packable.Touches(), "touches", tmp_path, build(PackOptions, "pack", GIVEN))
