"""Calibrations of synthetic units with known light, scale and force."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tactileforge_live.calibrate.calibrate import CalibrateOptions, calibrate
from tactileforge_live.calibrate.fit import folds
from tactileforge_live.calibrate.light import estimate_light, light_drift, punch_mm_per_pixel

import tactileforge
from tactileforge import cli
from tactileforge.contracts import Recording
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import shards
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.sensors.calibration import file
from tactileforge.sensors.calibration.features import median_background

ROWS, COLUMNS = np.mgrid[-1:1:48j, -1:1:64j]
BLOB = np.exp(-(ROWS**2 + COLUMNS**2) / 0.08)
STILL = np.stack([70 + 20 * COLUMNS, 100 + 10 * ROWS, np.full((48, 64), 130.0)], -1)


def forces(rng: np.random.Generator, frames: int = 30) -> np.ndarray:
    """A press: z rises and falls, x and y go their own ways."""
    phase = np.linspace(0, np.pi, frames)
    tops = rng.uniform([-3, -3, 3], [3, 3, 9])
    shapes = np.stack([np.sin(2 * phase), np.sin(3 * phase), np.sin(phase)], 1)
    return (tops * shapes).astype(np.float32)


def pictures(force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Green grows with z; red and blue lean to a side with x and y."""
    out = np.broadcast_to(STILL, (len(force), *STILL.shape)).copy()
    out[..., 1] += force[:, 2, None, None] * 10 * BLOB
    out[..., 0] += force[:, 0, None, None] * 25 * BLOB * COLUMNS
    out[..., 2] += force[:, 1, None, None] * 25 * BLOB * ROWS
    return (out + rng.normal(0, 1, out.shape)).clip(0, 255).round().astype(np.uint8)


def presses(count: int = 6, seed: int = 0, lag: int = 0) -> list[Recording]:
    rng = np.random.default_rng(seed)
    out = []
    for number in range(count):
        force = forces(rng)
        seen = np.concatenate([np.zeros((lag, 3)), force])[: len(force)]
        rest = pictures(np.zeros((5, 3)), rng)
        out.append(
            Recording(
                key=f"press{number}",
                sensor="digit",
                frames=ArrayFrames(pictures(seen, rng)),
                times=np.arange(len(force)) / 30,
                no_contact=ArrayFrames(rest),
                force=force,
                labels={"unit": "D1", "device": "digit"},
            )
        )
    return out


@pytest.mark.slow
def test_forces_of_pictures_are_found_on_presses_that_were_not_seen() -> None:
    result = calibrate(presses(10), CalibrateOptions())
    force = result.calibration.force
    assert force is not None
    assert {name: axis.r2 > 0.9 for name, axis in force.axes.items()} == dict.fromkeys("xyz", True)
    fresh = presses(4, seed=1)
    for press in fresh:
        error = result.calibration.forces(press) - press.force
        assert np.sqrt((error**2).mean(0)).max() < 0.4  # N, of up to 9
    assert result.notes == []


