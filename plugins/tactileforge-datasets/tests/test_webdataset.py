"""The data set ``webdataset``: splits, exact resumption, servers, guesses, commands."""

import json
import subprocess
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from made_samples import FRAMES, frame_samples, made_set, picture, video, write_tar
from omegaconf import OmegaConf
from tactileforge_datasets import webdataset
from tactileforge_datasets.webdataset import WebDataset

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.contracts import Recording
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards.shards import Packed, describe_recording, write_shard
from tactileforge.datasets.shards import Shards
from tactileforge.plugins import registry
from tactileforge.testing import check
from tactileforge.util import downloads
from tactileforge.util.untrusted import load_yaml

STILL = {"touch": "jpg", "sensor": "digit", "background": "none"}


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[tuple[str, list[str]]]:
    """A server of the folder ``served``, and the paths of its requests."""
    asked: list[str] = []

    class Handler(SimpleHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            super().do_GET()

        def log_message(self, *args: object) -> None:
            pass

    folder = tmp_path / "served"
    folder.mkdir()
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder))) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}", asked
        server.shutdown()


def touch_data(data: WebDataset, window: int) -> TouchData:
    options: dict[str, Any] = {"batch_size": 4, "spacing": 0.04, "hop": 0.04, "match": 0}
    module = TouchData(data, 2, (32, 32), **options, window=window)
    module.workers = 0
    module.setup()
    return module


def same(one: Any, other: Any) -> bool:
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else one == other


def test_it_conforms(tmp_path: Path) -> None:
    results = check("dataset", WebDataset, root=str(made_set(tmp_path)), layout=FRAMES)
    assert [result for result in results if result.status == "failed"] == []
    assert sum(result.status == "ran" for result in results) >= 8


def test_clips_are_held_out_by_object_and_units_of_choice(tmp_path: Path) -> None:
    for number in range(2):
        samples = [
            (f"{name}/{clip}_{frame}", {"jpg": picture(9), "cls": clip})
            for name in "abcdefgh"
            for clip in range(2)
            for frame in range(2)
        ]
        write_tar(tmp_path / f"{number}.tar", samples)
    layout = {**STILL, "samples": "{object}/{clip}_{frame}", "fps": 10}

    def sides(layout: dict[str, Any], **options: Any) -> list[set[str]]:
        data = WebDataset(str(tmp_path), layout, **options)
        sides = [{one.key for one in data.recordings(split)} for split in ("train", "val")]
        counts = [
            sum(s.summary.recordings for s in data.sources(side)) for side in ("train", "val")
        ]
        assert counts == [len(side) for side in sides]
        assert not sides[0] & sides[1]
        assert len(sides[0] | sides[1]) == 32
        return sides

    train, val = sides(layout, val=0.4)
    assert {key.split("/")[1] for key in train}.isdisjoint(key.split("/")[1] for key in val)
    assert len(val) > 2
    train, val = sides({**layout, "hold_out": "{cls}"}, val=0.5)
    assert {key[-1] for key in train}.isdisjoint(key[-1] for key in val)
    train, val = sides(layout, val_tars="1.tar")
    assert {key[0] for key in train} == {"0"}
    assert {key[0] for key in val} == {"1"}
    assert sides(layout, val=0)[1] == set()


def test_of_few_objects_of_several_tars_one_is_held_out(tmp_path: Path) -> None:
    for name in "abc":
        samples = [(f"{name}/{clip}", {"jpg": picture(9)}) for clip in range(2)]
        write_tar(tmp_path / f"{name}.tar", samples)
    layout = {**STILL, "samples": "{object}/{clip}"}
    for val, few in ((0.01, {"c"}), (0.0, set[str]())):
        data = WebDataset(str(tmp_path), layout, val=val)
        assert {one.key.split("/")[1] for one in data.recordings("val")} == few
        objects = {one.key.split("/")[1] for one in data.recordings("train")}
        assert objects == {*"abc"} - few


