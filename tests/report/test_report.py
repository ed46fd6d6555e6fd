import csv
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from tactileforge_sim.dataset import Sim
from torch import nn

from tactileforge.api import train
from tactileforge.checks.log_doubts import Examination
from tactileforge.cli._compose import compose
from tactileforge.contracts import Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.heads.decoder import Reconstruction
from tactileforge.heads.force import Forces
from tactileforge.pages.curves import Curve, read_metrics, weighed
from tactileforge.pages.figures import curve_figure
from tactileforge.pages.page import MINUS, NONE, duration, number, percent
from tactileforge.report.embedding import Embedding, neighbours, principal
from tactileforge.report.forces import ForceResult, _scores
from tactileforge.report.run import report_of_run, write_report
from tactileforge.report.samples import (
    ClipReader,
    ClipSample,
    ForceReading,
    batches,
    explained,
    liveliest,
    quiet,
    saliency,
    spread,
)
from tactileforge.report.strips import strips_of
from tactileforge.report.summary import _by_source, checks_table, result_lines
from tactileforge.training.labels import Labels
from tactileforge.training.module import TouchModule
from tactileforge.util.files import sealed, unsealed

SIZE = 32


class Touches:
    """Twelve recordings of 12 frames: a blob grows, the force with it."""

    provides = frozenset({"force", "action", "object", "text", "image"})

    def __init__(self, sensors: tuple[str, ...] = ("digit", "gelsight"), **missing: bool) -> None:
        self.sensors = sensors
        self.missing = missing
        self.skipped: list[str] = []

    def recordings(self, split: str) -> Iterator[Recording]:
        if split == "val" and self.missing.get("val"):
            return
        length = 1 if self.missing.get("motion") else 12
        rng = np.random.default_rng(len(split))
        for i in range(12):
            still = rng.integers(90, 160, (1, SIZE, SIZE, 3))
            growth = np.linspace(0, 60, length)[:, None, None, None] * np.ones((1, SIZE, SIZE, 3))
            growth[:, :, : SIZE // 2] = 0
            force = np.linspace([0, 0, 0], [0.5, -1, i], length).astype(np.float32)
            if self.missing.get("shear"):
                force[:, :2] = np.nan
            labels = not self.missing.get("labels")
            yield Recording(
                key=f"{split}/<{i}>",
                sensor=self.sensors[i % len(self.sensors)],
                frames=ArrayFrames((still + growth).astype(np.uint8)),
                times=np.arange(length) / 15,
                no_contact=ArrayFrames(still.astype(np.uint8)),
                force=force if labels else None,
                action=np.full(length, i % 2) if labels else None,
                object=f"object {i // 2}" if labels else None,
                text="{action} it" if labels else None,
                source="made in the test",
                licence="CC0-1.0",
            )


class Page(HTMLParser):
    """Parts of a page for tests: tables by id, attributes of every tag, visible text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._rows: list[list[str]] = []
        self._silent = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        self._silent = tag == "style"
        if tag == "table":
            self._rows = self.tables[str(given["id"])] = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._rows[-1].append("")

    def handle_data(self, data: str) -> None:
        if self._silent:
            return
        self.text += data
        if self._rows and self._rows[-1]:
            self._rows[-1][-1] += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "table":
            self._rows = []


def config_of(*overrides: str) -> dict:
    words = ["scale=demo", f"encoder.image_size={SIZE}", "batch.workers=0", *overrides]
    return OmegaConf.to_container(compose("anytouch2", words), resolve=True)


def log(folder: Path, rows: list[dict[str, float]]) -> None:
    path = folder / "metrics.csv"
    keys = sorted({key for row in rows for key in row})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, keys)
        writer.writeheader()
        writer.writerows(rows)


Write = Callable[..., Page]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the report of a run without training: fresh weights, metrics as given."""

    def build(
        dataset: Touches,
        *overrides: str,
        metrics: list[dict[str, float]] | None = None,
        met: dict[str, dict[str, int]] | None = None,
    ) -> Page:
        config = config_of(*overrides)
        OmegaConf.save(OmegaConf.create(config), tmp_path / "config.yaml")
        if metrics:
            log(tmp_path, metrics)
        data = TouchData(dataset, 4, (SIZE, SIZE), batch_size=8, match=0, workers=0)
        data.examiner = Examination()
        data.setup()
        module = TouchModule.from_config(config, data.summary("train").labels)
        report, _ = write_report(tmp_path, module, data, {}, Labels(met))
        assert not list(tmp_path.glob("*.part"))
        return Page(report.read_text())

    return build


RUN = ["data.scenes=2", "data.val=1", f"data.size={SIZE}", "batch.size=8"]
RUN += ["trainer.max_steps=8", "trainer.log_every_n_steps=1", "trainer.val_check_interval=4"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    train(
        compose("anytouch2", ["scale=demo", "encoder.image_size=32", "batch.workers=0", *RUN]),
        folder,
    )
    return folder


# the whole page


@pytest.mark.slow
def test_the_report_of_a_run_is_written_again_to_the_byte(run: Path) -> None:
    at_the_end = (run / "report.html").read_bytes()
    torch.manual_seed(5)
    before = torch.get_rng_state()
    report_of_run(run)
    assert (run / "report.html").read_bytes() == at_the_end
    torch.manual_seed(5)
    assert torch.equal(before, torch.get_rng_state())


@pytest.mark.slow
def test_the_page_loads_nothing_and_is_whole(run: Path) -> None:
    html = (run / "report.html").read_text()
    assert len(html) < 3_000_000
    page = Page(html)
    ids = [str(given["id"]) for _, given in page.tags if "id" in given]
    assert len(ids) == len(set(ids))
    for tag, given in page.tags:
        for name in ("src", "href", "xlink:href"):
            link = given.get(name) or ""
            assert link == "" or link.startswith(("data:", "#")), link
            assert not link.startswith("#") or link[1:] in ids, link
        assert tag not in ("script", "iframe", "link") or given.get("href") == "data:,"
        assert tag != "img" or given["alt"]
    assert not re.findall(r"url\((?!#)|@import", html)
    assert set(re.findall(r"url\(#([^)]+)\)", html)) <= set(ids)
    names = [given["id"] for tag, given in page.tags if tag == "section"]
    first = ["force", "frames", "embedding", "captions"]
    assert names == [*first, "losses", "data", "recipe", "next"]
    links = [given.get("href") for tag, given in page.tags if tag == "a"]
    assert links == [f"#{name}" for name in names]


@pytest.mark.slow
def test_the_numbers_follow_from_the_metrics_of_the_run(run: Path) -> None:
    page = Page((run / "report.html").read_text())
    curves = read_metrics(run)
    head, *rows = page.tables["losses-summary"]
    assert [row[0] for row in rows] == ["pixel", "diff", "align", "match", "force"]
    assert head[1:4] == ["training: first", "last", "change"]
    for name, first, last, change, val_first, val_last, _, weight in rows:
        losses, val = curves[f"train/{name}"].values, curves[f"val/{name}"].values
        assert (first, last) == (f"{losses[0]:.3g}", f"{losses[-1]:.3g}")
        assert (val_first, val_last) == (f"{val[0]:.3g}", f"{val[-1]:.3g}")
        assert float(weight) == {"match": 0.1}.get(name, 1)
        if len(losses) > 1:
            assert change == percent((losses[-1] - losses[0]) / losses[0], signed=True)
    assert "Steps8, each of 8 clips" in page.text
    assert re.search(r"Time[\d.]+ s", page.text)
    versions = unsealed((run / "versions.json").read_text())["versions"]
    assert f"torch {versions['torch']}" in page.text
    assert "hidden in every frame" in page.text
    assert "scenes: 2" in page.text  # the recipe


@pytest.mark.slow
def test_data_and_licences_are_counted(run: Path) -> None:
    page = Page((run / "report.html").read_text())
    rows = {row[0]: row[1:] for row in page.tables["recordings"]}
    assert rows["digit, training"][0] == "2"
    assert rows["digit, validation"][0] == "1"
    touches = Sim(scenes=2, val=1, size=SIZE).recordings("train")
    seconds = (
        sum(len(recording.frames) for recording in touches if recording.sensor == "digit") / 30
    )
    assert rows["digit, training"][2] == f"{seconds:.1f} s"
    assert page.tables["sources"][1:] == [["simulated by tactileforge", "CC0-1.0", "3", "9"]]
    assert "Skipped recordings: none." in page.text


@pytest.mark.slow
def test_first_and_last_are_means_of_a_tenth(write: Write) -> None:
    losses = np.random.default_rng(0).uniform(1, 2, 40)
    metrics = [{"step": 10 * i, "train/pixel": loss} for i, loss in enumerate(losses)]
    metrics += [{"step": 399, "val/pixel": 0.5}]
    page = write(Touches(), "objective=[pixel]", metrics=metrics)
    _, first, last, _, val_first, val_last, val_change, _ = page.tables["losses-summary"][1]
    assert (first, last) == (f"{losses[:4].mean():.3g}", f"{losses[-4:].mean():.3g}")
    assert (val_first, val_last, val_change) == ("0.5", "0.5", NONE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("last", "told"), [(0.5, "for 1 of 1"), (0.995, "for 0 of 1"), (1.5, "for 0 of 1")]
)
def test_the_verdict_on_a_loss(write: Write, last: float, told: str) -> None:
    metrics = [{"step": 1, "train/pixel": 1.0}, {"step": 9, "train/pixel": last}]
    page = write(Touches(), "objective=[pixel]", metrics=metrics)
    assert f"Training loss fell by more than 1.0 % {told} objectives" in page.text
    assert "Validation loss was logged less than twice" in page.text


@pytest.mark.slow
def test_text_is_escaped(write: Write) -> None:
    page = write(Touches(), "objective=[pixel]")
    assert re.search(r"digit · object \d · val/<\d+>", page.text)


def test_findings_of_the_checks_are_on_top(write: Write) -> None:
    pulled = Touches()
    given = list(pulled.recordings("train"))
    for one in given:
        one.force[:, 2] *= -1
    pulled.recordings = lambda split: iter(given if split == "train" else [])
    page = write(pulled, "objective=[pixel]")
    (row,) = [row for row in page.tables["checks"] if row[0] == "TF202"]
    assert row[1] == "pulling force in 11 of 12 recordings (train/<11>: down to -11 N along z)"
    assert row[2].startswith("pressing is positive: does z point out of the gel (sign: [1, 1, -1])")
    assert next(iter(page.tables)) == "checks"


@pytest.mark.slow
def test_without_findings_there_is_nothing_of_checks(write: Write) -> None:
    assert "checks" not in write(Sim(scenes=2, val=1, size=SIZE), "objective=[pixel]").tables


@pytest.mark.parametrize(
    ("line", "row"),
    [
        (
            "TF501 3 are copies (a; b and c), so; move one",
            ["3 are copies (a; b and c), so", "move"],
        ),
        ("TF101 steps (a: 2 (usual 1); x); fix; more", ["steps (a: 2 (usual 1); x)", "fix; more"]),
        (
            "TF207 all are 0 N: was it connected?",
            ["all are 0 N: was it connected?", "was the sensor of force"],
        ),
    ],
)
def test_a_finding_is_parted_into_what_and_fix(line: str, row: list[str]) -> None:
    (_, (code, what, fix)) = Page(checks_table([line])).tables["checks"]
    assert [code, what] == [line[:5], row[0]]
    assert fix.startswith(row[1])


# what may be missing


@pytest.mark.slow
def test_without_metrics_and_files(write: Write) -> None:
    page = write(Touches(), "objective=[pixel,match]")
    assert "No metrics were logged" in page.text
    assert "Timenot kept" in page.text
    assert "versions.json is not there" in page.text
    assert page.tables["losses-summary"][1] == ["pixel", *NONE * 6, "1"]


@pytest.mark.slow
def test_without_validation(write: Write) -> None:
    metrics = [{"step": 1, "train/pixel": 1.0}]
    page = write(Touches(val=True), "objective=[pixel,force]", metrics=metrics)
    assert "No validation: the data holds nothing out." in page.text
    assert "The training clips that move most" in page.text
    assert [row[0] for row in page.tables["force-force"][1:]] == [
        "x, training",
        "y, training",
        "z, training",
    ]
    assert "Training clips are drawn faintly" not in page.text


@pytest.mark.slow
def test_without_force_and_labels(write: Write) -> None:
    page = write(Touches(labels=True), "objective=[pixel,diff]")
    assert "force" not in [given["id"] for tag, given in page.tags if tag == "section"]
    assert "Not known of these clips: object, action." in page.text
    page = write(Touches(labels=True), "objective=[force]")
    assert "No clip has a force label." in page.text


@pytest.mark.slow
def test_a_loss_without_a_label_is_absent_and_said(write: Write) -> None:
    metrics = [{"step": 1, "train/pixel": 1.0, "weight/pixel": 1.0, "weight/force": 1.0}]
    page = write(Touches(), "objective=[pixel,force]", metrics=metrics)
    assert "no loss: it saw no label in any step whose metrics were logged" in page.text
    metrics[0] |= {"weight/force": 0.0}
    page = write(Touches(), "objective=[pixel,force]", metrics=metrics)
    assert "never computed: its weight was 0 whenever metrics were logged" in page.text


@pytest.mark.slow
def test_forces_along_one_axis(write: Write) -> None:
    count = {"batches": 25, "clips": 800, "labelled": 800, "x": 0, "y": 0, "z": 800}
    page = write(Touches(shear=True), "objective=[force]", met={"force": count})
    rows = {row[0]: row[1:] for row in page.tables["force-force"]}
    assert set(rows["x, validation"]) == {NONE}
    assert float(rows["z, validation"][4]) > 1  # N that were measured
    assert "Objective 'force' has seen no force along x and y in its first 25 batches" in page.text
    assert "Better than it along" in page.text
    recordings = {row[0]: row[1:] for row in page.tables["recordings"]}
    assert "6 (z alone)" in recordings["digit, training"]


@pytest.mark.slow
def test_what_reaches_the_encoder_is_drawn(write: Write) -> None:
    steps = [
        {"step": 9, "train/pixel": 1.0, "gradient/pixel": 0.5, "weight/pixel": 2.0},
        {"step": 19, "train/pixel": 0.9, "gradient/pixel": 0.25, "weight/pixel": 4.0},
    ]
    page = write(Touches(), "objective=[pixel]", metrics=steps)
    assert "Norms of each objective's gradient on the encoder" in page.text
    names = [given["aria-label"] for tag, given in page.tags if "aria-label" in given]
    assert [name for name in names if "over steps: pixel" in str(name)] == [
        "norm over steps: pixel",
        "weight over steps: pixel",
        "norm over steps: pixel",
    ]
    product = weighed(
        Curve(np.array([9, 19]), np.array([0.5, 0.25])), Curve(np.array([19]), np.array([4.0]))
    )
    assert (product.steps.tolist(), product.values.tolist()) == ([19], [1.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objective", "rows", "told"),
    [
        (
            "pixel",
            ["Input", "Saliency", "Masked", "Reconstructed", "Difference"],
            "Only frames are reconstructed",
        ),
        (
            "diff",
            ["Input", "Saliency", "Masked", "Difference", "Difference, reconstructed"],
            "Only differences are",
        ),
        ("force", ["Input", "Saliency", "Difference"], "No objective reconstructs"),
    ],
)
def test_rows_of_pictures(write: Write, objective: str, rows: list[str], told: str) -> None:
    page = write(Touches(), f"objective=[{objective}]")
    alts = [str(given["alt"]) for tag, given in page.tags if tag == "img"]
    shown = list(dict.fromkeys(alt.rpartition(", frame")[0] for alt in alts))
    assert shown == rows
    assert alts.count("Input, frame 4") == 6
    assert ("Difference, frame 1" in alts) is False
    assert told in page.text


@pytest.mark.slow
@pytest.mark.parametrize(("step", "count"), [(0, 8), (1, 16), (9, 36)])
def test_as_many_clips_are_looked_at_as_were_learned_from(
    write: Write, step: int, count: int
) -> None:
    metrics = [{"step": step, "train/force": 1.0}]
    page = write(Touches(), "objective=[force]", "batch.size=8", metrics=metrics)
    assert f"{count} validation clips and {count} training clips" in page.text


def test_a_clip_is_read_once(clips: Clips, monkeypatch: pytest.MonkeyPatch) -> None:
    module, read = with_head(Oracle(0)), []
    views = module.encoder.views

    def counted(batch: dict) -> object:
        read.extend(batch["clip"].tolist())
        return views(batch)

    monkeypatch.setattr(module.encoder, "views", counted)
    reader = ClipReader(module, clips, ["x"], {})
    assert reader.embed([5, 0, 7]).clips.tolist() == [0, 5, 7]
    assert reader.forces([7, 2], "x").clips.tolist() == [7, 2]
    assert read == [5, 0, 7, 2]


@pytest.mark.slow
def test_images_of_classes(write: Write) -> None:
    page = write(Touches(motion=True), "objective=[classify]")
    names = [given["id"] for tag, given in page.tags if tag == "section"]
    assert names == ["classes", "frames", "embedding", "losses", "data", "recipe", "next"]
    head, *rows = page.tables["classes-classify"]
    assert head[1:] == [row[0] for row in rows] == [f"object {i}" for i in range(6)]
    assert sum(int(cell) for row in rows for cell in row[1:]) == 12
    assert "of 12 validation clips are named right, of 6 classes" in page.text
    alts = {str(given["alt"]) for tag, given in page.tags if tag == "img"}
    assert {alt for alt in alts if "frame" in alt} == {"Input, frame 1", "Saliency, frame 1"}
    assert "The validation images, of different sensors" in page.text


@pytest.mark.slow
def test_single_frames_of_one_sensor(write: Write) -> None:
    page = write(Touches(("digit",), motion=True), "objective=[pixel,diff,force]")
    assert page.tables["neighbours"][1][1].startswith("no answer: one class")
    assert f"{NONE} (differences)" in page.text  # nothing varies, so nothing is explained
    assert "0 s" in page.tables["recordings"][1]


@pytest.mark.slow
def test_an_objective_that_never_woke(write: Write) -> None:
    metrics = [
        {"step": i, "train/pixel": 1.0, "weight/pixel": 1.0, "weight/force": 0.0} for i in (1, 2)
    ]
    page = write(Touches(), "objective=[pixel,force]", metrics=metrics)
    assert "never computed: its weight was 0" in page.text
    assert "force logged less than twice" in page.text


@pytest.mark.slow
def test_skipped_recordings_are_listed(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = Touches()
    dataset.skipped.append("a.mp4: truncated")
    read = ArrayFrames.read

    def broken(frames: ArrayFrames, indices: list[int]) -> np.ndarray:
        if len(frames) == 12 and frames.array[0, 0, 0, 0] == first:
            raise DataError("b.mp4: damaged")
        return read(frames, indices)

    first = next(iter(dataset.recordings("val"))).frames.read([0])[0, 0, 0, 0]
    monkeypatch.setattr(ArrayFrames, "read", broken)
    page = write(dataset, "objective=[pixel]")
    assert "Skipped recordings: 2a.mp4: truncatedval/<0>: b.mp4: damaged" in page.text
    assert "2 recordings could not be read" in page.text


@pytest.mark.slow
def test_a_folder_that_is_no_run(tmp_path: Path, run: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"no config\.yaml there; give the folder of a run"):
        report_of_run(tmp_path)
    config = OmegaConf.load(run / "config.yaml")
    config.encoder.projected = 64
    OmegaConf.save(config, tmp_path / "config.yaml")
    with pytest.raises(DataNotFoundError, match="no checkpoint at"):
        report_of_run(tmp_path)
    (tmp_path / "checkpoints").symlink_to(run / "checkpoints")
    with pytest.raises(ConfigError, match=r"the checkpoint does not fit config\.yaml"):
        report_of_run(tmp_path)


# metrics


def test_metrics_are_read_but_for_a_row_that_was_cut_off(tmp_path: Path) -> None:
    rows = [{"step": s, "train/pixel": 1.0, "lr": 0.1} for s in (4, 9)]
    log(tmp_path, [*rows, {"step": 9, "train/pixel": "", "val/pixel": 5.0}])
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("14,3")  # by SIGKILL
    curves = read_metrics(tmp_path)
    assert curves["train/pixel"].steps.tolist() == [4, 9]
    assert curves["lr"].steps.tolist() == [4, 9]
    assert curves["val/pixel"].values.tolist() == [5]


def test_long_curves_are_thinned_by_means() -> None:
    thin = Curve(np.arange(1000), np.arange(1000.0)).thinned(100)
    assert thin.steps.tolist() == list(range(9, 1000, 10))
    assert thin.values.tolist() == [10 * i + 4.5 for i in range(100)]


def test_a_curve_is_drawn_where_it_belongs() -> None:
    curve = Curve(np.array([0, 50, 100]), np.array([3.0, 2.0, 1.0]))
    svg = curve_figure("loss", 100, curve)
    (path,) = re.findall(r'<path d="([^"]+)"[^>]*stroke: var\(--c0\)', svg)
    points = np.array(re.findall(r"[ML] ([\d.]+) ([\d.]+)", path), float)
    steps = np.diff(points, axis=0)
    assert steps[0] == pytest.approx(steps[1], abs=0.02)  # a straight line, to the right and down
    assert (steps > 0).all()


# numbers


class Oracle(nn.Module):
    """A head with the true answer, up to an error in newton."""

    def __init__(self, error: float) -> None:
        super().__init__()
        self.error = error

    def forward(self, views: object, batch: dict) -> Forces:
        scale = batch["force_scale"][:, None]
        force = (batch["force"][:, 1:] + self.error) / scale
        return Forces(force, force)


class Rebuilt(nn.Module):
    """A head with the hidden frames: a share of their difference from their mean."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def forward(self, views: object, batch: dict) -> Reconstruction:
        masked = views.masked.masked
        frames = views.patches.unflatten(-1, (3, 2, -1)).permute(0, 2, 1, 4, 3, 5)
        frames = frames.flatten(2, 3).flatten(3)  # (B, N, T, 3 * P)
        index = masked[..., None, None].expand(-1, -1, *frames.shape[2:])
        target = frames.gather(1, index)
        mean = target.unflatten(-1, (3, -1)).mean((1, 2, 4), keepdim=True)
        mean = mean.expand(*target.shape[:3], 3, target.shape[-1] // 3).flatten(3)
        return Reconstruction(mean + self.share * (target - mean), target, masked)


def with_head(head: nn.Module) -> TouchModule:
    encoder = TactileViT("tiny", frames=4, image_size=SIZE)
    return TouchModule(encoder, {"x": head}, {"x": nn.Identity()}, {"x": 1.0}, {}, {})


@pytest.fixture
def clips() -> Clips:
    return Clips(Touches().recordings("train"), 4, 1 / 15, 0.2, (SIZE, SIZE))


def test_forces_are_read_in_newton(clips: Clips) -> None:
    reader = ClipReader(with_head(Oracle(0.25)), clips, ["x"], {})
    reading = reader.forces(range(len(clips)), "x")
    assert reading.clips.tolist() == list(range(len(clips)))
    rows = clips.rows(7)[1:]
    truth = clips.recordings[clips.index[7, 0]].force[rows]
    assert reading.measured[7] == pytest.approx(truth)
    assert reading.predicted == pytest.approx(reading.measured + 0.25, abs=1e-5)
    for axis, score in enumerate(ForceResult("x", {"train": reading}, "", {}, {}).scores("train")):
        values = reading.measured[..., axis]
        assert score.mae == pytest.approx(0.25, abs=1e-5)
        assert score.correlation == pytest.approx(1)
        assert score.median == pytest.approx(np.abs(values - np.median(values)).mean())


def test_clips_without_a_label_are_no_points(clips: Clips) -> None:
    clips.recordings[0].force[:] = np.nan
    reader = ClipReader(with_head(Oracle(0)), clips, ["x"], {})
    reading = reader.forces(range(len(clips)), "x")
    assert set(clips.index[reading.clips, 0]) == set(range(1, 12))
    assert reader.forces([0], "x") is None


def test_a_force_that_does_not_vary_has_no_correlation() -> None:
    reading = ForceReading(np.zeros((5, 3, 3)), np.ones((5, 3, 3)), np.arange(5))
    score = ForceResult("x", {"val": reading}, "", {}, {}).scores("val")[0]
    assert (score.mae, score.median) == (1, 0)
    assert np.isnan(score.correlation)
    assert np.isnan(score.r2)


def test_a_collapsed_axis_is_told() -> None:
    rng = np.random.default_rng(0)
    measured = rng.normal(0, [0.4, 0.4, 4], (50, 3, 3)).astype(np.float32)
    predicted = measured * np.array([0.05, 0.5, 1], np.float32)
    measured[:25, :, 1] = np.nan
    reading = ForceReading(measured, predicted, np.arange(50))
    x, y, z = ForceResult("x", {"val": reading}, "", {}, {}).scores("val")
    assert [score.collapsed for score in (x, y, z)] == [True, False, False]
    assert z.r2 == 1
    assert y.r2 == pytest.approx(0.75, abs=0.01)  # half of what is there, around a mean near 0
    assert x.measured == pytest.approx(measured[..., 0].std())


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_explained_variance(clips: Clips, share: float) -> None:
    shares = explained(with_head(Rebuilt(share)), clips, [0, 5, 9], ["x"])
    assert shares == {"frames": pytest.approx(1 - (1 - share) ** 2, abs=1e-5)}


def test_pictures_are_what_the_encoder_sees(clips: Clips) -> None:
    module = with_head(Rebuilt(1.0))
    batch = next(batches(module, clips, [3, 4]))
    views = module.encoder.views(batch)
    reconstruction = module.heads["x"](views, batch)
    rows = strips_of(module.encoder, views.patches, [reconstruction], 1).rows
    frames, background = batch["frames"][1].float(), batch["background"][1].float()
    subtracted = ((frames - background + 130) / 255).clamp(0, 1)
    assert torch.allclose(rows["Input"], subtracted, atol=1e-5)
    assert torch.allclose(rows["Reconstructed"], subtracted, atol=1e-5)  # pasted at the right place
    hidden = (rows["Masked"] != rows["Input"]).any(1).float()
    assert hidden[:, ::16, ::16].mean() == 0.75  # of the 16 x 16 patches
    grown = rows["Difference"] - 0.5
    assert grown[:, :, :, : SIZE // 2].abs().max() < 1e-5
    assert grown[-1, :, :, SIZE // 2 :].mean() == pytest.approx(0.5, abs=0.01)


def test_salient_patches_are_those_that_are_touched(clips: Clips) -> None:
    """Only the right half changes: the light is there."""
    module = with_head(Rebuilt(1.0))
    found = saliency(module, clips, [3, 4])
    assert found is not None
    encoder = module.encoder
    assert found.shape == (2, encoder.grid[0], encoder.grid[1] * encoder.grid[2])
    per_place = found.view(2, *encoder.grid)
    half = encoder.grid[2] // 2
    assert per_place[..., :half].abs().max() < 1e-4 * per_place.max()
    batch = next(batches(module, clips, [3, 4]))
    still = batch["background"][:, None].expand_as(batch["frames"])
    with quiet(module):
        vectors = [encoder.views({**batch, "frames": x}).full.cls for x in (batch["frames"], still)]
    distance = (vectors[0] - vectors[1]).square().sum(1)
    assert torch.allclose(found.sum((1, 2)), distance, rtol=0.1)
    assert not any(parameter.grad is not None for parameter in module.parameters())
    views = encoder.views(next(batches(module, clips, [3, 4])))
    rows = strips_of(encoder, views.patches, [], 1, found).rows
    lit = rows["Saliency"] - 0.55 * rows["Input"].mean(1, keepdim=True)
    assert lit[..., : SIZE // 2].abs().max() < 1e-3
    assert lit[:, 0].amax() > 0.3  # of .75, where the picture is not white already
    module.encoder.pool_tokens = lambda tokens: tokens[:, 0].detach()
    assert saliency(module, clips, [3]) is None


def test_wrong_pixels_are_pasted_at_hidden_places_only(clips: Clips) -> None:
    module = with_head(Rebuilt(0.0))
    batch = next(batches(module, clips, [3]))
    views = module.encoder.views(batch)
    reconstruction = module.heads["x"](views, batch)
    rows = strips_of(module.encoder, views.patches, [reconstruction], 0).rows
    changed = (rows["Reconstructed"] - rows["Input"]).abs().amax(1) > 1e-4
    hidden = (rows["Masked"] != rows["Input"]).any(1)
    assert changed.any()
    assert not (changed & ~hidden).any()


def embedding(vectors: np.ndarray, recordings: list[str], names: list[str], val: int) -> Embedding:
    held_out = np.arange(len(names)) >= len(names) - val
    return Embedding(vectors, recordings, held_out, {"object": names})


def test_neighbours_find_what_is_there() -> None:
    names = ["a", "b", "c"] * 8
    vectors = np.eye(3)[[0, 1, 2] * 8]
    score = neighbours(embedding(vectors, [f"r{i}" for i in range(24)], names, 6), "object")
    assert (score.accuracy, score.chance, score.clips, score.classes) == (1, 1 / 3, 6, 3)


def test_a_recording_does_not_recognise_itself() -> None:
    rng = np.random.default_rng(0)
    own = rng.normal(size=(40, 64))
    vectors = np.repeat(own / np.linalg.norm(own, axis=1, keepdims=True), 10, axis=0)
    recordings = [f"r{i}" for i in range(40) for _ in range(10)]
    names = [("a", "b")[i % 2] for i in range(40) for _ in range(10)]
    score = neighbours(embedding(vectors, recordings, names, 0), "object")
    assert score.accuracy < 0.75  # each clip has nine copies of itself, none of which may vote
    alone = neighbours(embedding(vectors[:20], recordings[:20], names[:20], 0), "object")
    assert alone is None  # each class has one recording


def test_accuracy_is_the_mean_over_classes() -> None:
    names = ["a"] * 18 + ["b"] * 2
    score = neighbours(
        embedding(np.ones((20, 4)) / 2, [f"r{i}" for i in range(20)], names, 0), "object"
    )
    assert score.accuracy == 0.5  # everything is called a


def test_principal_axes_are_those_of_the_covariance() -> None:
    vectors = np.random.default_rng(0).normal(size=(50, 4)) * [3, 1, 2, 0.5]
    places, shares = principal(vectors)
    values = np.linalg.eigvalsh(np.cov(vectors.T))[::-1]
    assert shares == pytest.approx(values / values.sum())
    assert places.var(0, ddof=1) == pytest.approx(values[:2])


# choices


def test_clips_are_spread_over_recordings(clips: Clips) -> None:
    each = np.bincount(clips.index[spread(clips, 24), 0])
    assert each.tolist() == [2] * 12
    assert len(set(spread(clips, 24))) == 24
    assert np.unique(clips.index[spread(clips, 5), 0]).tolist() == [0, 3, 6, 8, 11]
    digit = spread(clips, 100, lambda recording: recording.sensor == "digit")
    assert digit == [i for i in range(len(clips)) if clips.index[i, 0] % 2 == 0]


def test_the_clips_that_are_shown(clips: Clips) -> None:
    which = np.array([int(np.flatnonzero(clips.index[:, 0] == i)[0]) for i in range(12)])
    moved = np.array([9, 0, 8, 2, 1, 3, 0, 0, 0, 1, 0, 0], np.float32)
    chosen = liveliest(clips, ClipSample(which, np.zeros((12, 1)), moved), 4)
    # Digit has the even recordings, gelsight the odd ones, and recording i shows object i // 2. Of
    # gelsight 5 moves most; in the second round 3 moves more than 9, but shows the object of 2.
    assert clips.index[chosen, 0].tolist() == [0, 5, 2, 9]


def test_words() -> None:
    assert [duration(s) for s in (4.2, 75, 7500)] == ["4.2 s", "1 min 15 s", "2 h 5 min"]
    assert [percent(x) for x in (0.5, 0.012, -0.0001, float("nan"))] == [
        "50 %",
        "1.2 %",
        "0.0 %",
        NONE,
    ]
    assert percent(-0.42, signed=True) == f"{MINUS}42 %"
    assert number(-0.01234) == f"{MINUS}0.0123"


def force_of_sources() -> ForceResult:
    rng = np.random.default_rng(0)
    measured = rng.normal(0, 1, (40, 3, 3)).astype(np.float32)
    off = np.where(np.arange(40) < 30, 0.5, 0.1)[:, None, None]  # own forces are read worse
    reading = ForceReading(measured, measured + off, np.arange(40))
    origins = ["" if i < 30 else "simulated by tactileforge" for i in range(40)]
    return ForceResult("force", {"val": reading}, "", {}, {"val": origins})


def test_a_mixture_tells_own_forces_from_simulated_ones() -> None:
    result = force_of_sources()
    found = {source: result.scores("val", source)[2].mae for source in result.sources}
    assert found == {
        "": pytest.approx(0.5, abs=1e-4),
        "simulated by tactileforge": pytest.approx(0.1, abs=1e-4),
    }
    lines = _by_source(result)
    assert lines[0].startswith("Force error on 30 validation clips of own recordings: x 0.50, ")
    assert lines[1].startswith("Force error on 10 validation clips of simulated by tactileforge")
    page = Page(_scores(result))
    rows = {row[0]: row[1:] for row in page.tables["force-force"]}
    assert rows["z, validation, own recordings"][0] == "0.50"
    assert rows["z, validation, simulated by tactileforge"][0] == "0.10"
    assert rows["z, validation"][0] == "0.40"


def test_the_last_lines_say_the_result() -> None:
    found = SimpleNamespace(forces=[force_of_sources()], explained={"frames": 0.52}, classes=[])
    first, *_, last = result_lines(found, {}, {"force": 1.0})
    assert re.match(
        r"Force error on 40 validation clips: x 0\.40, y 0\.40, z 0\.40 N; always guessing the "
        r"median: x 0\.\d\d, y 0\.\d\d, z 0\.\d\d N$",
        first,
    )
    assert last.endswith("of the variance of hidden pixels: 52 % of frames")
    curves = {"val/contrast": Curve(np.arange(3), np.array([2.0, 1.5, 1.0]))}
    (line,) = result_lines(None, curves, {"contrast": 1.0})
    assert line == "Validation loss fell by more than 1.0 % for 1 of 1 objectives"


@pytest.mark.slow
def test_the_page_begins_with_run_date_seed_and_data_and_ends_with_what_is_next(
    write: Write, tmp_path: Path
) -> None:
    kept = {"command": ["tactileforge", "train"], "versions": {}, "plugins": {}}
    sealed_text = sealed(kept | {"date": "2026-11-28 05:30 UTC"})
    (tmp_path / "versions.json").write_text(sealed_text)
    page = write(Touches(), "objective=[force]")
    top = page.text[: page.text.index("Encoder")]
    for word in (tmp_path.name, "2026-11-28 05:30 UTC", "Seed", "Data"):
        assert word in top
    sections = [given["id"] for tag, given in page.tags if tag == "section"]
    assert sections[0] == "force"
    assert sections[-1] == "next"
    assert "tactileforge zoo pack" in page.text[page.text.rindex("Next") :]


def test_report_says_that_it_works_before_it_imports_torch(tmp_path: Path) -> None:
    code = """
import os, sys
class Err:
    def write(self, text):
        print("torch" in sys.modules, text, flush=True)
        os._exit(0)
    def flush(self): pass
sys.stderr = Err()
from tactileforge import cli
cli.run(["report", "."])
"""
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.stdout.startswith("False report: reading the run ., its data and weights")
