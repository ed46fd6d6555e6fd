"""Every check is right on its own examples, and silent on a touch without a fault."""

import json
import re

import cv2
import numpy as np
import pytest

from tactileforge.checks.check import LEVELS, findings_of
from tactileforge.checks.codes import CODES
from tactileforge.checks.listing import catalogue
from tactileforge.checks.made import made_touch
from tactileforge.checks.run import CheckRun


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_a_check_is_right_on_its_examples(name: str) -> None:
    check = catalogue()[name]
    shown = check.examples()
    assert findings_of(check(), shown.good, shown.sensor) == []
    found = findings_of(check(), shown.bad, shown.sensor)
    assert found
    if shown.sensor is None:
        assert all(re.search(rf"\b{check.code}\b", line) for line in found)


def test_codes_are_given_once_and_say_what_they_are() -> None:
    checks = catalogue()
    assert {name: check.code for name, check in checks.items()} == CODES
    assert len(set(CODES.values())) == len(CODES)
    for check in checks.values():
        assert check.level in LEVELS
        assert all((check.title, check.why, check.fix, check.needs))


def test_right_touches_are_passed_in_silence() -> None:
    run = CheckRun()
    found = [one for seed in range(4) for one in run.look(made_touch(seed), "train")]
    assert [str(one) for one in [*found, *run.end()]] == []
    assert run.unreadable == []


def test_the_page_of_codes_is_that_of_the_checks() -> None:
    from checks_page import PAGE, page

    assert PAGE.read_text() == page(), "run: python benchmarks/checks_page.py"
    assert all(f"\n### {code}\n" in PAGE.read_text() for code in CODES.values())
    shown = re.findall(r"!\[.*\]\(assets/checks/(tf\d+)\.jpg\)", PAGE.read_text())
    assert shown == sorted(code.lower() for code in CODES.values() if code[2] == "3")


@pytest.mark.parametrize("name", ["mirrored", "on_its_side", "odd_first_frames"])
def test_the_picture_of_a_check_is_that_of_its_examples(name: str) -> None:
    from checks_page import PICTURES, picture

    stored = cv2.imread(str(PICTURES / f"{CODES[name].lower()}.jpg"))
    made = picture(catalogue()[name])
    assert stored.shape == made.shape
    assert np.abs(stored[..., ::-1].astype(int) - made).mean() < 3  # JPEG


def test_each_check_of_recordings_has_its_cost() -> None:
    from checks_page import COSTS

    measured = {name for name, check in catalogue().items() if "stream" not in check.needs}
    assert json.loads(COSTS.read_text())["ms"].keys() == measured & CODES.keys()
