"""Small LeRobot data sets as other programs write them, from their published layout."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet
from tactileforge_lerobot import parquet as parquet_files

FPS, ROWS = 10, 5
LEFT = "observation.images.tactile_left"
WRENCH, PRESSURE = "observation.force_torque", "observation.pressure_matrix"
DATA_2 = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO_2 = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
DATA_3 = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_3 = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
COMMON = ("timestamp", "frame_index", "episode_index", "index", "task_index")


def pictures(number: int, rows: int = ROWS, height: int = 24, width: int = 32) -> NDArray[np.uint8]:
    """Frames of one grey each, 20 apart, uint8 (rows, height, width, 3)."""
    greys = 40 + 20 * np.arange(rows) + 5 * number
    return np.broadcast_to(greys[:, None, None, None], (rows, height, width, 3)).astype(np.uint8)


def columns(number: int, rows: int = ROWS) -> dict[str, NDArray[Any]]:
    """Numbers of an episode: state, action, wrench and pressures."""
    rng = np.random.default_rng(number)
    return {
        "observation.state": rng.normal(0, 1, (rows, 3)).astype(np.float32),
        "action": rng.normal(0, 1, (rows, 3)).astype(np.float32),
        WRENCH: rng.normal(0, 2, (rows, 6)).astype(np.float32),
        PRESSURE: rng.uniform(0, 9, (rows, 4, 4)).astype(np.float32),
    }


def write_video(path: Path, frames: NDArray[Any], codec: str, pix_fmt: str, form: str) -> None:
    """Writes a video by PyAV; FFV1 in Matroska, whatever the suffix, as it writes none in mov."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="matroska" if codec == "ffv1" else None) as container:
        stream = container.add_stream(codec, rate=FPS)
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = pix_fmt
        stream.codec_context.time_base = Fraction(1, FPS)
        for number, frame in enumerate(frames):
            shown = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format=form)
            shown.pts = number
            container.mux(stream.encode(shown))
        container.mux(stream.encode())


def _cell(values: NDArray[Any]) -> Any:
    return values.tolist()


def _png(frame: NDArray[np.uint8]) -> dict[str, Any]:
    return {"bytes": cv2.imencode(".png", frame[..., ::-1])[1].tobytes(), "path": None}


def made_set(
    root: Path,
    version: str = "v2.1",
    images: str = "video",
    episodes: int = 2,
    rows: int = ROWS,
    numbers: dict[str, list[NDArray[Any]]] | None = None,
    videos: dict[str, list[NDArray[Any]]] | None = None,
    shapes: dict[str, list[int]] | None = None,
) -> Path:
    """Writes a data set.

    Args:
        root: Folder of the data set.
        version: v2.0, v2.1 or v3.0.
        images: ``video``, or ``image`` for PNG in the tables.
        episodes: Number of episodes.
        rows: Rows of each.
        numbers: Columns of each episode by name; None for those of `columns`.
        videos: Pictures of each episode by name; None for one of `pictures`.
        shapes: Shapes in the info file, where they differ from those of the data.
    """
    parquet_files.forget()
    tables = numbers
    if tables is None:
        made = [columns(number, rows) for number in range(episodes)]
        tables = {name: [one[name] for one in made] for name in made[0]}
    shown = {LEFT: [pictures(n, rows) for n in range(episodes)]} if videos is None else videos
    features: dict[str, Any] = {
        name: {"dtype": str(parts[0].dtype), "shape": list(parts[0].shape[1:]) or [1]}
        for name, parts in tables.items()
    }
    for name, parts in shown.items():
        features[name] = {"dtype": images, "shape": list(parts[0].shape[1:])}
    for name in COMMON:
        features[name] = {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1]}
    for name, about in features.items():
        about |= {"names": None, "shape": (shapes or {}).get(name, about["shape"])}
    old = version.startswith("v2")
    info = {
        "codebase_version": version,
        "fps": FPS,
        "total_episodes": episodes,
        "chunks_size": 1000,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA_2 if old else DATA_3,
        "video_path": VIDEO_2 if old else VIDEO_3,
        "features": features,
    }
    (root / "meta").mkdir(parents=True)
    (root / "meta/info.json").write_text(json.dumps(info))
    parts = [_table(tables, shown if images == "image" else {}, n, rows) for n in range(episodes)]
    (_write_2 if old else _write_3)(root, parts, shown if images == "video" else {}, rows)
    return root