@pytest.mark.slow
def test_the_error_that_is_told_is_that_of_new_presses() -> None:
    force = calibrate(presses(8), CalibrateOptions(axes=["z"])).calibration.force
    assert force is not None
    assert list(force.axes) == ["z"]
    calibrated = calibrate(presses(8), CalibrateOptions(axes=["z"])).calibration
    errors = [calibrated.forces(press)[:, 2] - press.force[:, 2] for press in presses(8, seed=5)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(force.axes["z"].rmse, rel=0.3)


def test_scale_and_offset_of_an_array_are_recovered() -> None:
    rng = np.random.default_rng(0)
    scale, offset = np.array([2.0, -1.5, 4.0]), np.array([0.3, -0.2, 0.5])
    recordings = []
    for number in range(6):
        values = rng.uniform(-50, 50, (60, 4, 4, 3)).round().clip(-127, 127)
        sums = values.sum((1, 2)) / 127
        force = sums * scale + offset + rng.normal(0, 0.02, sums.shape)
        recordings.append(
            Recording(
                key=f"a{number}",
                sensor="serial_array",
                frames=ArrayFrames((values + 128).astype(np.uint8)),
                times=np.arange(60) / 100,
                no_contact=None,
                force=force.astype(np.float32),
            )
        )
    force = calibrate(recordings, CalibrateOptions(checks=False)).calibration.force
    assert force is not None
    assert force.of == "taxels"
    for number, name in enumerate("xyz"):
        axis = force.axes[name]
        assert axis.weights == {name: pytest.approx(scale[number], rel=2e-3)}
        assert axis.offset == pytest.approx(offset[number], abs=0.01)
        assert axis.rmse == pytest.approx(0.02, rel=0.2)  # the noise, and nothing more


def test_a_model_that_was_written_as_a_track_is_scaled() -> None:
    recordings = [
        replace(press, tracks={"model": (press.force - [0.1, 0.2, -0.4]) / [2, 1, 1.25]})
        for press in presses(3)
    ]
    force = calibrate(recordings, CalibrateOptions(fit="model")).calibration.force
    assert force is not None
    fits = [(axis.weights[name], axis.offset) for name, axis in force.axes.items()]
    np.testing.assert_allclose(fits, [(2, 0.1), (1, 0.2), (1.25, -0.4)], atol=1e-5)


@pytest.mark.slow
def test_the_lag_of_pictures_behind_forces_is_found() -> None:
    recordings = presses(lag=3)  # frames of 1/30 s
    force = calibrate(recordings, CalibrateOptions(max_lag=0.2, axes=["z"])).calibration.force
    assert force is not None
    assert force.lag == pytest.approx(0.1, abs=1 / 60 + 1e-9)
    plain = calibrate(recordings, CalibrateOptions(axes=["z"])).calibration.force
    assert plain is not None
    assert force.axes["z"].rmse < 0.5 * plain.axes["z"].rmse


@pytest.mark.slow
def test_forces_that_stop_are_not_made_up() -> None:
    """Half of each press has no force: nothing is read into it, at any lag."""
    recordings = presses(count=8, lag=3)
    for press in recordings:
        assert press.force is not None
        press.force[len(press.force) // 2 :] = np.nan
    done = calibrate(recordings, CalibrateOptions(max_lag=0.2, axes=["z"]))
    assert done.calibration.force is not None
    assert done.calibration.force.lag == pytest.approx(0.1, abs=2 / 60)
    # 15 known frames at 30/s, and the 3 after them that show forces of before
    assert len(done.fits["z"].measured) <= 8 * 18


@pytest.mark.slow
def test_forces_that_pictures_do_not_show_are_no_calibration() -> None:
    rng = np.random.default_rng(3)
    noise = [replace(press, force=forces(rng)[::-1].copy()) for press in presses()]
    shuffled = [replace(press, force=rng.permutation(press.force)) for press in noise]
    with pytest.raises(DataError, match="forces do not follow from pictures"):
        calibrate(shuffled, CalibrateOptions(checks=False))


def test_presses_are_held_out_whole() -> None:
    assert folds([2] * 6).tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 0, 0]
    assert folds([10]).tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


@pytest.mark.slow
def test_two_units_look_alike_once_they_are_balanced() -> None:
    gains = np.array([0.8, 1.1, 0.9])
    reference, other = calibrate(presses(), CalibrateOptions()).calibration, presses()[0]
    seen = (other.frames.read(range(30)) * gains).round().astype(np.uint8)
    rest = (other.no_contact.read(range(5)) * gains).round().astype(np.uint8)
    dimmed = replace(other, frames=ArrayFrames(seen), no_contact=ArrayFrames(rest))
    calibration = calibrate([dimmed], CalibrateOptions(fit="none"), reference).calibration
    np.testing.assert_allclose(calibration.light.balance, 1 / gains, rtol=0.01)
    difference = calibration.balanced(seen).astype(int) - other.frames.read(range(30))
    assert np.abs(difference).max() <= 2
    assert light_drift(median_background(other), reference.light) < 1
    assert light_drift(median_background(dimmed), reference.light) > 10
    alone = calibrate([dimmed], CalibrateOptions(fit="none")).calibration
    assert np.ptp(alone.balanced(rest).mean((0, 1, 2))) < 0.5  # grey, without a reference


@pytest.mark.parametrize("radius", [14.0, 30.5])
def test_a_punch_gives_the_size_of_a_pixel(radius: float) -> None:
    rows, columns = np.mgrid[:120, :160]
    away = np.hypot(rows - 63, columns - 71) - radius
    rest = np.full((120, 160, 3), 100, np.float32)
    ring = 60 * np.exp(-(away**2) / 12)
    frames = np.stack([rest, rest + ring[..., None] * [1, -1, 0.5], rest])
    scale = punch_mm_per_pixel(frames.round().astype(np.uint8), rest, 6.0, "ring")
    assert scale == pytest.approx(3.0 / radius, rel=0.015)


def test_the_size_of_a_pixel_has_a_source() -> None:
    recordings = presses(2)
    result = calibrate(recordings, CalibrateOptions(fit="none"))
    assert result.calibration.mm_per_pixel == pytest.approx(16.3 / 48)  # of a DIGIT, by its spec
    assert calibrate(recordings, CalibrateOptions(fit="none", mm_per_pixel=0.1)).scale == "given"
    flat = ArrayFrames(np.repeat(recordings[0].no_contact.read([0]), 2, 0))
    still = replace(recordings[0], frames=flat, force=None)
    with pytest.raises(DataError, match="press0: no frame shows contact"):
        calibrate([still], CalibrateOptions(punch_mm=4.0))


def test_bad_recordings_are_named() -> None:
    good = presses(2)
    without = [replace(press, force=None) for press in good]
    second = replace(good[1], labels={"unit": "D2", "device": "digit"})
    bare = replace(good[0], no_contact=None)
    small = replace(good[1], frames=ArrayFrames(good[1].frames.read(range(30))[:, ::2]))
    short = [good[0].part(0, 9)]
    for recordings, options, message in (
        ([], CalibrateOptions(), "there are no recordings"),
        (without, CalibrateOptions(fit="pictures"), "no recording has forces"),
        (
            [good[0], second],
            CalibrateOptions(),
            "digit D1, digit D2: a calibration belongs to a single unit",
        ),
        (good, CalibrateOptions(unit="D9"), "unknown device or unit 'D9'"),
        ([bare], CalibrateOptions(), "press0: no frame without contact"),
        ([good[0], small], CalibrateOptions(), "24 x 64 and 48 x 64 pixels"),
        (short, CalibrateOptions(), "9 frames with a force; give 12"),
        (good, CalibrateOptions(fit="wrench"), "unknown fit 'wrench'"),
    ):
        with pytest.raises((DataError, ConfigError), match=message):
            calibrate(recordings, options)
    assert (
        calibrate([good[0], second], CalibrateOptions(unit="D2", fit="none")).calibration.unit
        == "D2"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"axes": ["w"]}, "unknown axis 'w'"),
        ({"axes": []}, "give some of x, y, z"),
        ({"max_lag": -1}, "max_lag=-1"),
        ({"punch_mm": 0}, "punch_mm=0"),
        ({"punch_mm": 4, "mm_per_pixel": 0.1}, "both set the scale"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        CalibrateOptions(**options)


def test_a_black_light_is_refused() -> None:
    with pytest.raises(DataError, match="a colour is black"):
        estimate_light([np.zeros((8, 8, 3), np.float32)])


def shard(path: Path, recordings: list[Recording]) -> Path:
    packed = []
    for recording in recordings:
        seen = [
            encode_image(frame, "png")
            for frame in recording.frames.read(range(len(recording.frames)))
        ]
        rest = [
            encode_image(frame, "png")
            for frame in recording.no_contact.read(range(len(recording.no_contact)))
        ]
        packed.append(shards.Packed(shards.describe_recording(recording), "png", seen, rest, []))
    shards.write_shard(path, packed)
    return path


@pytest.mark.slow
def test_the_verb_writes_a_file_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shard(tmp_path / "data" / "train-0.tar", presses())
    out = tmp_path / "d1.yaml"
    words = ["calibrate", "data=shards", f"data.root={tmp_path / 'data'}"]
    assert cli.run([*words, f"out={out}", "max_lag=0.05"]) == 0
    assert "force z: error 0." in capsys.readouterr().out
    held = file.load_calibration(out)
    assert (held.sensor, held.unit, held.size) == ("digit", "D1", [48, 64])
    page = out.with_suffix(".html").read_text()
    assert page.count("<svg role") == 6  # prediction and error of three axes
    assert "Calibration of digit D1" in page
    assert cli.run([*words, f"out={tmp_path / 'd2.yaml'}", f"reference={out}", "fit=none"]) == 0
    assert file.load_calibration(tmp_path / "d2.yaml").light.balance == [1.0, 1.0, 1.0]
    data = {"name": "shards", "root": tmp_path / "data"}
    made = tactileforge.calibrate(data=data, out=tmp_path / "d3.yaml", max_lag=0.05)
    assert file.load_calibration(tmp_path / "d3.yaml").force == held.force, "the same from Python"
    assert "Calibration of digit D1" in made._repr_html_()
    capsys.readouterr()
    for wrong, said in (
        (["out=d"], "give the name of a file"),
        ([f"out={out}", "reference=no.yaml"], "no.yaml: no calibration there"),
        ([], "give out=..."),
    ):
        assert cli.run([*words, *wrong]) == 1
        assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_calibration_travels_with_recordings(tmp_path: Path) -> None:
    calibration = calibrate(presses(), CalibrateOptions()).calibration
    calibration.save(tmp_path / "d1.yaml")
    labels = file.calibration_labels(tmp_path / "d1.yaml", "digit", "D1")
    fresh = presses(1, seed=9)[0]
    assert file.calibration_of(fresh) is None
    labelled = replace(fresh, labels={**fresh.labels, **labels})
    (read,) = shards.read_shard(shard(tmp_path / "train-0.tar", [labelled]))
    carried = file.calibration_of(read)
    assert carried == calibration
    np.testing.assert_array_equal(carried.forces(read), calibration.forces(fresh))
    with pytest.raises(ConfigError, match="that of digit D1, and this is digit D2"):
        file.calibration_labels(tmp_path / "d1.yaml", "digit", "D2")
    with pytest.raises(ConfigError, match="and this is gelsight"):
        calibration.forces(replace(fresh, sensor="gelsight"))
    with pytest.raises(DataNotFoundError, match="make it with: tactileforge calibrate"):
        file.load_calibration(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version: 2", "version: 1", "version 1, but this tactileforge reads 2"),
        ("sensor: digit", "sensr: digit", "unknown key of a.yaml 'sensr'; did you mean 'sensor'"),
        ("unit: D1", "unit: D1\nfoo: 3", "unknown key of a.yaml 'foo'"),
        ("mm_per_pixel: 0.5", "mm_per_pixel: -0.5", "mm_per_pixel is -0.5"),
        ("mm_per_pixel: 0.5", "mm_per_pixel: .nan", "mm_per_pixel is nan"),
        ("offset: 0.1", "offset: .inf", r"a\.yaml: force\.axes\.z\.offset is inf"),
        ("offset: 0.1", "offset: much", "offset is 'much', which is not of type float"),
        ("change: 3.0", "change: [3]", r"a\.yaml: force\.axes\.z\.weights is"),
        ("mean: 2.0", "mean: .nan", r"a\.yaml: force\.axes\.z\.errors\.mean is nan"),
        ("as it is: 0.1", "as it is: .inf", r"force\.left_out\.y\.as it is is inf"),
        ("balance: [1.0, 1.0, 1.0]", "balance: [1.0, 0.0, 1.0]", "balance is"),
        ("balance: [1.0, 1.0, 1.0]", "balance: [1.0, 1.0]", "must be 3 numbers"),
        ("    z:", "    w:", "unknown key of a.yaml: force.axes 'w'"),
        ("size: [48, 64]", "size: [48]", "a height and a width"),
        ("version: 2", "version: [", "not YAML"),
        ("version: 2", "", "version None, but this tactileforge reads 2"),
    ],
)
def test_files_at_fault_are_named(old: str, new: str, message: str) -> None:
    errors = {"mean": 2.0, "change": 0.2}
    axis = file.ForceAxis(0.1, {"change": 3.0}, 0.2, 0.9, [0.0, 5.0], None, "change", errors)
    left_out = {"y": {"mean": 0.3, "as it is": 0.1}}
    whole = file.Calibration(
        sensor="digit",
        unit="D1",
        light=file.BackgroundLight([1.0] * 3, [1.0] * 3, [[[1.0] * 3] * 4] * 3),
        mm_per_pixel=0.5,
        size=[48, 64],
        force=file.ForceModel("pictures", 0.0, {"z": axis}, left_out=left_out),
    )
    text = whole.text()
    assert file.parse_calibration(text, "a.yaml") == whole
    assert old in text
    with pytest.raises(ConfigError, match=r"a\.yaml: its checksum does not match"):
        file.parse_calibration(text.replace(old, new), "a.yaml")
    text = text.partition("\n")[2]  # by hand, on purpose
    with pytest.raises(ConfigError, match=message):
        file.parse_calibration(text.replace(old, new), "a.yaml")


