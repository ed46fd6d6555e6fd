"""Names of the files of results."""

import pytest
from tactileforge_bench.results.write import file_name


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("classes", "anytouch2.tiny"), "classes.anytouch2_tiny"),
        (
            ("real_force", "anytouch2.tiny-real", "0.001", "2"),
            "real_force.anytouch2_tiny-real.0_001.2",
        ),
        (("sim_slip", "no_diff", "pooled"), "sim_slip.no_diff.pooled"),
    ],
)
def test_plain_names_and_those_of_the_zoo_stay(words: tuple[str, ...], name: str) -> None:
    assert file_name(*words) == name


def test_no_two_models_share_a_file() -> None:
    words = ["file:../good/a.safetensors", "file:good/a.safetensors", "file_good_a_safetensors"]
    words += ["run:../a", "run:/a", "run:a", "run_a", "anytouch2.tiny", "anytouch2_tiny"]
    words += ["untrained:anytouch2.tiny", "mine.tiny", "mine_tiny", "0.1", "0_1", "a/b.c", "a.b/c"]
    names = {file_name("task", word) for word in words}
    assert len(names) == len(words)
    assert not any("/" in name for name in names)