def test_batches_are_functions_of_their_number(tmp_path: Path) -> None:
    """A window of two tars of six: shuffled within, moved on, and the same from any step on."""
    made_set(tmp_path, tars=6, clips=2)
    data = partial(WebDataset, str(tmp_path), FRAMES, val=0)
    stream = touch_data(data(), window=4).stream()
    batches = [stream[number] for number in range(24)]
    again = touch_data(data(), window=4).stream()
    for number in (23, 5, 17):
        resumed = again[number]
        assert all(same(batches[number][key], resumed[key]) for key in ("frames", "force", "text"))
    forces = np.concatenate([batch["force"][:, -1, 2] for batch in batches])
    assert len(np.unique(forces)) > 5
    assert (np.diff(forces) < 0).sum() > 10, "clips come in random order"


def test_many_recordings_are_counted_and_their_frames_estimated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made_set(tmp_path, tars=4)
    exact = WebDataset(str(tmp_path), FRAMES, val=0).sources("train")[0]
    monkeypatch.setattr(webdataset, "_COUNTED", 5)
    data = WebDataset(str(tmp_path), FRAMES, val=0)
    (source,) = data.sources("train")
    assert source.summary == exact.summary
    assert [part.seconds for part in source.parts] == pytest.approx(
        [part.seconds for part in exact.parts]
    )
    assert data.notes == [
        f"{tmp_path}: frames and labels of 8 recordings are estimated from those of the first 2 "
        "tars; recordings are counted"
    ]


def test_a_clip_that_goes_on_in_the_next_tar_is_said(tmp_path: Path) -> None:
    samples = frame_samples(0, clips=2, frames=6)
    write_tar(tmp_path / "0.tar", samples[:9])
    write_tar(tmp_path / "1.tar", samples[9:])
    data = WebDataset(str(tmp_path), FRAMES, val=0)
    found = {one.key: len(one.times) for one in data.recordings("train")}
    assert found == {"0/mug/ep00": 6, "0/pen/ep01": 3, "1/pen/ep01": 3}
    assert data.notes == [
        "1.tar: pen/ep01 goes on from the tar before; its frames are two recordings"
    ]


def test_tars_behind_a_url(tmp_path: Path, serve: tuple[str, list[str]]) -> None:
    url, asked = serve
    made_set(tmp_path / "served", tars=5)
    options = {"tars": "part-{000..004}.tar", "val": 0, "cache": str(tmp_path / "cache")}
    data = WebDataset(url, FRAMES, **options)
    (source,) = data.sources("train")
    assert asked == ["/part-000.tar"], "others are fetched when they are needed"
    assert [part.recordings for part in source.parts] == [4] * 5
    assert source.summary.recordings == 20
    (note,) = data.notes
    assert "5 tars without an index are taken to be as long as part-000.tar" in note
    assert "only while the tars stay the same" in note
    local = WebDataset(str(tmp_path / "served"), FRAMES, val=0)
    assert [one.key for one in data.recordings("train")] == [
        one.key for one in local.recordings("train")
    ]
    assert len(asked) == 5
    module = touch_data(WebDataset(url, FRAMES, **options), window=8)
    batches = [module.stream()[number] for number in range(6)]
    other = touch_data(WebDataset(url, FRAMES, **options), window=8).stream()
    assert same(batches[4]["frames"], other[4]["frames"])
    assert len(asked) == 5, "the cache has them"


def test_a_tar_that_is_gone_from_the_server_is_counted(
    tmp_path: Path, serve: tuple[str, list[str]]
) -> None:
    url, _ = serve
    made_set(tmp_path / "served", tars=3)
    (tmp_path / "served" / "part-000.tar").unlink()
    (tmp_path / "served" / "part-001.tar").write_bytes(b"<html>moved</html>" * 99)
    options = {"tars": "part-{000..002}.tar", "val": 0, "cache": str(tmp_path / "cache")}
    data = WebDataset(url, FRAMES, **options)
    (source,) = data.sources("train")
    assert source.summary.recordings == 12
    lines: list[tuple[str, int]] = []
    keys = [
        one.key for one in source.open(range(3), lambda line, count: lines.append((line, count)))
    ]
    assert {key.partition("/")[0] for key in keys} == {"part-002"}
    assert [count for _, count in lines] == [4, 4]
    assert "part-000.tar: cannot be fetched (HTTP Error 404" in lines[0][0]
    assert "no tar, or damaged at byte 0" in lines[1][0]