def test_a_range_of_borders_that_is_no_range_is_named() -> None:
    axis = file.ForceAxis(0.1, {"change": 3.0}, 0.2, 0.9, [0.0, 5.0])
    for borders, message in (
        ([[0.0] * 24], "must be 2 rows of 24 numbers"),
        ([[0.0] * 24, [1.0] * 23], "must be 2 rows of 24 numbers"),
        ([[0.0] * 24, [float("nan")] * 24], r"borders\[1\] is nan, but must be a finite number"),
    ):
        force = file.ForceModel("pictures", 0.0, {"z": axis}, borders=borders)
        text = file.Calibration(sensor="digit", force=force).text()
        with pytest.raises(ConfigError, match=message):
            file.parse_calibration(text, "a.yaml")


@pytest.mark.slow
def test_a_flipped_bit_of_a_calibration_is_named(tmp_path: Path) -> None:
    axis = file.ForceAxis(0.1, {"change": 3.0}, 0.2, 0.9, [0.0, 5.0])
    force = file.ForceModel("pictures", 0.0, {"z": axis})
    path = tmp_path / "d1.yaml"
    file.Calibration(sensor="digit", unit="D1", force=force).save(path)
    raw = path.read_bytes()
    for bit in range(8 * len(raw)):
        flipped = bytearray(raw)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        with pytest.raises(ConfigError, match=r"d1\.yaml: "):
            file.load_calibration(path)


