import pytest

from tactileforge.errors import ConfigError
from tactileforge.training.curriculum import (
    Curriculum,
    Ramp,
    from_config,
    in_steps,
    without_waiting,
)

PAPER = {
    "unit": "epoch",
    "objective": {"match": {"start": 20}, "force": {"start": 20}, "align": {"start": 30}},
    "universal": {"low": 0.0, "high": 0.75},
}
WEIGHTS = {"pixel": 1.0, "diff": 1.0, "align": 1.0, "match": 0.02, "force": 0.1}


def paper_weight(step: int, start: int, total: int, largest: float) -> float:
    """The paper's formula, section Training Recipe."""
    return max(0, step - start) / (total - start) * largest


@pytest.mark.parametrize("step", [0, 1, 1999, 2000, 2001, 2999, 3000, 3001, 3500, 4000])
def test_weights_are_the_papers(step: int) -> None:
    plan = from_config(PAPER, WEIGHTS, total=4000, epoch=100)
    weights = plan.weights(step)
    assert weights["pixel"] == weights["diff"] == 1.0
    assert weights["match"] == pytest.approx(paper_weight(step, 2000, 4000, 0.02))
    assert weights["force"] == pytest.approx(paper_weight(step, 2000, 4000, 0.1))
    assert weights["align"] == pytest.approx(paper_weight(step, 3000, 4000, 1.0))
    assert plan.universal(step) == pytest.approx(0.75 * step / 4000)


def test_fractions_and_steps_say_the_same_as_epochs() -> None:
    fraction = {
        "unit": "fraction",
        "objective": {k: {"start": v["start"] / 40} for k, v in PAPER["objective"].items()},
    }
    steps = {
        "unit": "step",
        "objective": {k: {"start": v["start"] * 100} for k, v in PAPER["objective"].items()},
    }
    plans = [from_config(c, WEIGHTS, 4000, 100) for c in (PAPER, fraction, steps)]
    for step in (0, 2000, 2345, 3999):
        assert len({tuple(plan.weights(step).items()) for plan in plans}) == 1


def test_weight_is_zero_up_to_the_start_and_full_at_the_end() -> None:
    ramp = Ramp(start=10, end=20, high=3.0)
    assert [ramp(s) for s in (0, 10, 15, 20, 99)] == [0.0, 0.0, 1.5, 3.0, 3.0]


def test_an_end_before_the_run_ends_holds_the_largest_weight() -> None:
    plan = from_config(
        {"objective": {"force": {"start": 0.2, "end": 0.4}}}, {"force": 0.5}, 100, 10
    )
    assert [plan.weights(s)["force"] for s in (20, 30, 40, 99)] == [0.0, 0.25, 0.5, 0.5]


def test_a_jump() -> None:
    plan = from_config({"objective": {"force": {"start": 0.5, "end": 0.5}}}, {"force": 1.0}, 10, 1)
    assert [plan.weights(s)["force"] for s in (4, 5)] == [0.0, 1.0]


def test_without_a_row_the_weight_is_constant() -> None:
    assert from_config({}, {"pixel": 0.3}, 10, 1) == Curriculum(
        {"pixel": Ramp(low=0.3, high=0.3)}, Ramp(end=10.0, high=0.0)
    )


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"unit": "epochs"}, "did you mean 'epoch'"),
        ({"objective": {"pixel": {"begin": 1}}}, r"curriculum\.objective\.pixel"),
        ({"objective": {"pixel": {"start": 0.5, "end": 0.2}}}, "ends"),
        ({"objective": {"pixel": {"high": 0.5}}}, r"rises from 0 to objective\.pixel\.weight"),
    ],
)
def test_mistakes_are_named(config: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        from_config(config, {"pixel": 1.0}, 10, 1)


@pytest.mark.parametrize(
    ("config", "weight", "message"),
    [
        ({}, -1.0, r"objective.pixel.weight=-1.0"),
        ({}, float("nan"), r"objective.pixel.weight=nan"),
        ({}, None, r"objective.pixel.weight=None: give a finite number"),
        ({"objective": {"pixel": {"start": float("nan")}}}, 1.0, "start=nan"),
        ({"universal": {"low": 0.0, "high": 1.5}}, 1.0, "high=1.5"),
    ],
)
def test_weights_and_chances_that_are_none_are_named(
    config: dict[str, object], weight: float, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        from_config(config, {"pixel": weight}, total=10, epoch=1)


def test_a_row_that_is_null_is_none() -> None:
    config = {"objective": {"pixel": None}}
    assert from_config(config, {"pixel": 1.0}, total=10, epoch=1).weights(0) == {"pixel": 1.0}
    assert in_steps(config, 10, 1)["objective"] == {}


VALUES = {"values": {"encoder": {"mask_ratio": {"end": 0.5, "low": 0.4, "high": 0.8}}}}


def test_numbers_that_change() -> None:
    plan = from_config(VALUES, {}, 100, 10)
    ramp = plan.values["encoder.mask_ratio"]
    assert [ramp(step) for step in (0, 25, 50, 99)] == pytest.approx([0.4, 0.6, 0.8, 0.8])


def test_numbers_that_change_in_steps() -> None:
    longer = in_steps(VALUES, 100, 10)
    assert longer["values"] == {
        "encoder": {"mask_ratio": {"start": 0.0, "end": 50.0, "low": 0.4, "high": 0.8}}
    }
    ramp = from_config(longer, {}, 1000, 10).values["encoder.mask_ratio"]
    assert ramp(25) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"encoder": {"mask_ratio": 0.5}}, "curriculum.values.encoder.mask_ratio=0.5"),
        (
            {"encoder": {"mask_ratio": {"low": 0.5}}},
            "mask_ratio.high=None",
        ),
        ({"encoder": {"mask_ratio": {"low": 0, "high": 1, "from": 2}}}, "unknown key in"),
    ],
)
def test_mistakes_in_numbers_that_change(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        from_config({"values": values}, {}, 100, 10)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"objektive": {}}, "unknown key in curriculum 'objektive'; did you mean 'objective'"),
        ({"objective": {"force": 3}}, "curriculum.objective.force=3: give {start: A, end: B}"),
        ({"objective": {"force": {"start": "x"}}}, "curriculum.objective.force.start=x"),
        ({"objective": {"force": {"end": True}}}, "curriculum.objective.force.end=True"),
        ({"universal": 0.5}, "curriculum.universal"),
        ({"universal": {"high": "x"}}, "curriculum.universal.high=x"),
        ({"values": {"encoder": {"mask_ratio": {"low": 0, "high": float("inf")}}}}, "high=inf"),
    ],
)
def test_mistakes_of_form_are_named(config: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        from_config(config, {"force": 1.0}, 100, 10)
    assert message in str(raised.value)


def test_a_lone_objective_does_not_wait() -> None:
    rows = {"force": {"start": 0.5}, "align": {"start": 0.75}}

    def first(**weights: float) -> dict[str, float]:
        config = without_waiting({"unit": "fraction", "objective": rows}, weights)
        return from_config(config, weights, total=100, epoch=10).weights(0)

    assert first(force=0.1) == {"force": 0.1}
    assert first(force=0.1, align=1.0) == {"force": 0.1, "align": 0.0}
    assert first(force=0.0, align=1.0) == {"force": 0.0, "align": 1.0}
    # with one that starts at once, the others keep their plan
    assert first(pixel=1.0, force=0.1) == {"pixel": 1.0, "force": 0.0}