def guessed(root: Path) -> dict[str, Any]:
    guess = WebDataset.recognise(root)
    assert guess is not None
    assert any(doubt.startswith("licence") for doubt in guess.doubts)
    data = WebDataset(**{**guess.options, "val": 0})
    assert list(data.recordings("train"))
    assert data.skipped == []
    layout = guess.options["layout"]
    assert isinstance(layout, dict)
    return layout


def test_guesses(tmp_path: Path) -> None:
    layout = guessed(made_set(tmp_path / "digit_set"))
    assert layout == {
        "touch": "jpg",
        "samples": "{folder_a}/{clip}_{frame}",
        "sensor": "digit",
        "background": "none",
        "force": {"values": "json:force"},
        "times": {"values": "json:t", "unit": "ms"},
    }
    write_tar(tmp_path / "b/x.tar", [(f"{i:05d}", {"jpg": picture(9), "cls": 1}) for i in range(9)])
    layout = guessed(tmp_path / "b")
    assert layout == {**STILL, "object": "{cls}"}
    assert guessed(tmp_path / "b/x.tar") == layout, "a single tar"
    film = video(tmp_path / "v.mp4", range(0, 99, 9))
    write_tar(tmp_path / "c/x.tar", [("a", {"mp4": film, "txt": "a mug", "bg.png": picture(9)})])
    layout = guessed(tmp_path / "c")
    assert layout == {
        **{"touch": "mp4", "sensor": "digit", "background": {"file": "bg.png"}},
        "text": "{txt}",
    }
    numbered = {f"{i:04d}.png": picture(i) for i in range(5)}
    write_tar(tmp_path / "d/x.tar", [("a", {**numbered, "json": {"caption": "a", "label": "b"}})])
    layout = guessed(tmp_path / "d")
    assert (layout["touch"], layout["fps"]) == ("{frame}.png", 30)
    assert (layout["text"], layout["object"]) == ("{json:caption}", "{json:label}")
    clip = np.zeros((4, 16, 20, 3), np.uint8)
    parts = {"npy": clip, "force.npy": np.zeros((4, 3)), "cam.jpg": picture(9)}
    write_tar(tmp_path / "e/train-0.tar", [("a", parts)])
    write_tar(tmp_path / "e/val-0.tar", [("a", parts)])
    guess = WebDataset.recognise(tmp_path / "e")
    assert guess is not None
    assert guess.options["val_tars"] == "val*.tar"
    layout = guessed(tmp_path / "e")
    assert (layout["touch"], layout["sensor"]) == ("npy", "gelsight_mini")
    assert (layout["force"], layout["camera"]) == ({"values": "force.npy"}, "cam.jpg")


def test_a_folder_of_a_take_in_a_tar_is_a_clip_and_its_table_is_named(tmp_path: Path) -> None:
    frames = [(f"trial_0/{i:04d}", {"png": picture(i)}) for i in range(5)]
    write_tar(tmp_path / "trial_0.tar", [("trial_0/forces", {"csv": b"t,fz\n0,1\n"}), *frames])
    guess = WebDataset.recognise(tmp_path)
    assert guess is not None
    assert guess.options["layout"]["samples"] == "{clip}/{frame}"
    (line,) = (line for line in guess.doubts if "trial_0/forces.csv) is not read" in line)
    (one,) = WebDataset(**{**guess.options, "val": 0}).recordings("train")
    assert len(one.frames) == 5
    # what it says leads to the files
    command = line.partition("in their folder, ")[2].partition(", and read")[0]
    subprocess.run(["sh", "-c", command], cwd=tmp_path, check=True)
    assert (tmp_path / "trial_0/forces.csv").read_text() == "t,fz\n0,1\n"
    assert WebDataset.recognise(tmp_path) is None
    assert WebDataset.recognise(tmp_path / "trial_0.tar") is not None


def test_what_is_not_guessed(tmp_path: Path) -> None:
    write_tar(tmp_path / "a/x.tar", [("a", {"pth": b"1"})])
    write_tar(tmp_path / "b/x.tar", [])
    (tmp_path / "c").mkdir()
    (tmp_path / "c/x.tar").write_bytes(b"no tar")
    for place in ("a", "b", "c", "c/x.tar", "gone"):
        assert WebDataset.recognise(tmp_path / place) is None
    assert WebDataset.recognise(made_shards(tmp_path / "ours")) is None