@pytest.mark.parametrize(
    ("code", "turn"),
    [
        ("TF202", lambda force: force * np.float32([1, 1, -1])),  # z out of the gel
        ("TF201", lambda force: force * np.float32(101.97)),  # grams
        ("TF201", lambda force: force * np.float32(1000)),  # mN
        ("TF205", lambda force: force + np.float32([0, 0, 2.5])),  # the weight of the tool
        ("TF205", lambda force: force + np.float32([-1.5, 0, 0])),
        ("TF204", lambda force: np.abs(force)[:, [2, 0, 1]]),
        ("TF207", lambda force: force * 0),
    ],
)
def test_wrong_forces_are_not_fitted(code: str, turn: Callable[[np.ndarray], np.ndarray]) -> None:
    # at rest at both ends, where an offset shows
    wrong = [replace(press, force=turn(press.force)) for press in presses()]
    with pytest.raises(DataError, match=rf"{code}.*checks=false"):
        calibrate(wrong, CalibrateOptions())


@pytest.mark.slow
def test_wrong_forces_are_fitted_when_told_to_and_said() -> None:
    wrong = [replace(press, force=press.force + np.float32([0, 0, 2.5])) for press in presses()]
    result = calibrate(wrong, CalibrateOptions(checks=False))
    assert any(line.startswith("TF205 untared force in ") for line in result.notes)
    assert not any("TF2" in line for line in calibrate(presses(), CalibrateOptions()).notes)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_the_command_writes_no_calibration_of_wrong_forces(
    factor: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "shards"
    root.mkdir()
    shown = [replace(press, force=press.force * np.float32(factor)) for press in presses()]
    shard(root / "train-000000.tar", shown)
    out = tmp_path / "unit.yaml"
    words = ["calibrate", "data=shards", f"data.root={root}", f"out={out}", "axes=[z]"]
    assert cli.run(words) == (0 if factor > 0 else 1)
    assert out.exists() == (factor > 0)
    if factor < 0:
        assert "TF202" in capsys.readouterr().err
        assert cli.run([*words, "checks=false"]) == 0
        assert out.exists()
