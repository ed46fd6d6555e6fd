"""Videos of codecs unknown to OpenCV; and PyAV against OpenCV for the others."""

import multiprocessing
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactileforge.data.frames import pyav, video
from tactileforge.data.frames.video import VideoFrames
from tactileforge.data.frames.video_index import open_video, read_index
from tactileforge.errors import ConfigError, DataError

av = pytest.importorskip("av")

COUNT, RATE = 60, 30


def pictures() -> np.ndarray:
    """Smooth pictures, uint8 (60, 48, 64, 3), with their number as brightness."""
    rows, columns = np.mgrid[:48, :64]
    still = np.stack([20 + columns // 2, 20 + rows, 60 - columns // 2], -1)
    return (still + 3 * np.arange(COUNT)[:, None, None, None]).clip(0, 255).astype(np.uint8)


def write(path: Path, codec: str, **options: str) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for picture in pictures():
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.fixture(scope="module", params=["2", "20", "240"])
def av1(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As LeRobot writes them (a key frame every second picture), and with fewer key frames."""
    path = tmp_path_factory.mktemp("av1") / "file.mp4"
    encoders = [name for name in ("libsvtav1", "libaom-av1") if name in av.codecs_available]
    if not encoders:
        pytest.skip("this PyAV has no encoder of AV1")
    preset = {"preset": "10"} if encoders[0] == "libsvtav1" else {"cpu-used": "8"}
    write(path, encoders[0], g=request.param, crf="5", **preset)
    return path


@pytest.mark.slow
def test_every_frame_of_av1_is_read_in_any_order(av1: Path) -> None:
    frames, wanted = VideoFrames(av1), pictures()
    assert (len(frames), frames.shape) == (COUNT, (48, 64))
    np.testing.assert_allclose(frames.times, np.arange(COUNT) / RATE, atol=1e-6)
    everything = frames.read(range(COUNT))
    away = np.abs(everything.astype(int)[:, None] - wanted[None]).mean((2, 3, 4))
    assert np.diag(away).max() < 2.5
    assert away.argmin(1).tolist() == list(range(COUNT))
    for order in ([59], [3, 41, 2, 2, 58], [0], [55, 5]):
        np.testing.assert_array_equal(frames.read(order), everything[order])


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_does_not_wait_for_threads_of_its_parent(av1: Path) -> None:
    """Decoders of AV1 have threads; a fork has none, and closing what it inherited would hang."""
    frames = VideoFrames(av1)
    frames.read([3])
    context = multiprocessing.get_context("fork")
    process = context.Process(target=frames.read, args=([40],))
    process.start()
    process.join(timeout=60)
    process.kill()
    assert process.exitcode == 0


def test_pyav_sees_what_opencv_sees(tmp_path: Path) -> None:
    """Both decode MPEG-4 part 2; the conversion of its colours may round differently."""
    path = tmp_path / "file.mp4"
    write(path, "mpeg4", g="12")
    cursor = pyav.PyAvCursor(str(path), read_index(str(path)))
    theirs = [cursor.frame(i)[..., ::-1].astype(int) for i in (0, 50, 7, 30, 59)]
    ours = VideoFrames(path).read([0, 50, 7, 30, 59]).astype(int)
    assert np.abs(np.stack(theirs) - ours).max() <= 3


def test_a_missing_pyav_is_named_when_the_video_is_opened(
    av1: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if open_video(str(av1)).grab():
        pytest.skip("this OpenCV decodes AV1")
    monkeypatch.setattr(video, "is_missing", lambda: True)
    with pytest.raises(ConfigError, match=r"av01.*PyAV does: pip install .*av"):
        VideoFrames(av1)


def test_a_damaged_av1_file_is_named(av1: Path, tmp_path: Path) -> None:
    path = tmp_path / "bad.mp4"
    content = bytearray(av1.read_bytes())
    start = content.index(b"mdat")
    size = int.from_bytes(content[start - 4 : start], "big") - 8
    content[start + 4 : start + 4 + size] = bytes(size)
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"bad\.mp4: frame 0 of 60 cannot be decoded"):
        VideoFrames(path).read([0])


def test_other_codecs_stay_with_opencv(tmp_path: Path) -> None:
    path = tmp_path / "file.mp4"
    write(path, "mpeg4")
    index = read_index(str(path))
    assert index.codec not in pyav.CODECS
    assert isinstance(video._cursor(str(path), index, 0), video._OpenCvCursor)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == COUNT


def test_metadata_that_is_no_utf_8(tmp_path: Path) -> None:
    encoders = [name for name in ("libsvtav1", "libaom-av1") if name in av.codecs_available]
    if not encoders:
        pytest.skip("this PyAV has no encoder of AV1")
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        container.metadata["comment"] = "recorded at MUENCHEN"
        stream = container.add_stream(encoders[0], rate=RATE, options={"preset": "12"})
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        black = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), format="rgb24")
        container.mux(stream.encode(black))
        container.mux(stream.encode(None))
    raw = path.read_bytes()
    assert b"MUENCHEN" in raw
    path.write_bytes(raw.replace(b"MUENCHEN", b"M\xfcNCHEN\xff"))
    assert VideoFrames(path).read([0]).shape == (1, 64, 64, 3)