def _table(
    tables: dict[str, list[NDArray[Any]]],
    shown: dict[str, list[NDArray[Any]]],
    number: int,
    rows: int,
) -> dict[str, list[Any]]:
    held: dict[str, list[Any]] = {
        "timestamp": [float(np.float32(i / FPS)) for i in range(rows)],
        "frame_index": list(range(rows)),
        "episode_index": [number] * rows,
        "index": list(range(number * rows, (number + 1) * rows)),
        "task_index": [0] * rows,
    }
    held |= {name: [_cell(row) for row in parts[number]] for name, parts in tables.items()}
    return held | {name: [_png(f) for f in parts[number]] for name, parts in shown.items()}


def _write_2(
    root: Path,
    parts: list[dict[str, list[Any]]],
    shown: dict[str, list[NDArray[Any]]],
    rows: int,
) -> None:
    lines = []
    for number, part in enumerate(parts):
        path = root / DATA_2.format(episode_chunk=0, episode_index=number)
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(_typed(part), path)
        lines.append({"episode_index": number, "tasks": ["press the ball"], "length": rows})
        for name, videos in shown.items():
            path = root / VIDEO_2.format(episode_chunk=0, video_key=name, episode_index=number)
            write_video(path, videos[number], "mpeg4", "yuv420p", "rgb24")
    (root / "meta/episodes.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
    task = {"task_index": 0, "task": "press the ball"}
    (root / "meta/tasks.jsonl").write_text(json.dumps(task) + "\n")


def _write_3(
    root: Path,
    parts: list[dict[str, list[Any]]],
    shown: dict[str, list[NDArray[Any]]],
    rows: int,
) -> None:
    path = root / DATA_3.format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True)
    joined = {name: [cell for part in parts for cell in part[name]] for name in parts[0]}
    parquet.write_table(_typed(joined), path, row_group_size=rows)
    about: dict[str, list[Any]] = {
        "episode_index": list(range(len(parts))),
        "tasks": [["press the ball"]] * len(parts),
        "length": [rows] * len(parts),
        "data/chunk_index": [0] * len(parts),
        "data/file_index": [0] * len(parts),
    }
    for name, videos in shown.items():
        path = root / VIDEO_3.format(video_key=name, chunk_index=0, file_index=0)
        write_video(path, np.concatenate(videos), "mpeg4", "yuv420p", "rgb24")
        place_videos(about, name, rows)
    episodes = root / "meta/episodes/chunk-000/file-000.parquet"
    episodes.parent.mkdir(parents=True)
    parquet.write_table(pa.Table.from_pydict(about), episodes)
    tasks = pa.Table.from_pydict({"task_index": [0], "task": ["press the ball"]})
    parquet.write_table(tasks, root / "meta/tasks.parquet")


def place_videos(about: dict[str, list[Any]], name: str, rows: int) -> None:
    """Adds the places of a video to the columns of a table of episodes."""
    count = len(about["episode_index"])
    about[f"videos/{name}/chunk_index"] = [0] * count
    about[f"videos/{name}/file_index"] = [0] * count
    about[f"videos/{name}/from_timestamp"] = [n * rows / FPS for n in range(count)]
    about[f"videos/{name}/to_timestamp"] = [(n + 1) * rows / FPS for n in range(count)]


def _typed(held: dict[str, list[Any]]) -> Any:
    """A table with numbers of few bits, as LeRobot writes them."""
    table = pa.Table.from_pydict(held)
    fields = []
    for field in table.schema:
        kind = field.type
        text = str(kind).replace("double", "float")
        kinds = {"float": pa.float32(), "list<element: float>": pa.list_(pa.float32())}
        nested = pa.list_(pa.list_(pa.float32()))
        kinds |= {
            "list<element: list<element: float>>": nested,
            "list<element: list<element: list<element: float>>>": pa.list_(nested),
        }
        fields.append(pa.field(field.name, kinds.get(text, kind)))
    return table.cast(pa.schema(fields))


def changed(root: Path, name: str, change: Any) -> None:
    """Changes a JSON file of a data set."""
    held = json.loads((root / name).read_text())
    change(held)
    (root / name).write_text(json.dumps(held))
    parquet_files.forget()
