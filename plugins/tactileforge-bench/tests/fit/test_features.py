"""Features are computed once, whole or not at all, and are those of the encoder."""

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tactileforge_bench.fit import models
from tactileforge_bench.fit.features import FLIPS, PLAIN, FeatureStore, extract_features
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.pixels import PixelFeatures
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import ClipSpec

from tactileforge.contracts import Recording
from tactileforge.data.batches.clips import Clips, collate
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError
from tactileforge.hub.files import make_header

CLIP = ClipSpec(span=0.2, hop=0.1)


def source(
    seed: int = 0, count: int = 3, clip: ClipSpec = CLIP, sensor: str = "digit"
) -> TaskSource:
    rng = np.random.default_rng(seed)
    data = [
        Recording(
            key=f"r{i}",
            sensor=sensor,
            frames=ArrayFrames(rng.integers(0, 256, (12, 32, 40, 3), dtype=np.uint8)),
            times=np.arange(12) / 20,
            no_contact=ArrayFrames(rng.integers(90, 160, (1, 32, 40, 3), dtype=np.uint8)),
        )
        for i in range(count)
    ]
    return TaskSource(data, ["train"] * count, clip)


@pytest.fixture
def subject(encoder: TactileViT) -> FrozenEncoder:
    node = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
    header = make_header(encoder, node, licence="MIT", spacing=0.05, recipe={"encoder": node})
    return FrozenEncoder("tiny", encoder, header)


