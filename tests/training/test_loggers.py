"""Metrics of a run are in one file; other loggers get its configuration and figures."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactileforge import cli
from tactileforge.errors import ConfigError
from tactileforge.pages.curves import Curve, read_metrics
from tactileforge.pages.drawings import Drawing, collected_drawings
from tactileforge.pages.figures import curve_figure
from tactileforge.runs.folder import read_config
from tactileforge.training.loggers import MetricsFile, build_loggers, log_config, log_report

SMALL = ["train", "scale=demo", "debug=steps", "encoder.image_size=32", "batch.workers=0"]
SMALL += ["objective=[pixel]", "batch.size=8", "data.scenes=3", "data.val=1", "data.size=32"]


def test_a_row_is_on_disk_at_once_and_new_names_rewrite_the_head(tmp_path: Path) -> None:
    logger = MetricsFile(tmp_path)
    logger.log_metrics({"train/pixel": 0.5}, 0)
    logger.log_metrics({"train/pixel": 0.25}, 1)
    text = (tmp_path / "metrics.csv").read_text()
    assert text == "step,train/pixel\n0,0.5\n1,0.25\n"
    logger.log_metrics({"val/pixel": 2.0}, 1)
    assert (tmp_path / "metrics.csv").read_text() == (
        "step,train/pixel,val/pixel\n0,0.5,\n1,0.25,\n1,,2.0\n"
    )


def test_a_resumed_run_goes_on_with_the_file(tmp_path: Path) -> None:
    """Steps after the checkpoint are taken again: their rows go, as does a row cut off."""
    killed = MetricsFile(tmp_path)
    for step in range(8):
        killed.log_metrics({"train/pixel": 1.0}, step)
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("8,1.")
    resumed = MetricsFile(tmp_path, step=5)
    for step in (5, 6):
        resumed.log_metrics({"train/pixel": 2.0, "lr": 0.1}, step)
    curve = read_metrics(tmp_path)["train/pixel"]
    assert curve.steps.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert curve.values.tolist() == [1, 1, 1, 1, 1, 2, 2]
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.csv"]


def test_a_run_that_starts_anew_has_no_rows_of_another(tmp_path: Path) -> None:
    MetricsFile(tmp_path).log_metrics({"lr": 1.0}, 3)
    MetricsFile(tmp_path).log_metrics({"lr": 2.0}, 0)
    assert read_metrics(tmp_path)["lr"].steps.tolist() == [0]


def test_figures_are_collected_as_images_with_names_of_their_own() -> None:
    curve = Curve(np.array([0, 50, 100]), np.array([3.0, 2.0, 1.0]))
    plain = curve_figure("loss", 100, curve, of="pixel")
    with collected_drawings() as drawings:
        collected = [curve_figure("loss", 100, curve, of="pixel") for _ in range(3)]
    assert collected == [plain] * 3  # the page's own figure is the same
    names = ["pixel loss over steps", "pixel loss over steps (2)", "pixel loss over steps (3)"]
    assert [drawing.name for drawing in drawings] == names
    pixels = drawings[0].pixels
    assert pixels.shape == (360, 630, 3)
    assert (pixels == 255).all(-1).mean() > 0.8  # on white
    blue = (np.abs(pixels.astype(int) - (0x00, 0x72, 0xB2)) < 8).all(-1)
    falls = [int(np.flatnonzero(blue[:, x]).mean()) for x in np.flatnonzero(blue.any(0))]
    assert falls == sorted(falls)  # row numbers grow: the line falls
    assert falls[-1] - falls[0] > 150
    assert not (pixels == (4, 5, 6)).all(-1).any()  # stand-ins of the page's colours


@pytest.mark.slow
def test_tensorboard_gets_configuration_and_figures_of_a_run(tmp_path: Path) -> None:
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    words = [*SMALL, "trainer.max_steps=4", "logger=tensorboard", f"hydra.run.dir={tmp_path}"]
    assert cli.run(words) == 0
    assert cli.run(["train", f"resume={tmp_path}", "trainer.max_steps=6"]) == 0
    assert not list(tmp_path.glob("tensorboard/version_*"))
    found = events.EventAccumulator(str(tmp_path / "tensorboard"), {"images": 0, "tensors": 0})
    found.Reload()
    tags = found.Tags()
    assert "report/pixel loss over steps, and the weight of the objective" in tags["images"]
    assert [event.step for event in found.Scalars("train/loss")] == list(range(6))
    (text,) = found.Tensors("config/text_summary")[0].tensor_proto.string_val
    assert "    max_steps: 4" in text.decode()
    (text,) = found.Tensors("config/text_summary")[-1].tensor_proto.string_val
    assert "    max_steps: 6" in text.decode()
    assert read_config(tmp_path)["trainer"]["max_steps"] == 6
    assert read_metrics(tmp_path)["train/loss"].steps.tolist() == list(range(6))


class FakeWandb:
    """Records the calls to Weights & Biases."""

    def __init__(self) -> None:
        self.config: dict[str, Any] = {}
        self.rows: list[dict[str, Any]] = []
        self.started: dict[str, Any] = {}

    def init(self, **options: Any) -> Any:
        self.started = options
        update = lambda values, allow_val_change: self.config.update(values)  # noqa: E731
        return SimpleNamespace(
            config=SimpleNamespace(update=update),
            log=lambda row, **_: self.rows.append(dict(row)),
        )


def test_wandb_gets_configuration_and_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = FakeWandb()
    module: Any = ModuleType("wandb")
    module.init, module.run, module.Image = fake.init, None, lambda image: image
    lib: Any = ModuleType("wandb.sdk.lib")
    lib.RunDisabled = type("RunDisabled", (), {})
    inner: Any = ModuleType("wandb.wandb_run")
    inner.Run = type("Run", (), {})
    parts = {"wandb": module, "wandb.sdk": ModuleType("wandb.sdk"), "wandb.sdk.lib": lib}
    for name, part in (parts | {"wandb.wandb_run": inner}).items():
        monkeypatch.setitem(sys.modules, name, part)
    monkeypatch.setattr("lightning.pytorch.loggers.wandb._WANDB_AVAILABLE", True)
    loggers = build_loggers({"name": "wandb", "project": "p"}, tmp_path, run="a1b2", step=7)[1:]
    log_config(loggers, {"seed": 3, "optim": {"lr": 0.1}}, tmp_path)
    drawing = Drawing("pixel loss", np.zeros((2, 3, 3), np.uint8))
    log_report(loggers, tmp_path / "report.html", [drawing], 7)
    assert fake.started["id"] == "a1b2"  # a resumed run goes on with its own
    assert fake.started["resume"] == "allow"
    assert fake.config == {"seed": 3, "optim": {"lr": 0.1}}
    assert fake.rows[-1]["report/pixel loss"][0] is drawing.pixels


def test_wandb_without_a_key_says_how_to_log_offline(tmp_path: Path) -> None:
    class UsageError(Exception):
        """As of wandb.errors."""

    class NoKey(MetricsFile):
        def log_hyperparams(self, *_: Any, **__: Any) -> None:
            raise UsageError("No API key configured.\nUse `wandb login` to log in")

    with pytest.raises(ConfigError, match=r"^logger=wandb: No API key .* WANDB_MODE=offline: it"):
        log_config([NoKey(tmp_path)], {"seed": 3}, tmp_path)


class FakeMlflow:
    """Records the calls to MLflow's client."""

    def __init__(self) -> None:
        self.params: dict[str, str] = {}
        self.calls: list[tuple[Any, ...]] = []
        self.runs = 0

    def get_experiment_by_name(self, name: str) -> Any:
        return SimpleNamespace(experiment_id="1", lifecycle_stage="active")

    def create_run(self, **_: Any) -> Any:
        self.runs += 1
        return SimpleNamespace(info=SimpleNamespace(run_id="r1"))

    def get_run(self, run: str) -> Any:
        return SimpleNamespace(info=SimpleNamespace(run_id=run, experiment_id="1"))

    def log_batch(self, run_id: str, params: Any) -> None:
        self.params |= {param.key: param.value for param in params}

    def log_dict(self, *what: Any) -> None:
        self.calls.append(("dict", *what))

    def log_image(self, *what: Any) -> None:
        self.calls.append(("image", *what))

    def log_artifact(self, *what: Any) -> None:
        self.calls.append(("artifact", *what))


