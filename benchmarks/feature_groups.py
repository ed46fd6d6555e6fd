"""Groups of features, weighed by a probe or joined to one vector, against untrained baselines.

Runs the suites ``real``, by which everything was chosen, and ``real_held_out``, which chose
nothing, with closed-form probes; then plain ridge regression, whose features are not standardised,
on the vector that joins the groups and on the vectors of the network. Losing the grip is reported,
not counted. What the folder has already is not measured again.

Run: TACTILEFORGE_REALDATA=DIR python benchmarks/feature_groups.py [FOLDER]
"""

from __future__ import annotations

import json
import statistics
import sys
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import save
from omegaconf import OmegaConf
from tactileforge_bench.fit.features import PLAIN, FeatureStore, extract_features
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.models import model_entry
from tactileforge_bench.fit.probes.group_weights import Kernels
from tactileforge_bench.fit.probes.ridge import Ridge
from tactileforge_bench.fit.resolve import PreparedTask, prepare_task
from tactileforge_bench.results.load import read_results
from tactileforge_bench.results.release_gate import MEAN
from tactileforge_bench.tasks import metrics, splits
from tactileforge_bench.tasks.source import TaskSource, open_source
from tactileforge_bench.tasks.suite import parse_task
from torch import Tensor

from tactileforge import cli
from tactileforge.encoders import joint_vector

MODEL = "touch.tiny"
SUITES = ("real", "real_held_out")
BASELINES = "baselines=[pixels,statistics,imagenet,chance]"
CONF = Path(str(files("tactileforge_bench.conf"))) / "suite"


def weighed(suite: str, folder: Path) -> dict[str, Any]:
    """Scores of the gate, with R2 and correlation of forces, by task, model and reading."""
    words = [f"suite={suite}", f"model=[{MODEL}]", BASELINES, "seeds=1", "workers=0"]
    cli.run(["bench", *words, f"cache={folder}/cache", f"out={folder}/{suite}"])
    gate = json.loads((folder / suite / "gate.json").read_text("utf-8"))
    told = {
        (cell.task, cell.model, cell.setting.get("reading")): cell.metrics
        for cell in read_results(folder / suite).cells
    }
    rows: dict[str, Any] = {}
    for row in gate["rows"]:
        key = row["task"], row["model"], row["reading"]
        main = gate["tasks"][row["task"]]["metric"]
        more = {
            name: round(value, 3)
            for name, value in told.get(key, {}).items()
            if name.startswith(("r2", "correlation")) and name != main
        }
        entry = {name: row[name] for name in ("value", "low", "high")} | more
        entry |= {"above": row["above"]} if row["above"] else {}
        rows.setdefault(row["task"], {})[f"{row['model']}, {row['reading']}"] = entry
    return rows


def plain(suite: str, folder: Path) -> dict[str, dict[str, float]]:
    """Main metric of ridge regression on features as they are, by task and vector."""
    config: Any = OmegaConf.to_container(OmegaConf.load(CONF / f"{suite}.yaml"), resolve=True)
    sources: dict[str, TaskSource] = {}
    prepared = []
    for name, node in config["tasks"].items():
        task = parse_task(name, node)
        key = json.dumps([task.data, list(task.sides), str(task.clip)], sort_keys=True)
        if key not in sources:
            sources[key] = open_source(task.data, task.sides, task.clip)
        prepared.append(prepare_task(task, sources[key]))
    subject = model_entry(MODEL).open[0]()
    store = FeatureStore(folder / "cache" / "features", 0)
    rows: dict[str, dict[str, float]] = {}
    for source in dict.fromkeys(id(one.source) for one in prepared):
        tasks = [one for one in prepared if id(one.source) == source]
        vectors, clips = _vectors(subject, store, tasks)
        for one in tasks:
            places = np.searchsorted(clips, one.target.clips)
            rows[one.task.name] = {
                name: _score(one, values, places) for name, values in vectors.items()
            }
    counted = [one.task.name for one in prepared if one.task.counted]
    names = list(next(iter(rows.values())))
    rows[MEAN] = {
        name: round(statistics.mean(rows[task][name] for task in counted), 4) for name in names
    }
    return rows


def _vectors(
    subject: FrozenEncoder, store: FeatureStore, tasks: Sequence[PreparedTask]
) -> tuple[dict[str, Tensor], np.ndarray]:
    clips = np.unique(np.concatenate([one.clips for one in tasks]))
    taps = ("groups", "projected", "summary")
    policy = tasks[0].task.unknown_sensor
    arrays = extract_features(store, subject, tasks[0].source, clips, taps, policy=policy)
    found = {tap: torch.from_numpy(np.array(arrays[tap, PLAIN])).float() for tap in taps}
    parts = torch.split(found.pop("groups"), list(subject.group_sizes.values()), 1)
    groups = dict(zip(subject.group_sizes, parts, strict=True))
    return {"groups, joined": joint_vector(groups), **found}, clips


def _score(one: PreparedTask, values: Tensor, places: np.ndarray) -> float:
    ((_, part),) = one.target.parts.items()
    model, predicted = Ridge(values.shape[1], one.target.parts), []
    for split in one.splits:
        known = np.sort(np.concatenate([split.train, split.validation]))
        groups = splits.group_names(one.source, one.target, known, one.task.split.group)
        if len(set(groups)) == 1 and one.task.split.unit:
            groups = splits.group_names(one.source, one.target, known, one.task.split.unit)
        rows, asked = values[places[known]], values[places[split.test]]
        mean = rows.mean(0)
        rows, asked = (rows - mean).double(), (asked - mean).double()
        kernels = Kernels((rows @ rows.T)[None], (asked @ rows.T)[None])
        predicted.append(model.solve_part(part, kernels, part.normalised[known], groups)[1])
    test = np.concatenate([split.test for split in one.splits])
    main = one.task.metrics[0]
    found = metrics.measure(main, part, torch.cat(predicted) * part.scale[test], part.truth[test])
    return round(found / (100 if metrics.metric_kind(main).unit == "%" else 1), 4)


def main(words: Sequence[str]) -> None:
    torch.set_num_threads(1)
    folder = Path(words[0] if words else "runs/feature_groups")
    results: Mapping[str, Any] = {
        suite: {"weighed": weighed(suite, folder), "plain": plain(suite, folder)}
        for suite in SUITES
    }
    what = f"{MODEL}; closed-form probes; accuracies as shares, R2 of forces, circles and progress"
    save("feature_groups", {"what": what, **results})


if __name__ == "__main__":
    main(sys.argv[1:])
