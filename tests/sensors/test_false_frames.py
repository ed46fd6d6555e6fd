"""Rates of false frames in random bytes, protocol by protocol; the table of docs/record.md.

``TACTILEFORGE_WRITE=1 pytest tests/sensors/test_false_frames.py`` writes it anew.
"""

import os
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_arrays import SerialArray

from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.framing import Datagrams, PacketParser
from tactileforge.sensors.stream import StreamSensor

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "record.md"
BEGIN, END = "<!-- made by tests/sensors/test_false_frames.py -->\n", "<!-- end -->\n"
SIZE = 4_000_000
#: One byte before, and one behind: as little as marks a packet.
WEAK: dict[str, Any] = {"header": "24", "footer": "0a"}


def plugin(name: str, module: str, kind: str) -> Any:
    """A sensor of a package in plugins/, installed or not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / f"plugins/tactileforge-{name}/src")
        return getattr(import_module(f"tactileforge_{name}.{module}"), kind)()


def sensors() -> dict[str, StreamSensor]:
    ati = plugin("ft", "ati", "AtiNetFT")
    ati.scale = np.full(6, 1e-6)  # as its page says, for most
    weak = SerialArray(payload="<16f", **WEAK)
    counts = SerialArray(payload="<16H", limits=[0, 4095], **WEAK)
    return {
        "`anyskin`": plugin("anyskin", "sensor", "AnySkin"),
        "`flexitac`": plugin("flexitac", "sensor", "FlexiTac"),
        "`serial_array`, default (`aa55`, 16 counts)": SerialArray(),
        "`serial_array`, `24` and `0a`, 16 floats": weak,
        "`serial_array`, `24` and `0a`, 16 counts": SerialArray(**WEAK),
        "`serial_array`, `24` and `0a`, 16 counts, `limits=[0,4095]`": counts,
        "`force_torque`, default (`aa55`, 6 floats)": ForceTorque(),
        "`force_torque`, `24` and `0a`, 6 floats": ForceTorque(**WEAK),
        "`force_torque`, `aa55`, checksum `sum8`": ForceTorque(checksum="sum8"),
        "`ati_netft`, datagrams of 36 bytes": ati,
    }


def counted(sensor: StreamSensor) -> tuple[int, int, int]:
    """Packets by their marks alone, those with possible values, and frames, of `SIZE` bytes."""
    marks, parser = sensor.new_parser(), sensor.new_parser()
    if isinstance(marks, PacketParser):
        marks = PacketParser(replace(marks.framing, valid=None))
    step = marks.size if isinstance(marks, Datagrams) else 4096
    data, frames = np.random.default_rng(0).bytes(SIZE), 0
    for start in range(0, SIZE, step):
        piece = data[start : start + step]
        marks.feed(piece)
        sensor.take(parser, piece)
        frames += len(sensor._frames)
        sensor._frames.clear()
    return marks.good, parser.good, frames


def per_million(count: int) -> str:
    million = SIZE / 1e6
    return f"{count / million:,.4g}" if count else f"< {1 / million:g}"


@pytest.mark.slow
def test_the_table_of_false_frames_is_what_random_bytes_give() -> None:
    lines = [
        "| protocol | packets by their marks | with values that can be | frames |",
        "|---|---|---|---|",
    ]
    for what, sensor in sensors().items():
        marks, possible, frames = counted(sensor)
        assert frames <= possible <= marks, what
        assert frames == 0, what
        cells = " | ".join(per_million(count) for count in (marks, possible, frames))
        lines.append(f"| {what} | {cells} |")
    table = "\n".join(lines) + "\n"
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    held, _, after = rest.partition(END)
    if os.environ.get("TACTILEFORGE_WRITE"):
        PAGE.write_text(before + BEGIN + table + END + after, "utf-8")
        return
    assert held == table, "TACTILEFORGE_WRITE=1 pytest tests/sensors/test_false_frames.py"