def made_shards(out: Path) -> Path:
    frames = ArrayFrames(picture(9)[None])
    one = Recording(key="a", sensor="digit", frames=frames, times=np.zeros(1), no_contact=None)
    out.mkdir()
    packed = Packed(describe_recording(one), "jpg", [encode_image(picture(9))], [], [])
    write_shard(out / "train-000000.tar", [packed])
    return out


@pytest.mark.slow
def test_the_commands_take_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made_set(tmp_path / "digit_set", tars=4)
    monkeypatch.chdir(tmp_path)
    assert cli.run(["data", "inspect", "digit_set", "out=page.html"]) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "tars of samples (webdataset), read by data=webdataset" in said
    assert "to be checked: times: taken for ms" in said
    node = load_yaml(Path("page.yaml").read_text())
    node["layout"]["object"] = "{folder_a}"
    node["val"] = 0.3
    kept = Path("kept/data/lab.yaml")
    kept.parent.mkdir(parents=True)
    kept.write_text(json.dumps(node))
    data = ["--config-dir", "kept", "data=lab"]
    assert cli.run(["data", "inspect", *data, "out=page.html"]) == 0, capsys.readouterr().err
    assert "part-000/" in Path("page.html").read_text()
    assert cli.run(["data", "pack", *data, "out=packed"]) == 0, capsys.readouterr().err
    packed = [one for split in ("train", "val") for one in Shards("packed").recordings(split)]
    assert len(packed) == 16
    assert {one.object for one in packed} == {"mug", "pen"}
    words = ["objective=[pixel,force]", "scale=tiny", "debug=steps", "hydra.run.dir=run"]
    words += ["encoder.image_size=32", "batch.workers=0", "batch.size=4"]
    assert cli.run(["train", *data, *words]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("name", ["classes", "clips"])
def test_presets(tmp_path: Path, name: str) -> None:
    film = video(tmp_path / "v.mp4", range(0, 99, 9))
    samples = {
        "classes": [("a", {"jpg": picture(9), "cls": "bolt"})],
        "clips": [("a", {"mp4": film, "json": {"object": "bolt"}})],
    }
    write_tar(tmp_path / "a.tar", samples[name])
    words = [f"data=webdataset_{name}", f"data.root={tmp_path}", "data.layout.sensor=digit"]
    node = OmegaConf.to_container(compose(overrides=[*words, "data.val=0"]).data)
    assert isinstance(node, dict)
    node.pop("max_bad")  # of the run
    data = registry.build("datasets", node)
    (found,) = data.recordings("train")
    assert (found.object, found.text, found.no_contact is None) == ("bolt", None, name == "classes")


def test_a_server_without_a_length_that_stops_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first body is cut off, as its end mark tells; the second is whole."""
    monkeypatch.setattr(downloads, "_PAUSE", 0.01)
    raw = write_tar(tmp_path / "a.tar", frame_samples(0)).read_bytes()
    bodies = [raw[:5000], raw]

    class Handler(SimpleHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(bodies.pop(0))

        def log_message(self, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}"
        data = WebDataset(url, FRAMES, tars="a.tar", val=0, cache=str(tmp_path / "cache"))
        assert len(list(data.recordings("train"))) == 4
        server.shutdown()
    assert (data.skipped, bodies) == ([], [])


def test_the_cache_keeps_its_limit(tmp_path: Path, serve: tuple[str, list[str]]) -> None:
    url, asked = serve
    made_set(tmp_path / "served", tars=4)
    size = (tmp_path / "served" / "part-000.tar").stat().st_size
    options = {"tars": "part-{000..003}.tar", "val": 0, "cache": str(tmp_path / "cache")}
    data = WebDataset(url, FRAMES, **options, cache_gb=2.5 * size / 1e9)
    assert len(list(data.recordings("train"))) == 16
    assert len(list((tmp_path / "cache").rglob("*.tar"))) == 2
    assert len(asked) == 4
