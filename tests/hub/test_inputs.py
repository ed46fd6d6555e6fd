import numpy as np
import pytest
import torch

from tactileforge.errors import DataError
from tactileforge.hub.inputs import Images, check_clip

RNG = np.random.default_rng(0)
CLIP = RNG.integers(0, 256, (3, 10, 12, 3), dtype=np.uint8)
STILL = RNG.integers(0, 256, (10, 12, 3), dtype=np.uint8)
FIRST = np.moveaxis(CLIP, -1, -3)


@pytest.mark.parametrize(
    "frames",
    [CLIP, FIRST, CLIP[None], FIRST[None], torch.from_numpy(CLIP), torch.from_numpy(FIRST.copy())],
    ids=["last", "first", "batch last", "batch first", "tensor last", "tensor first"],
)
@pytest.mark.parametrize("background", [STILL, np.moveaxis(STILL, -1, 0), STILL[None]])
def test_three_frames_in_every_layout_are_the_same(frames: Images, background: Images) -> None:
    clips, still = check_clip(frames, background, count=3)
    assert clips.shape == (1, 3, 3, 10, 12)
    assert (clips[0].numpy() == FIRST).all()
    assert (still[0].numpy() == np.moveaxis(STILL, -1, 0)).all()


@pytest.mark.parametrize(
    ("channels", "hint"), [(4, r"leave out the alpha: \[\.\.\., :3\]"), (1, "repeat grey ones")]
)
def test_other_numbers_of_colours_have_a_hint(channels: int, hint: str) -> None:
    with pytest.raises(DataError, match=hint):
        check_clip(np.zeros((3, 10, 12, channels), np.uint8))


def test_views_of_arrays_and_one_background_for_all() -> None:
    read_only = CLIP[:, ::-1, ::-1]
    read_only.setflags(write=False)
    clips, still = check_clip(np.stack([read_only] * 4), STILL)
    assert (clips[2].permute(0, 2, 3, 1).numpy() == CLIP[:, ::-1, ::-1]).all()
    assert still.shape == (4, 3, 10, 12)
    _, neutral = check_clip(read_only)
    assert (neutral == 130).all()


@pytest.mark.parametrize(
    ("frames", "background", "message"),
    [
        (CLIP.astype(np.float32), None, r"found float32 from 0 to 255: convert with np\.rint\(x\)"),
        (CLIP / 255, None, r"found float64 from 0 to 1: convert with np\.rint\(255 \* x\)"),
        (torch.from_numpy(CLIP).float(), None, r"found torch\.float32 .*\(x\)\.round\(\)\.byte"),
        (CLIP / 255 - 0.5, None, r"before normalisation"),
        (CLIP.tolist(), None, "found list"),
        (CLIP[0], None, r"expected \(T, H, W, 3\).*found \(10, 12, 3\)"),
        (CLIP[..., :2], None, r"found \(3, 10, 12, 2\)"),
        (np.zeros((3, 4, 10, 12), np.uint8), None, r"found \(3, 4, 10, 12\)"),
        (np.zeros((2, 3, 4, 10, 12), np.uint8), None, r"colours are before the time"),
        (np.zeros((4, 3, 10, 3), np.uint8), None, "too small an image"),
        (np.zeros((0, 10, 12, 3), np.uint8), None, r"found \(0, 10, 12, 3\)"),
        (np.zeros((4, 10, 12, 3), np.uint8), None, "4 frames .* takes 3"),
        (CLIP, STILL[:5], "background: 5 x 12 pixels, but the frames have 10 x 12"),
        (CLIP, np.stack([STILL] * 2), "2 of them for 1 clips"),
        (CLIP, STILL / 255, "background: expected uint8"),
        (CLIP, CLIP[..., None], r"background: expected \(H, W, 3\)"),
    ],
)
def test_what_is_wrong_is_said(frames: Images, background: Images | None, message: str) -> None:
    with pytest.raises(DataError, match=message):
        check_clip(frames, background, count=3)
