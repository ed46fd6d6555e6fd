import json
import re
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from omegaconf import OmegaConf

from tactileforge.cli.data import COMMANDS
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import DataError
from tactileforge.packing import Filter, PackOptions, pack
from tactileforge.packing.preview import judge, preview, threshold_for
from tactileforge.util.strict import build

Make = Callable[..., Recording]


@pytest.fixture
def make() -> Make:
    """Makes a recording of two seconds with motion in some frames, by so much."""

    def recording(key: str, moves: slice, strength: int = 40, sensor: str = "digit") -> Recording:
        value = np.zeros(60, int)
        value[moves] = strength
        frames = np.zeros((60, 12, 16, 3), np.uint8)
        frames[:, 4:8, 6:10] = (np.cumsum(value) % 200)[:, None, None, None]
        return Recording(
            key=key,
            sensor=sensor,
            frames=ArrayFrames(frames),
            times=np.arange(60) / 30,
            no_contact=None,
        )

    return recording


def fact(text: str, name: str) -> str:
    match = re.search(rf"<dt>{name}</dt><dd>(.*?)</dd>", text)
    assert match, name
    return match[1]


@pytest.mark.slow
def test_the_page_says_what_packing_keeps(packable: ModuleType, make: Make, tmp_path: Path) -> None:
    data = packable.Given(
        make("a", slice(20, 30)), make("b", slice(0, 0)), val=(make("c", slice(50, 51)),)
    )
    chosen = Filter(laplacian=10.0)
    text = preview(data, "toy", tmp_path / "look.html", PackOptions(filter=chosen)).read_text()
    made = pack(data, "toy", tmp_path / "out", PackOptions(filter=chosen))
    kept = sum(counts["frames"] for counts in made.statistics.values())
    assert kept == (10 + 2 * 6) + (1 + 6 + 6)
    assert fact(text, "Kept") == f"{100 * kept / 180:.0f} %"
    assert fact(text, "Recordings") == "3 looked at, of 3"
    assert fact(text, "Frames") == "180 scored"
    assert {"Kept", "Left out"} == set(re.findall(r'strip-name">([^<]+)<', text))
    assert len(re.findall("<img ", text)) == 2 * (6 + 6 + 6 + 6 + 6)  # b has none that is kept
    assert not re.search(r'(src|href)="(?!data:|#)', text)


def test_suggested_thresholds_keep_what_they_say(make: Make) -> None:
    rng = np.random.default_rng(0)
    judged = [judge(make("still", slice(0, 0)).part(0, 1), Filter())]
    for i in range(20):
        recording = make(str(i), slice(0, 0))
        frames = rng.normal(0, rng.uniform(1, 30), (60, 12, 16, 3)).clip(-99, 99) + 100
        judged.append(
            judge(replace(recording, frames=ArrayFrames(frames.astype(np.uint8))), Filter())
        )
    for share in (0.25, 0.5, 0.75):
        threshold = threshold_for(judged, share)
        kept = np.concatenate([scored.keeps(threshold) for scored in judged[1:]])
        assert abs(kept.mean() - share) < 0.05


def test_every_sensor_is_looked_at(packable: ModuleType, make: Make, tmp_path: Path) -> None:
    many = [make(f"d{i}", slice(9, 12)) for i in range(40)]
    few = [make(f"g{i}", slice(9, 12), sensor="gelsight") for i in range(2)]
    page = preview(packable.Given(*many, *few), "toy", tmp_path / "x.html", recordings=8, frames=30)
    text = page.read_text()
    assert fact(text, "Recordings") == "6 looked at, of 42"
    assert fact(text, "Frames") == "180 scored"
    rows = re.findall(r'<th scope="row">(\w+)</th><td[^>]*>(\d+)</td>', text)
    assert rows == [("digit", "4"), ("gelsight", "2"), ("all", "6")]


def test_a_damaged_recording_is_listed(packable: ModuleType, make: Make, tmp_path: Path) -> None:
    broken = replace(make("broken", slice(0, 0)), frames=packable.Noise(0, 60, {50}))
    page = preview(packable.Given(make("a", slice(0, 9)), broken), "toy", tmp_path / "x.html")
    assert "<li>broken: frame 50 of noise 0 is broken</li>" in page.read_text()
    with pytest.raises(DataError, match="no recording can be read: broken: frame 50"):
        preview(packable.Given(broken), "toy", tmp_path / "y.html")


def test_stills_have_no_threshold(packable: ModuleType, make: Make, tmp_path: Path) -> None:
    still = make("a", slice(0, 0)).part(0, 1)
    options = PackOptions(filter=Filter(laplacian=1))
    text = preview(packable.Given(still), "toy", tmp_path / "x.html", options).read_text()
    assert fact(text, "Kept") == "100 %"
    assert np.isnan(threshold_for([judge(still, Filter())], 0.5))


@pytest.mark.parametrize("data", ["sim", "gsmini_slip"])
def test_keys_of_the_command_line_are_the_options(data: str) -> None:
    words = [f"data={data}", "out=x", "pack.filter.laplacian=3"]
    words += ["data.root=x"] if data == "gsmini_slip" else []
    config = COMMANDS["pack"].compose("data pack", words)
    wanted = asdict(PackOptions(filter=Filter(laplacian=3)))
    assert config["pack"] == json.loads(json.dumps(wanted))  # YAML knows no tuples
    assert COMMANDS["pack"].build(config).pack == PackOptions(filter=Filter(laplacian=3))
    asked = COMMANDS["filter"].compose("data filter", [*words[:1], *words[3:]])
    assert COMMANDS["filter"].build(asked).pack == PackOptions()
    assert config["data"]["name"] in ("sim", "recordings")


def test_options_of_a_sensor_come_from_the_command_line() -> None:
    config = OmegaConf.create({"filter": {"laplacian": {"digit": 3, "gelsight": 9}}})
    plain = OmegaConf.to_container(config)
    chosen = build(PackOptions, "pack", plain).filter  # type: ignore[arg-type]
    assert [chosen.threshold(name) for name in ("digit", "gelsight", "dm")] == [3, 9, None]