@pytest.fixture
def store(tmp_path: Path) -> FeatureStore:
    return FeatureStore(tmp_path / "features", workers=0, batch=4, every=1)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Clips of each pass of the encoder."""
    seen: list[int] = []
    forward = TactileViT.forward

    def counted(self: TactileViT, frames: Any, *rest: Any) -> Any:
        seen.append(len(frames))
        return forward(self, frames, *rest)

    monkeypatch.setattr(TactileViT, "forward", counted)
    return seen


def every(of: TaskSource) -> np.ndarray:
    return np.arange(len(of))


def test_they_are_those_of_the_encoder(subject: FrozenEncoder, store: FeatureStore) -> None:
    of = source()
    arrays = extract_features(store, subject, of, every(of), ["tokens", "projected"])
    tokens, projected = arrays["tokens", PLAIN], arrays["projected", PLAIN]
    assert isinstance(tokens, np.memmap)
    assert tokens.shape == (len(of), 14, 192)
    assert (tokens.dtype, projected.shape) == (np.float16, (len(of), 512))
    clips = Clips(of.recordings, 4, 0.05, 0.1, (32, 32))
    clips.index = of.index.astype(np.int32)
    batch = collate([clips[i] for i in range(len(of))])
    rows = subject.encoder.sensor_ids(batch["sensor"])
    with torch.no_grad():
        wanted, cls = subject.encoder(batch["frames"], batch["background"], rows)
    np.testing.assert_allclose(tokens, wanted.numpy(), rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(projected, cls.numpy(), rtol=2e-3, atol=2e-3)


@pytest.mark.slow
def test_the_encoder_is_not_asked_twice(
    subject: FrozenEncoder, store: FeatureStore, calls: list[int]
) -> None:
    of = source()
    first = extract_features(store, subject, of, every(of), ["tokens"])
    assert sum(calls) == len(of)
    again = extract_features(store, subject, source(), every(of), ["tokens"])
    assert sum(calls) == len(of)
    np.testing.assert_array_equal(first["tokens", PLAIN], again["tokens", PLAIN])
    extract_features(store, subject, of, every(of), ["tokens", "projected"])
    assert sum(calls) == 2 * len(of), "the other tap is another pass, once"
    extract_features(store, subject, of, every(of), ["projected"])
    assert sum(calls) == 2 * len(of)


@pytest.mark.slow
def test_another_process_that_computes_them_is_waited_for(
    subject: FrozenEncoder, store: FeatureStore, calls: list[int], tmp_path: Path
) -> None:
    of = source()
    extract_features(store, subject, of, every(of), ["tokens"])
    (folder,) = store.folder.iterdir()
    same = tmp_path / "other" / "features" / folder.name
    same.mkdir(parents=True)
    lock = tmp_path / "other" / "locks" / folder.name
    lock.parent.mkdir()
    hold = "import fcntl, sys; f = open(sys.argv[1], 'a'); fcntl.lockf(f, fcntl.LOCK_EX); "
    hold += "print('held', flush=True); sys.stdin.read()"
    words = [sys.executable, "-c", hold, str(lock)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout
        assert other.stdout.readline() == b"held\n"
        late = replace(store, folder=same.parent)
        wait = partial(extract_features, late, subject, of, every(of), ["tokens"])
        thread = threading.Thread(target=wait)
        thread.start()
        thread.join(0.3)
        assert thread.is_alive()
        shutil.copy(folder / "tokens.npy", same)
        other.communicate()
        thread.join(120)
    assert not thread.is_alive()
    assert sum(calls) == len(of), "the other process had computed them"


@pytest.mark.slow
@pytest.mark.parametrize("what", ["weights", "pixels", "clips", "spacing", "policy"])
def test_what_changes_them_changes_the_key(
    what: str, subject: FrozenEncoder, store: FeatureStore, calls: list[int]
) -> None:
    of, clips, policy = source(), every(source()), "error"
    extract_features(store, subject, of, clips, ["projected"])
    before = sum(calls)
    if what == "weights":
        with torch.no_grad():
            subject.encoder.position[3] += 0.01
        subject = FrozenEncoder("tiny", subject.encoder, subject.header)
    elif what == "pixels":
        of = source(seed=1)
    elif what == "clips":
        clips = clips[1:]
    elif what == "spacing":
        subject.header = replace(subject.header, spacing=0.1)
    else:
        policy = "universal"
    extract_features(store, subject, of, clips, ["projected"], policy=policy)
    assert sum(calls) == before + len(clips)


@pytest.mark.slow
def test_a_stopped_extraction_goes_on(
    subject: FrozenEncoder,
    store: FeatureStore,
    calls: list[int],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    of = source(count=6)
    whole = extract_features(
        replace(store, folder=tmp_path / "other"), subject, of, every(of), ["tokens"]
    )
    calls.clear()
    run: Callable[..., Any] = FrozenEncoder.features

    def stopped(self: FrozenEncoder, *rest: Any) -> Any:
        if len(calls) == 3:
            raise KeyboardInterrupt
        return run(self, *rest)

    monkeypatch.setattr(FrozenEncoder, "features", stopped)
    with pytest.raises(KeyboardInterrupt):
        extract_features(store, subject, of, every(of), ["tokens"])
    assert not list(store.folder.rglob("*.npy"))
    monkeypatch.setattr(FrozenEncoder, "features", run)
    calls.clear()
    arrays = extract_features(store, subject, of, every(of), ["tokens"])
    assert sum(calls) == len(of) - 12
    np.testing.assert_array_equal(arrays["tokens", PLAIN], whole["tokens", PLAIN])
    assert [p.name for p in store.folder.rglob("*") if p.is_file()] == ["tokens.npy"]


@pytest.mark.slow
def test_mirror_images(subject: FrozenEncoder, store: FeatureStore) -> None:
    of = source()
    arrays = extract_features(store, subject, of, every(of), ["projected"], FLIPS)
    mirrored = [
        replace(
            recording,
            frames=ArrayFrames(recording.frames.read(range(12))[:, :, ::-1]),
            no_contact=ArrayFrames(recording.no_contact.read([0])[:, :, ::-1]),  # type: ignore[union-attr]
        )
        for recording in of.recordings
    ]
    other = TaskSource(mirrored, of.sides, CLIP)
    wanted = extract_features(store, subject, other, every(of), ["projected"])["projected", PLAIN]
    np.testing.assert_allclose(arrays["projected", (True, False)], wanted, rtol=0.02, atol=0.02)
    assert np.abs(arrays["projected", PLAIN] - wanted).max() > 0.1


@pytest.mark.slow
def test_single_frames_are_averaged(store: FeatureStore) -> None:
    encoder = PlainViT("tiny", frames=1, tube=1, image_size=32, spacing=0.0)
    header = make_header(
        encoder, {"name": "plain_vit"}, licence="MIT", spacing=0.0, recipe={"a": 1}
    )
    subject = FrozenEncoder("single", encoder, header)
    of = source()
    assert (subject.frames, subject.spacing_of(CLIP)) == (2, 0.2)
    arrays = extract_features(store, subject, of, every(of), ["projected"])["projected", PLAIN]
    number, last = of.index[2]
    clips = Clips(of.recordings, 2, 0.2, 0.1, (32, 32))
    clips.index = np.array([[number, last]], np.int32)
    batch = collate([clips[0]])
    with torch.no_grad():
        both = [
            encoder(batch["frames"][:, i : i + 1], batch["background"], torch.zeros(1).long())[1]
            for i in range(2)
        ]
    np.testing.assert_allclose(arrays[2], (both[0] + both[1])[0] / 2, rtol=2e-3, atol=2e-3)


def test_clips_end_at_the_same_moments_for_all_models(subject: FrozenEncoder) -> None:
    of = source()
    assert of.index[:, 1].tolist() == [4, 6, 8, 10] * 3
    assert of.first.tolist() == [0, 2, 4, 6] * 3
    spread = ClipSpec(span=0.3, spread=True)
    assert subject.spacing_of(spread) == pytest.approx(0.1)
    assert subject.spacing_of(CLIP) == 0.05


def test_imported_models_see_frames_as_they_were(
    subject: FrozenEncoder, encoder: TactileViT
) -> None:
    assert subject.size_for((240, 320)) == (32, 32)
    imported = FrozenEncoder("file", encoder, replace(subject.header, recipe={}))
    assert imported.size_for((240, 320)) == (240, 320)


def test_clips_that_cannot_be_read_are_not_replaced(
    subject: FrozenEncoder, store: FeatureStore
) -> None:
    class Broken(ArrayFrames):
        def read(self, indices: Any) -> Any:
            if len(indices) > 1:
                raise DataError("r1: truncated")
            return super().read(indices)

    of = source()
    for place in (0, 1):
        of.recordings[place] = replace(
            of.recordings[place], frames=Broken(np.zeros((12, 32, 40, 3), np.uint8))
        )
    told = r"^2 recordings cannot be read, and the benchmark skips none; .*: r1: truncated; r1: "
    with pytest.raises(DataError, match=told):
        extract_features(store, subject, of, every(of), ["projected"])


def test_features_that_are_no_numbers(subject: FrozenEncoder, store: FeatureStore) -> None:
    with torch.no_grad():
        subject.encoder.project.weight *= 1e6
    with pytest.raises(DataError, match="model tiny: features that are not finite"):
        extract_features(store, subject, source(), np.arange(3), ["projected"])
    assert not list(store.folder.rglob("*.npy"))


@pytest.mark.slow
def test_sensors_a_model_does_not_know(subject: FrozenEncoder, store: FeatureStore) -> None:
    assert subject.unknown(["digit", "gelsight"]) == []
    subject.encoder.sensors = {"gelsight": 0}
    assert subject.unknown(["digit", "gelsight"]) == ["digit"]
    of = source()
    with pytest.raises(ConfigError, match="unknown sensor"):
        extract_features(store, subject, of, every(of), ["projected"])
    arrays = extract_features(store, subject, of, every(of), ["projected"], policy="universal")
    assert len(arrays["projected", PLAIN]) == len(of)


def test_pixels_know_where_things_are() -> None:
    model = PixelFeatures()
    still = torch.full((1, 3, 64, 64), 100, dtype=torch.uint8)
    frames = still[:, None].repeat(1, 2, 1, 1, 1)
    tokens, small = model(frames, still, torch.zeros(1))
    assert tokens.shape == (1, 64, model.width)
    assert small.shape == (1, model.projected)
    frames[:, 1, :, 8:16, 16:24] += 50
    touched, _ = model(frames, still, torch.zeros(1))
    changed = (touched - tokens).abs().amax(-1)[0].nonzero()[:, 0]
    assert changed.tolist() == [8 + 2], "second row, third column"


@pytest.mark.slow
def test_random_weights_in_the_shape_of_a_recipe() -> None:
    words = ["scale=demo", "encoder.image_size=32"]
    recording = models.model_entry("untrained:anytouch2", words).open[0]()
    again = models.model_entry("untrained:anytouch2", words).open[0]()
    assert recording.weights == again.weights, "the seed is fixed"
    assert recording.facts["parameters"] == sum(p.numel() for p in recording.encoder.parameters())
    assert (recording.frames, recording.facts["image_size"]) == (4, "32 x 32")
    json.dumps(recording.preprocessing)
    with pytest.raises(ConfigError, match="nosuch"):
        models.model_entry("nosuch")