def test_mlflow_gets_configuration_figures_and_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = FakeMlflow()
    names = ("mlflow", "mlflow.tracking", "mlflow.entities", "mlflow.tracking.context")
    parts: dict[str, Any] = {name: ModuleType(name) for name in names}
    parts["mlflow"].set_tracking_uri = lambda uri: None
    parts["mlflow.tracking"].MlflowClient = lambda uri: fake
    parts["mlflow.entities"].Param = lambda key, value: SimpleNamespace(key=key, value=value)
    for name, part in parts.items():
        monkeypatch.setitem(sys.modules, name, part)
    where = "lightning.pytorch.loggers.mlflow"
    monkeypatch.setattr(f"{where}._MLFLOW_AVAILABLE", True)
    monkeypatch.setattr(f"{where}._get_resolve_tags", lambda: lambda tags: tags)
    config = {"seed": 3, "optim": {"lr": 0.1}}
    node = {"name": "mlflow", "project": "p"}
    loggers = build_loggers(node, tmp_path)[1:]
    log_config(loggers, config, tmp_path)
    drawing = Drawing("pixel loss", np.zeros((2, 3, 3), np.uint8))
    log_report(loggers, tmp_path / "report.html", [drawing], 7)
    assert fake.params == {"seed": "3", "optim/lr": "0.1"}
    assert fake.calls == [
        ("dict", "r1", config, "config.yaml"),
        ("image", "r1", drawing.pixels, "report/pixel loss.png"),
        ("artifact", "r1", str(tmp_path / "report.html")),
    ]
    (again,) = build_loggers(node, tmp_path, step=7)[1:]
    assert again.run_id == "r1"
    assert fake.runs == 1
