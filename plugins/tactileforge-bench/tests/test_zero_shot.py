"""Classes by their names alone: no clip is trained on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lookup import Lookup
from tactileforge_bench import run as bench_run
from tactileforge_bench.fit.features import FeatureStore
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.models import ModelEntry, untrained_encoder
from tactileforge_bench.fit.resolve import choose_probe, result_task
from tactileforge_bench.results import load
from tactileforge_bench.results.write import Writer
from tactileforge_bench.run import Bench, BenchOptions
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import ClipSpec, parse_task

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.heads.align import AlignHead
from tactileforge.hub.files import make_header

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32, "projected": 64}
NAMES = ("dark_wood", "metal", "felt")
TASK = {
    "title": "Material",
    "data": {"name": "made_here"},
    "clip": {"span": 0.1, "hop": 0.1},
    "target": "label:material",
    "probe": {"name": "zero_shot"},
    "metrics": ["accuracy"],
    "split": {},
}


def picture(name: str, number: int) -> np.ndarray:
    """A square at the place of a material, lit a little differently each time."""
    frames = np.full((10, 32, 32, 3), 90, np.uint8)
    place = 10 * NAMES.index(name)
    frames[:, place : place + 8, 8:24] += np.uint8(80 + number)
    return frames


def recording(name: str, number: int) -> Recording:
    frames = picture(name, number)
    return Recording(
        key=f"{name}{number}",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(10) / 20,
        no_contact=ArrayFrames(frames[:1] * 0 + 90),
        force=np.ones((10, 3), np.float32),
        labels={"material": name},
    )


@pytest.fixture(autouse=True)
def data(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve recordings: eight of the side train, four of the side val."""

    def opened(node: Any, sides: Any, clip: ClipSpec) -> TaskSource:
        made = [recording(NAMES[i % 3], i) for i in range(12)]
        return TaskSource(made, ["train"] * 8 + ["val"] * 4, clip)

    monkeypatch.setattr(bench_run, "open_source", opened)


def aligned(words: Sequence[str] = ("dark wood", "metal", "felt")) -> FrozenEncoder:
    """An encoder with a text tower of touches: a word has the vector of its material."""
    torch.manual_seed(0)
    encoder = TactileViT("tiny", frames=4, image_size=32, projected=64)
    header = make_header(encoder, NODE, licence="MIT", spacing=0.05, recipe={"encoder": NODE})
    frames = torch.from_numpy(np.stack([picture(name, 20)[:4] for name in NAMES])).movedim(-1, -3)
    still = torch.full((3, 3, 32, 32), 90, dtype=torch.uint8)
    with torch.no_grad():
        _, vectors = encoder.eval()(frames, still, encoder.sensor_ids(["digit"] * 3))
    table = dict(zip(words, vectors, strict=True))
    head = AlignHead(encoder, Lookup(table), None)
    with torch.no_grad():
        head.text_project.weight.copy_(torch.eye(64))
    return FrozenEncoder("mine", encoder, header, heads={"align": head})


def bench(folder: Path, task: dict[str, Any], subject: FrozenEncoder, **probe: Any) -> Path:
    chosen = [parse_task("material", task)]
    options = BenchOptions(seeds=2, probe=probe)
    rows = [result_task(one, choose_probe(one, options.probe), "validation") for one in chosen]
    writer = Writer(folder, "made", {}, rows)
    runner = Bench(chosen, FeatureStore(folder / "features", workers=0), writer, options)
    runner.run(ModelEntry(name="mine", title="Mine", open=[lambda: subject]))
    return folder


def test_all_clips_are_named_and_none_is_trained_on(tmp_path: Path) -> None:
    found = load.read_results(bench(tmp_path, TASK, aligned()))
    (cell,) = found.cells
    assert cell.metrics == {"accuracy": 100}
    assert found.tasks[0].split.startswith("test: all clips; nothing is fitted; TF309 grey")
    rows = (tmp_path / cell.predictions).with_suffix(".csv").read_text().splitlines()
    assert len(rows) == 1 + 12 * 4, "four clips of each of the twelve recordings"


def test_words_that_mean_other_things_name_wrongly(tmp_path: Path) -> None:
    swapped = aligned(["metal", "dark wood", "felt"])
    (cell,) = load.read_results(bench(tmp_path, TASK, swapped)).cells
    assert cell.metrics["accuracy"] == pytest.approx(100 / 3), "felt alone is right"


def test_the_sentence_is_an_option_and_other_tasks_take_the_probe(tmp_path: Path) -> None:
    said = aligned([f"feels like {name}" for name in ("dark wood", "metal", "felt")])
    fitted = TASK | {"probe": {"name": "linear"}, "split": {"test": {"side": "val"}}}
    options = {"name": "zero_shot", "template": "feels like {}"}
    found = load.read_results(bench(tmp_path, fitted, said, **options))
    assert found.cells[0].metrics["accuracy"] == 100
    assert found.cells[0].setting == {"template": "feels like {}"}
    assert found.tasks[0].split.startswith("test: side val; nothing is fitted; TF309 grey")
    rows = (tmp_path / found.cells[0].predictions).with_suffix(".csv").read_text().splitlines()
    assert len(rows) == 1 + 4 * 4


def test_a_finished_cell_is_kept_until_the_words_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = aligned()
    bench(tmp_path, TASK, subject)
    with monkeypatch.context() as patched:
        patched.setattr(bench_run.evaluate, "evaluate_probe", None)
        bench(tmp_path, TASK, subject)
    with torch.no_grad():
        subject.heads["align"].text_project.weight.neg_()
    (cell,) = load.read_results(bench(tmp_path, TASK, subject)).cells
    assert cell.metrics["accuracy"] < 100


def refusal(folder: Path) -> str:
    (row,) = load.read_results(folder).not_run
    return row.reason


def test_a_model_without_language_is_not_run(tmp_path: Path) -> None:
    plain = aligned()
    plain.heads = {}
    assert "is not aligned with language" in refusal(bench(tmp_path / "a", TASK, plain))
    random = untrained_encoder("untrained:mine", plain.header)
    said = refusal(bench(tmp_path / "b", TASK, random))
    assert said == "random weights are not aligned with language"


def test_targets_without_names_are_refused(tmp_path: Path) -> None:
    task = TASK | {"target": "force", "metrics": ["rmse_sum_axes"]}
    assert "not one class of a clip" in refusal(bench(tmp_path, task, aligned()))


def test_other_probes_need_a_split_and_no_sentence() -> None:
    with pytest.raises(ConfigError, match="split: give one of test, as in test"):
        parse_task("t", TASK | {"probe": {"name": "linear"}})
    task = parse_task("t", TASK)
    with pytest.raises(ConfigError, match="template"):
        choose_probe(task, {"name": "linear", "template": "{}"})
    with pytest.raises(ConfigError, match="not trained by gradients"):
        choose_probe(task, {"finetune": 1e-4})


def test_a_side_without_clips_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TactileForgeError, match="the test has 0, and split"):
        bench(tmp_path, TASK | {"split": {"test": {"side": "test"}}}, aligned())
