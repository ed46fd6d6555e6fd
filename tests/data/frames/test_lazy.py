import multiprocessing
import pickle
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import videos
from numpy.typing import NDArray
from PIL import Image

from tactileforge.data.frames import video, video_index
from tactileforge.data.frames.lazy import ArrayFrames, ImageFrames, VideoFrames
from tactileforge.errors import DataError, DataNotFoundError

SIZE = (48, 64)


def picture(i: int) -> NDArray[np.uint8]:
    """A picture with its number in eight bars of green; red falls from left to right."""
    frame = np.zeros((*SIZE, 3), np.uint8)
    frame[..., 0] = np.linspace(200, 40, SIZE[1])
    for bit in range(8):
        frame[24:, 8 * bit : 8 * bit + 8, 1] = 200 * (i >> bit & 1)
    return frame


def numbers(frames: NDArray[np.uint8]) -> list[int]:
    """Numbers in pictures."""
    bars = frames[:, 28:44, :, 1].reshape(len(frames), 16, 8, 8)[..., 2:6].mean(axis=(1, 3)) > 100
    return [int(sum(2**bit for bit in range(8) if row[bit])) for row in bars]


def write_video(path: Path, count: int, codec: str, fps: float = 25.0) -> Path:
    return videos.write_video(path, map(picture, range(count)), fps, codec)


def write_gif(path: Path, durations: list[int]) -> Path:
    frames = [Image.fromarray(picture(i)) for i in range(len(durations))]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations)
    return path


def read_in_turn(path: Path) -> NDArray[np.uint8]:
    """Every frame, by nothing but reading from the start."""
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    out = []
    while True:
        good, frame = capture.read()
        if not good:
            return np.stack(out)
        out.append(frame[..., ::-1])


