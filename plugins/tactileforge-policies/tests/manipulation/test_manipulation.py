"""The table of manipulation: its plan, resuming, intervals and paired differences."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from tactileforge_policies import policy
from tactileforge_policies.manipulation import run
from tactileforge_policies.manipulation.output import _interval, difference
from tactileforge_policies.manipulation.plan import (
    ComparedPolicy,
    ManipulationOptions,
    make_plan,
)
from tactileforge_policies.manipulation.run import CellResult
from tactileforge_policies.rollouts.results import EpisodeResult, wilson

from tactileforge import cli
from tactileforge.errors import ConfigError

TASK = "reach_env:Reach-v0"
POLICIES = {
    "expert": ComparedPolicy(title="expert", actor="expert"),
    "blind": ComparedPolicy(title="no touch", words=["data.touch=none"]),
    "touch": ComparedPolicy(title="touch"),
}


def options(**given):
    own = {"tasks": [TASK], "sensors": ["digit"], "policies": POLICIES, "against": ["blind"]}
    return ManipulationOptions(**own | given)


def test_the_plan_counts_what_there_is_to_do(tmp_path):
    given = options(sensors=["digit", "gelsight"], cross_sensor=True, other_unit=3)
    plan = make_plan(given, tmp_path, 2, [], None)
    assert [s.title for s in plan.settings][:3] == [
        "reach, digit",
        "reach, digit, other gels",
        "reach, digit to gelsight",
    ]
    # two sensors by two seeds by two policies; the expert is not trained
    assert "2 sets of 50 demonstrations, 8 trainings, 30 x 100 rollouts" in plan.told()
    cells = plan.cells()
    assert len({cell.rollouts.folder for cell in cells}) == len(cells)
    crossed = next(c for c in cells if c.setting.on != c.setting.sensor and c.train)
    assert crossed.train.words[-1] == "seed=0"
    assert (crossed.rollouts.sensor, crossed.rollouts.policy) == (
        "gelsight",
        str(crossed.train.folder),
    )
    assert next(c for c in cells if c.setting.unit).rollouts.env == {"unit": 3}


def test_rows_and_tasks_are_chosen_by_name(tmp_path):
    plan = make_plan(options(), tmp_path, 1, ["expert", "touch.tiny"], [TASK])
    assert plan.policies["touch.tiny"].words == ["init=touch.tiny"]
    assert make_plan(options(), tmp_path, 1, ["expert"], None).demonstrations() == []
    with pytest.raises(ConfigError, match="did you mean 'touch'"):
        make_plan(options(), tmp_path, 1, ["tuch"], None)
    with pytest.raises(ConfigError, match="unknown task 'wype'"):
        make_plan(options(), tmp_path, 1, [], ["wype"])


def cell(successes):
    episodes = [
        EpisodeResult(
            seed=seed, success=bool(won), score=0.0, failure="", steps=1, seconds=1.0,
            act_seconds=0.0, times=[], force={},
        )
        for seed, won in enumerate(successes)
    ]  # fmt: skip
    return CellResult(SimpleNamespace(), episodes)


def test_differences_are_paired():
    """Policies with different outcomes at the same few starts: the interval is paired."""
    rng = np.random.default_rng(0)
    theirs = rng.random(400) < 0.5
    ours = theirs | (rng.random(400) < 0.1)
    score = difference([cell(ours)], [cell(theirs)])
    change = ours.astype(float) - theirs
    assert score.value == pytest.approx(change.mean())
    half = 1.96 * change.std() / np.sqrt(len(change))
    assert score.high - score.low == pytest.approx(2 * half, rel=0.1)
    unpaired = 1.96 * np.sqrt((ours.var() + theirs.var()) / len(change))
    assert half < 0.5 * unpaired


@pytest.mark.parametrize("count", [1, 3])
def test_an_interval_has_a_width_where_all_pairs_agree(count):
    never = [cell([0] * 20)] * count
    score = difference(never, never)
    assert score.value == 0
    assert (score.low, score.high) == pytest.approx((-0.161, 0.161), abs=1e-3)
    always = difference([cell([1] * 20)] * count, never)
    assert (always.low, always.high) == pytest.approx((0.772, 1.0), abs=1e-3)


def test_differences_of_two_trainings_cover_their_spread():
    won, lost = cell([1] * 20), cell([0] * 20)
    score = difference([won, lost], [lost])
    assert (score.value, score.low, score.high) == (0.5, 0.0, 1.0)


def test_success_of_several_trainings_covers_their_spread():
    won, lost = cell([1] * 20), cell([0] * 20)
    assert _interval([won, lost]) == (0.0, 1.0)
    assert _interval([won]) == _interval([won, won]) == wilson(20, 20)


class Reads:
    """A policy of ``reach_env``, with or without touch."""

    fingers = ("left", "right")
    sensor = ("digit", "digit")
    state_size = action_size = 2
    rate = 6.0
    tasks = ()
    uses_image = uses_force = uses_reference = False

    def __init__(self, touch):
        self.uses_touch = touch

    def reset(self, background=None, seed=0):
        self.base = float(background["left"].mean())

    def step(self, frames, state, image=None, force=None):
        goal = (frames["left"].mean() - self.base) / 10 if self.uses_touch else 0.0
        return np.array([np.clip(goal - state[0], -2, 2), 0], np.float32)


@pytest.fixture
def _trained(monkeypatch):
    """Instant fake trainings; the one of ``touch`` fails."""

    def pretrain(job):
        (job.folder / "checkpoints").mkdir(parents=True, exist_ok=True)
        if "-touch-" in job.name:
            (job.folder / "failed.txt").write_text("the loss is not finite")
            return
        (job.folder / "report.html").touch()
        (job.folder / "checkpoints/last.ckpt").write_text(job.name)

    monkeypatch.setattr(run, "pretrain", pretrain)
    monkeypatch.setattr(policy, "load_policy", lambda word: Reads("anytouch2" in word))


@pytest.mark.slow
@pytest.mark.usefixtures("_trained")
def test_the_verb_writes_table_json_and_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["bench", "suite=manipulation", f"manipulation.tasks=['{TASK}']", "out=out"]
    words += ["manipulation.rollouts=5", "manipulation.demonstrations=2", "manipulation.size=32"]
    words += ["manipulation.processes=1", "model=[expert,no_touch,anytouch2,touch]"]
    assert cli.run(words) == 3, "one was not run"
    out = capsys.readouterr().out
    assert out.startswith(
        "4 policies in 1 settings: 1 sets of 2 demonstrations, 3 trainings, 4 x 5"
    )
    assert "not run: reach-digit-touch-0: the loss is not finite" in out
    plain = json.loads((tmp_path / "out/results.json").read_text())
    cells = {row["policy"]: row for row in plain["cells"]}
    assert cells["expert"]["successes"] == 4
    assert cells["anytouch2"]["succeeded"] == [0, 1, 2, 3, 4]
    assert cells["no_touch"]["failures"] == {"timeout": 5}
    assert (cells["anytouch2"]["low"], cells["anytouch2"]["high"]) == wilson(5, 5)
    assert cells["touch"]["not_run"] == "the loss is not finite"
    rows = {row["policy"]: row for row in plain["differences"]}
    assert rows["anytouch2"]["value"] == rows["anytouch2"]["high"] == 1.0
    table = (tmp_path / "out/table.md").read_text()
    assert "|AnyTouch2(tiny)|100(57to100)|" in table.replace(" ", "")
    assert "+100 ▲ (+39 to +100)" in table
    assert (tmp_path / "out/rollouts/reach-digit-anytouch2-0/report.html").is_file()
    before = (
        (tmp_path / "out/rollouts/reach-digit-anytouch2-0/episodes/00004.json").stat().st_mtime_ns
    )
    assert cli.run(words) == 3
    after = (
        (tmp_path / "out/rollouts/reach-digit-anytouch2-0/episodes/00004.json").stat().st_mtime_ns
    )
    assert before == after, "what is there is not done again"
