"""Converts users' frames and backgrounds to the encoder's input."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import NEUTRAL_BACKGROUND
from tactileforge.data.batches.clips import resize_frame
from tactileforge.data.frames.pixel_contract import channel_fix, value_fix
from tactileforge.errors import ConfigError, DataError, home_path, nearest_name
from tactileforge.sensors.swapped_colours import warn_of_swapped
from tactileforge.util.pointers import check_pointer

#: Arrays and tensors, uint8, or floats from 0 to 1; PIL images; paths of images; lists of these.
Images: TypeAlias = Any

_CLIP = "(T, H, W, 3) or (T, 3, H, W), or a batch of these"
_STILL = "(H, W, 3) or (3, H, W), or one for each clip"


class ClipInputs(NamedTuple):
    """A batch of clips.

    Attributes:
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        single: Whether one clip was given, without the axis of a batch.
    """

    frames: Tensor
    background: Tensor
    single: bool


def prepare_clips(
    frames: Images, background: Images | str | None, count: int, needed: bool
) -> ClipInputs:
    """Checks frames and background, and puts them into a batch.

    Args:
        frames: See `check_clip`; one image, or a batch with one frame a clip, is shown ``count``
            times.
        background: See `check_clip`; or ``"none"``, which subtracts nothing, or ``"first"``, the
            first frame of each clip.
        count: Frames of a clip.
        needed: Whether the encoder uses the background; if not, None will do.

    Raises:
        DataError: Another type, layout, size or number of frames; says what was expected.
        ConfigError: No background, or an unknown word for it.
    """
    frames, single = _repeat_stills(as_pixels("frames", frames), count)
    background = read_still(background)
    if background is not None and not isinstance(background, str):
        background = as_pixels("background", background)
        return ClipInputs(*check_clip(frames, background, count), single)
    clips, neutral = check_clip(frames, None, count)
    if background == "first":
        return ClipInputs(clips, clips[:, 0], single)
    if background == "none" or (background is None and not needed):
        return ClipInputs(clips, neutral, single)
    raise ConfigError(
        "no background: give a frame without contact of the same recording; background='first' "
        "takes the first frame of each clip, background='none' subtracts nothing"
    )


#: Words in place of a background.
_WORDS = ("first", "none")


def read_still(background: Any) -> Any:
    """A background; of a path the image, and all else unchanged.

    Raises:
        ConfigError: A text that is neither a word for a background nor a path.
        DataError: No such file, or no image.
    """
    if not isinstance(background, str | PathLike) or background in _WORDS:
        return background
    path = home_path(fspath(background))
    if isinstance(background, str) and not path.suffix and not path.exists():
        near = nearest_name(background, _WORDS)
        raise ConfigError(
            f"background={background!r}: no such word or file{near} Give a frame without contact "
            "of the same recording, or its path; background='first' takes the first frame of each "
            "clip, background='none' subtracts nothing"
        )
    return _read("background", path)


def as_pixels(what: str, images: Any) -> Any:
    """Images as uint8 arrays or tensors, if they are given in another form; else unchanged.

    Args:
        what: Name of the images in errors.
        images: A PIL image, a path, floats from 0 to 1, or a list of these, which is stacked.

    Raises:
        DataError: No such file, no image, or floats beyond 0 to 1.
    """
    if isinstance(images, str | PathLike):
        return _read(what, home_path(fspath(images)))
    if isinstance(images, list | tuple):
        if not images:
            raise DataError(f"{what}: an empty list; give images")
        parts = [as_pixels(what, one) for one in images]
        try:
            if any(isinstance(part, Tensor) for part in parts):
                return torch.stack([torch.as_tensor(part) for part in parts])
            return np.stack(parts)
        except (ValueError, RuntimeError) as error:
            raise DataError(f"{what}: a list of different sizes; give one size") from error
    if hasattr(images, "convert") and hasattr(images, "getbands"):  # without importing PIL
        return np.asarray(images.convert("RGB"))
    return _scaled(images)


def _read(what: str, path: Path) -> NDArray[np.uint8]:
    import cv2

    if path.is_dir():
        raise DataError(
            f"{what}: {path}: a folder; give its images, as sorted(pathlib.Path({str(path)!r})"
            '.glob("*.png"))'
        )
    if not path.is_file():
        raise DataError(f"{what}: {path}: no such file; correct the path")
    image = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        check_pointer(path)
        raise DataError(f"{what}: {path}: not an image; for a video: model.encode_video(path)")
    return np.ascontiguousarray(image[..., ::-1])


def _scaled(images: Any) -> Any:
    """Floats from 0 to 1 as uint8; others, and what is not an array, unchanged."""
    if isinstance(images, Tensor) and images.is_floating_point():
        low, high = (float(x) for x in images.detach().aminmax()) if images.numel() else (2.0, 2.0)
        return (255 * images.detach()).round().byte() if 0 <= low <= high <= 1 else images
    floats = isinstance(images, np.ndarray) and np.issubdtype(images.dtype, np.floating)
    if floats and images.size and 0 <= images.min() <= images.max() <= 1:
        return np.rint(255 * images).astype(np.uint8)
    return images


def warn_of_swapped_clips(clips: ClipInputs, stacklevel: int = 4) -> None:
    """Warns of clips with red and blue swapped between the newest frame and the background.

    Args:
        clips: A batch.
        stacklevel: Level of the caller, as in `warnings.warn`.
    """
    if torch.compiler.is_compiling():
        return
    shown, still = (x.movedim(-3, -1).cpu() for x in (clips.frames[:, -1], clips.background))
    warn_of_swapped("clips", shown.numpy(), still.numpy(), stacklevel + 1)


def uses_background(encoder: Any) -> bool:
    """Whether an encoder subtracts the frame without contact."""
    # an encoder of a package with preprocessing of its own is taken to subtract
    return getattr(getattr(encoder, "pixels", None), "offset", 0) is not None


def squash_images(images: NDArray[np.uint8], size: tuple[int, int] | None) -> NDArray[np.uint8]:
    """Images as training reads them from disk: its encoder sees no others.

    Args:
        images: uint8 (..., H, W, 3).
        size: Height and width; None leaves them as they are, as do images of that size.
    """
    if size is None or images.shape[-3:-1] == size:
        return images
    flat = images.reshape(-1, *images.shape[-3:])
    small = np.stack([resize_frame(image, size) for image in flat])
    return small.reshape(*images.shape[:-3], *small.shape[1:])


def squash_clips(clips: ClipInputs, size: tuple[int, int] | None) -> ClipInputs:
    """Clips with squashed frames and backgrounds; see `squash_images`."""
    if size is None or tuple(clips.frames.shape[-2:]) == size:
        return clips
    frames, background = (_squashed(x, size) for x in (clips.frames, clips.background))
    return clips._replace(frames=frames, background=background)


def _squashed(images: Tensor, size: tuple[int, int]) -> Tensor:
    """The same for a tensor (..., 3, H, W), on its device."""
    small = squash_images(images.movedim(-3, -1).cpu().numpy(), size)
    return torch.from_numpy(small).movedim(-1, -3).to(images.device)


def _repeat_stills(frames: Images, count: int) -> tuple[Images, bool]:
    """Repeats single frames ``count`` times along the clip; also tells whether it is one clip."""
    axes = getattr(frames, "ndim", 0)
    if axes == 3:
        frames = frames[None]
    if axes >= 3 and frames.shape[-4] == 1 < count:
        if isinstance(frames, Tensor):
            frames = frames.repeat_interleave(count, -4)
        else:
            frames = np.repeat(frames, count, -4)
    return frames, axes in (3, 4)


def check_clip(
    frames: Images, background: Images | None = None, count: int | None = None
) -> tuple[Tensor, Tensor]:
    """Checks frames and background strictly: nothing is guessed and nothing is resized.

    Time is always the axis before the image. Three frames are no exception: (3, 3, H, W) is three
    frames of three colours.

    Args:
        frames: uint8, (T, H, W, 3) or (T, 3, H, W), RGB, oldest first; or a batch of clips.
        background: uint8, (H, W, 3) or (3, H, W), the frame without contact; one for each clip, or
            one for all. None is a neutral one, which leaves frames as they are.
        count: Frames that the encoder takes; None takes any number.

    Returns:
        uint8 (B, T, 3, H, W) and uint8 (B, 3, H, W).

    Raises:
        DataError: Another type, shape, number of frames, or size of the background; says what was
            expected and found.

    Example:
        >>> import numpy as np
        >>> frames, background = check_clip(np.zeros((4, 240, 320, 3), np.uint8))
        >>> frames.shape, background.shape
        (torch.Size([1, 4, 3, 240, 320]), torch.Size([1, 3, 240, 320]))
    """
    clips = _channels_first("frames", _pixels("frames", frames), 4, _CLIP)
    if count is not None and clips.shape[1] != count:
        stills = (
            "; if they are single images, one per clip, give X[:, None]" if len(clips) == 1 else ""
        )
        raise DataError(
            f"frames: {clips.shape[1]} frames in {tuple(frames.shape)}, but the encoder takes "
            f"{count}: give that many, oldest first, at its spacing{stills * (frames.ndim == 4)}"
        )
    size = tuple(clips.shape[-2:])
    if background is None:
        return clips, torch.full_like(clips[:, 0], NEUTRAL_BACKGROUND)
    still = _channels_first("background", _pixels("background", background), 3, _STILL)
    if tuple(still.shape[-2:]) != size:
        raise DataError(
            f"background: {still.shape[-2]} x {still.shape[-1]} pixels, but the frames have "
            f"{size[0]} x {size[1]}: give a frame without contact of the same recording"
        )
    if len(still) not in (1, len(clips)):
        raise DataError(
            f"background: {len(still)} of them for {len(clips)} clips: give one, or one for each"
        )
    # expand, not repeat: one background for a batch takes no memory
    return clips, still.expand(len(clips), -1, -1, -1).to(clips.device)


def _pixels(what: str, images: Images) -> Tensor:
    if not isinstance(images, np.ndarray | Tensor):
        raise DataError(
            f"{what}: expected a numpy array or a torch tensor, found {type(images).__name__}"
        )
    if images.dtype not in (np.uint8, torch.uint8):
        raise DataError(
            f"{what}: expected uint8 values from 0 to 255, found {images.dtype}{_value_fix(images)}"
        )
    if isinstance(images, Tensor):
        return images
    # torch takes no negative strides, and warns of memory that is read-only, as Pillow gives it
    return torch.from_numpy(np.require(images, requirements=["C", "W"]))


def _value_fix(images: Images) -> str:
    """See `value_fix`; for a tensor in the words of torch."""
    if not isinstance(images, Tensor):
        return value_fix(images)
    fix = value_fix(images.detach().float().cpu().numpy())
    fix = fix.replace("np.rint(255 * x)", "(255 * x).round()").replace("np.rint(x)", "(x).round()")
    return fix.replace(".astype(np.uint8)", ".byte()")


def _channels_first(what: str, images: Tensor, single: int, expected: str) -> Tensor:
    """Adds a batch axis and moves channels first; ``single`` is the number of axes without one."""
    shape = tuple(images.shape)
    if images.ndim not in (single, single + 1) or 0 in shape:
        raise DataError(f"{what}: expected {expected}; found {shape}")
    images = images if images.ndim > single else images[None]
    first, last = images.shape[-3] == 3, images.shape[-1] == 3
    if first and last:
        raise DataError(f"{what}: {shape} is too small an image to tell rows from colours")
    if not first and not last:
        swapped = single == 4 and images.shape[1] == 3
        hint = "; the colours are before the time: swap these two axes" if swapped else ""
        if images.shape[-1] in (1, 4):
            hint = channel_fix(shape)
        raise DataError(f"{what}: expected {expected}; found {shape}{hint}")
    return images if first else images.movedim(-1, -3)