@pytest.fixture
def count_calls(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Counts the calls of OpenCV after a capture is asked to decode."""
    calls = {"open": 0, "grab": 0, "retrieve": 0, "set": 0}
    real = cv2.VideoCapture

    class Spy:
        def __init__(self, *args: object) -> None:
            self.capture = real(*args)
            self.raw = False
            calls["open"] += 1

        def set(self, key: int, value: float) -> bool:
            self.raw |= key == cv2.CAP_PROP_FORMAT
            calls["set"] += not self.raw
            return bool(self.capture.set(key, value))

        def grab(self) -> bool:
            calls["grab"] += not self.raw
            return bool(self.capture.grab())

        def retrieve(self) -> object:
            calls["retrieve"] += 1
            return self.capture.retrieve()

        def __getattr__(self, name: str) -> object:
            return getattr(self.capture, name)

    monkeypatch.setattr(cv2, "VideoCapture", Spy)
    return calls


@pytest.mark.parametrize(
    ("name", "codec"), [("a.mp4", "mp4v"), ("a.mov", "mp4v"), ("a.avi", "MJPG"), ("b.avi", "XVID")]
)
def test_any_order_gives_what_reading_in_turn_gives(tmp_path: Path, name: str, codec: str) -> None:
    path = write_video(tmp_path / name, 100, codec)
    truth = read_in_turn(path)
    frames = VideoFrames(path)
    assert len(frames) == len(truth) == 100
    assert frames.shape == SIZE
    np.testing.assert_allclose(frames.times, np.arange(100) / 25)
    order = np.random.default_rng(0).permutation(100)
    for rows in (order[:30], [99, 0, 99, 3], [50]):
        np.testing.assert_array_equal(frames.read(rows), truth[np.array(rows)])
    one_by_one = np.concatenate([frames.read([int(i)]) for i in order])
    np.testing.assert_array_equal(one_by_one, truth[order])
    assert numbers(one_by_one) == order.tolist()


def test_colours_are_rgb(tmp_path: Path) -> None:
    frame = VideoFrames(write_video(tmp_path / "a.avi", 1, "MJPG")).read([0])[0]
    np.testing.assert_allclose(frame[:, :8, 0].mean(), 191, atol=6)
    assert frame[:, :8, 2].mean() < 10


def test_opening_decodes_nothing_and_reading_only_what_is_asked(
    tmp_path: Path, count_calls: dict[str, int]
) -> None:
    path = write_video(tmp_path / "a.mp4", 60, "mp4v")
    frames = VideoFrames(path)
    assert (len(frames), frames.shape) == (60, SIZE)
    assert count_calls["grab"] == count_calls["retrieve"] == 0
    frames.read([2, 4, 6, 6])
    assert (count_calls["grab"], count_calls["retrieve"]) == (7, 4)
    opened = count_calls["open"]
    frames.read([8])
    assert (count_calls["grab"], count_calls["retrieve"]) == (9, 5), "goes on where it stood"
    frames.crop((0, 0, 8, 8)).read([9])
    assert count_calls["open"] == opened, "tiles share one capture"


def test_a_far_frame_is_sought_and_its_number_proven(
    tmp_path: Path, count_calls: dict[str, int]
) -> None:
    path = write_video(tmp_path / "a.mp4", 120, "mp4v")
    frames = VideoFrames(path)
    assert numbers(frames.read([110])) == [110]
    assert count_calls["set"] == 1
    assert count_calls["grab"] < 40


def test_a_seek_that_lands_elsewhere_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_video(tmp_path / "a.mp4", 120, "mp4v")
    frames = VideoFrames(path)
    real = cv2.VideoCapture

    class Astray:
        def __init__(self, *args: object) -> None:
            self.capture = real(*args)

        def set(self, key: int, value: float) -> bool:
            return bool(self.capture.set(key, value + 7))

        def __getattr__(self, name: str) -> object:
            return getattr(self.capture, name)

    monkeypatch.setattr(cv2, "VideoCapture", Astray)
    assert numbers(frames.read([100])) == [100]
    assert numbers(frames.read([30])) == [30]


def test_times_of_a_varying_rate_are_those_of_the_file(tmp_path: Path) -> None:
    durations = [40, 40, 120, 40, 80, 40, 40, 200, 40, 40]
    path = write_gif(tmp_path / "a.gif", durations)
    frames = VideoFrames(path)
    np.testing.assert_allclose(frames.times, np.cumsum([0, *durations[:-1]]) / 1000)
    truth = read_in_turn(path)
    for i in (9, 2, 7, 8, 0):
        np.testing.assert_array_equal(frames.read([i])[0], truth[i])


def test_a_container_that_announces_too_many_frames_is_counted(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.avi", 60, "MJPG")
    _announce(path, 62)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == 62
    frames = VideoFrames(path)
    assert len(frames) == 60
    assert numbers(frames.read([59])) == [59]


def _announce(path: Path, count: int) -> None:
    data = bytearray(path.read_bytes())
    for tag, offset in ((b"avih", 16), (b"strh", 32)):
        at = data.index(tag) + 8 + offset
        data[at : at + 4] = count.to_bytes(4, "little")
    path.write_bytes(data)


@pytest.mark.parametrize("name", ["a.avi", "a.mp4", "a.gif"])
def test_a_truncated_video_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name.endswith("gif"):
        write_gif(path, [40] * 30)
    else:
        write_video(path, 60, "MJPG" if name.endswith("avi") else "mp4v")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    with pytest.raises(DataError, match=rf"{name}: .*truncated.*ffmpeg"):
        VideoFrames(path)


def test_damage_inside_a_video_is_an_error_on_reading(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_video(tmp_path / "a.mp4", 60, "mp4v")
    data = bytearray(path.read_bytes())
    start, stop = data.index(b"mdat"), data.index(b"moov")
    middle = (start + stop) // 2
    data[middle:stop] = bytes(stop - middle)
    path.write_bytes(data)
    frames = VideoFrames(path)
    assert len(frames) == 60
    assert numbers(frames.read([3])) == [3]
    with pytest.raises(DataError, match=r"a\.mp4: frame 59 of 60 cannot be decoded.*ffmpeg"):
        frames.read([59])
    assert numbers(frames.read([3])) == [3], "a failure leaves nothing behind"
    assert capfd.readouterr().err == "", "the codec's own messages are silenced"


def test_what_is_no_video(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.mp4").write_bytes(b"not a video")
    with pytest.raises(DataError, match=r"a\.mp4: not a video"):
        VideoFrames(tmp_path / "a.mp4")
    with pytest.raises(DataNotFoundError, match=r"b\.mp4: no such file"):
        VideoFrames(tmp_path / "b.mp4")
    assert capfd.readouterr().err == ""


def test_crops(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.avi", 5, "MJPG")
    whole = VideoFrames(path)
    cropped = VideoFrames(path, crop=(10, 4, 30, 20))
    assert cropped.shape == (20, 30)
    want = whole.read([3])[:, 4:24, 10:40]
    np.testing.assert_array_equal(cropped.read([3]), want)
    np.testing.assert_array_equal(whole.crop((10, 4, 30, 20)).read([3]), want)
    with pytest.raises(DataError, match=r"a\.avi: the crop \[40, 0, 30, 20\].*64x48"):
        VideoFrames(path, crop=(40, 0, 30, 20))


def test_frame_numbers_are_checked(tmp_path: Path) -> None:
    video_frames = VideoFrames(write_video(tmp_path / "a.avi", 5, "MJPG"))
    images = ImageFrames(_images(tmp_path, 2))
    for frames in (video_frames, images, ArrayFrames(np.zeros((2, 4, 4, 3), np.uint8))):
        for wrong in (-1, len(frames)):
            with pytest.raises(IndexError, match=f"frame {wrong} of {len(frames)}"):
                frames.read([wrong])


def test_pickling_carries_no_capture(tmp_path: Path) -> None:
    frames = VideoFrames(write_video(tmp_path / "a.mp4", 30, "mp4v"), crop=(0, 0, 32, 48))
    want = frames.read([7])
    data = pickle.dumps(frames)
    assert len(data) < 5000
    again: VideoFrames = pickle.loads(data)
    np.testing.assert_array_equal(again.read([7]), want)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_reader_does_not_disturb_its_parent(tmp_path: Path) -> None:
    frames = VideoFrames(write_video(tmp_path / "a.mp4", 100, "mp4v"))
    assert numbers(frames.read([10])) == [10]
    context = multiprocessing.get_context("fork")
    found = context.SimpleQueue()

    def child() -> None:
        found.put([numbers(frames.read([i]))[0] for i in (60, 20, 90)])

    process = context.Process(target=child)
    process.start()
    assert numbers(frames.read([11, 12, 80])) == [11, 12, 80]
    process.join(timeout=30)
    assert process.exitcode == 0
    assert found.get() == [60, 20, 90]


def test_open_videos_are_bounded(tmp_path: Path) -> None:
    for i in range(12):
        VideoFrames(write_video(tmp_path / f"{i}.avi", 3, "MJPG")).read([0])
        assert len(video._POOL.cursors) <= 8


def test_a_replaced_file_is_opened_anew(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.avi", 10, "MJPG")
    assert numbers(VideoFrames(path).read([5])) == [5]
    write_video(path, 40, "MJPG")
    assert numbers(VideoFrames(path).read([35])) == [35]


def _images(folder: Path, count: int, suffix: str = "png") -> list[Path]:
    paths = [folder / f"{i}.{suffix}" for i in range(count)]
    for i, path in enumerate(paths):
        Image.fromarray(picture(i)).save(path)
    return paths


def test_images(tmp_path: Path) -> None:
    frames = ImageFrames(_images(tmp_path, 4))
    assert (len(frames), frames.shape) == (4, SIZE)
    np.testing.assert_array_equal(frames.read([2, 0, 2]), np.stack([picture(i) for i in (2, 0, 2)]))
    cropped = frames.crop((5, 6, 7, 8))
    np.testing.assert_array_equal(cropped.read([1])[0], picture(1)[6:14, 5:12])


def test_opening_images_reads_headers_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("decoded")

    paths = _images(tmp_path, 3)
    monkeypatch.setattr(Image.Image, "convert", refuse)
    assert len(ImageFrames(paths)) == 3


def test_sizes_that_differ_inside_a_recording(tmp_path: Path) -> None:
    paths = _images(tmp_path, 3)
    Image.fromarray(picture(2)[:40]).save(paths[2])
    with pytest.raises(DataError, match=r"2\.png has 64x40 pixels, .*0\.png 64x48.*one size"):
        ImageFrames(paths)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _garble(path: Path) -> None:
    path.write_bytes(b"not an image")


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize("spoil", [_cut, _garble])
def test_an_unreadable_image_is_named(
    tmp_path: Path, suffix: str, spoil: Callable[[Path], None]
) -> None:
    paths = _images(tmp_path, 2, suffix)
    spoil(paths[1])
    with pytest.raises(DataError, match=rf"1\.{suffix}: not a readable image"):
        ImageFrames(paths).read([1])


def test_other_image_errors(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"0\.png: no such file"):
        ImageFrames([tmp_path / "0.png"])
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / "deep.png")
    with pytest.raises(DataError, match=r"deep\.png: .*8 bits"):
        ImageFrames([tmp_path / "deep.png"])
    with pytest.raises(DataError, match="without images"):
        ImageFrames([])


def test_arrays() -> None:
    array = np.stack([picture(i) for i in range(5)])
    frames = ArrayFrames(array)
    assert (len(frames), frames.shape) == (5, SIZE)
    np.testing.assert_array_equal(frames.read([4, 1]), array[[4, 1]])
    with pytest.raises(DataError, match=r"uint8 \(T, H, W, 3\), not float64"):
        ArrayFrames(array.astype(float))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "count", "fps"),
    [
        ("touchd_force_demo/digit_tactile_320x240.mp4", 547, 30),
        ("gelsight_mini_marker_video/mini_example.avi", 219, 25),
        ("gelsight_mini_tactile_mnist_seq/real_seq.gif", 56, 25),
        ("octopi_physiclear/egg_0.mov", 126, 25),
    ],
)
def test_public_videos(realdata: Path, name: str, count: int, fps: float) -> None:
    frames = VideoFrames(realdata / name)
    truth = read_in_turn(realdata / name)
    assert len(frames) == len(truth) == count
    np.testing.assert_allclose(frames.times, np.arange(count) / fps, atol=1e-6)
    for i in np.random.default_rng(1).integers(0, count, 12):
        np.testing.assert_array_equal(frames.read([int(i)])[0], truth[i])


def avi(width: int, height: int, announced: int) -> bytes:
    """A motion JPEG of three pictures with the given sizes in their headers; they hold 64 x 48."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return kind + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)

    coded = cv2.imencode(".jpg", np.zeros((*SIZE, 3), np.uint8))[1].tobytes()
    place = coded.index(b"\xff\xc0") + 5  # start of frame: height and width
    coded = coded[:place] + struct.pack(">HH", height, width) + coded[place + 4 :]
    main = struct.pack("<14I", 50_000, 0, 0, 16, announced, 0, 1, 0, width, height, 0, 0, 0, 0)
    numbers = (0, 0, 0, 1, 20, 0, announced, 0, 2**32 - 1, 0)
    stream = b"vidsMJPG" + struct.pack("<10I4H", *numbers, 0, 0, 0, 0)
    picture = struct.pack("<IiiHH4s5I", 40, width, height, 1, 24, b"MJPG", 0, 0, 0, 0, 0)
    header = chunk(b"LIST", b"strl" + chunk(b"strh", stream) + chunk(b"strf", picture))
    header = chunk(b"LIST", b"hdrl" + chunk(b"avih", main) + header)
    movie, places = b"movi", b""
    for _ in range(3):
        places += b"00dc" + struct.pack("<III", 16, len(movie), len(coded))
        movie += chunk(b"00dc", coded)
    return chunk(b"RIFF", b"AVI " + header + chunk(b"LIST", movie) + chunk(b"idx1", places))


def test_a_video_of_too_many_frames_is_refused_before_one_is_read(
    tmp_path: Path, count_calls: dict[str, int]
) -> None:
    path = tmp_path / "long.avi"
    path.write_bytes(avi(64, 48, 3))
    assert len(VideoFrames(path)) == 3
    path.write_bytes(avi(64, 48, 2**31 - 1))
    with pytest.raises(DataError, match=r"long\.avi: a video of 2,147,483,647 frames"):
        VideoFrames(path)
    assert count_calls["grab"] == 0


def test_a_video_that_hides_how_many_frames_it_has_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_video(tmp_path / "a.mkv", 12, "MJPG")
    monkeypatch.setattr(video_index, "MAX_FRAMES", 10)
    with pytest.raises(DataError, match=r"a\.mkv: a video of 1\d frames, where 10 are the limit"):
        VideoFrames(path)


@pytest.mark.parametrize("side", [8_193, 12_000])
def test_a_video_of_too_many_pixels_is_refused_before_one_is_decoded(
    tmp_path: Path, side: int, count_calls: dict[str, int]
) -> None:
    path = tmp_path / "wide.avi"
    path.write_bytes(avi(side, side, 3))
    with pytest.raises(DataError, match=rf"wide\.avi: a video of {side} x {side} pixels"):
        VideoFrames(path)
    assert count_calls["grab"] == count_calls["retrieve"] == 0


@pytest.mark.parametrize(
    ("given", "want"),
    [
        ([0, 0.1, 0.1, 0.3], [0, 0.1, 0.2, 0.3]),
        ([0, 0.1, 0.2, 0.2], [0, 0.1, 0.2, 0.25]),
        ([0, 0, 0, 0, 0, 0.5], np.arange(6) / 30),
    ],
)
def test_a_time_that_is_there_twice_changes_no_other(given: list[float], want: list[float]) -> None:
    np.testing.assert_allclose(video_index.spread_times(np.array(given), 30.0), want)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("%04d.png", "no such file, and no pattern of images; open images as frames"),
        ("", "a folder, not a video; open images as frames"),
        ("gone.mp4", "no such file; correct the path"),
        ("x" * 300 + ".mp4", "no such file"),
    ],
)
def test_what_is_no_video_file_is_named(tmp_path: Path, name: str, words: str) -> None:
    for i in range(10):
        Image.fromarray(picture(i)).save(tmp_path / f"{i:04d}.png")
    with pytest.raises(DataError, match=words):
        VideoFrames(tmp_path / name)


@pytest.mark.parametrize("pixel_format", ["gray16le", "rgb48le"])
def test_a_video_of_16_bits_a_channel(tmp_path: Path, pixel_format: str) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "deep.mkv"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=30)
        stream.height, stream.width, stream.pix_fmt = 20, 32, pixel_format
        for packet in [*stream.encode(av.VideoFrame(32, 20, pixel_format)), *stream.encode()]:
            out.mux(packet)
    with pytest.raises(DataError, match=r"deep\.mkv: 16 bits a channel; convert it to 8 bits"):
        VideoFrames(path)
