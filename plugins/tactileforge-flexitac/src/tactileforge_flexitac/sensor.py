"""FlexiTac: a grid of pressure sensors, read over a serial port.

A packet is ``AA 55`` and a byte for each taxel, row by row. There is no length, no checksum and no
counter, and the header may occur among the taxels as well; see `parser.GridParser`.
"""

from __future__ import annotations

from tactileforge_arrays import SerialArray

from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError
from tactileforge.sensors import Parser
from tactileforge_flexitac.parser import GridParser


class FlexiTac(SerialArray):
    """A FlexiTac, drawn as the change of pressure, in counts of its converter.

    Args:
        port: Path of the serial port, for example ``/dev/ttyUSB0``.
        rows: Rows of taxels.
        columns: Columns of taxels.
        span: Change drawn as full colour, counts of 255.
        rate: Largest change of a taxel, counts a second; see `SerialArray`.
        baseline: Packets for the pad without contact (their median), taken at opening.
        baudrate: Bits a second.
        usb: Vendor and product of the board, for example ``1a86:55d3``, to find the port by.
        serial_number: Serial number of the board, to find the port by.

    Attributes:
        spec: Specification. Its rate is measured while the baseline is taken, as the board sends
            as fast as it can.
    """

    spec = SensorSpec(
        name="flexitac",
        height=12,
        width=32,
        fps=90.0,
        area_mm=None,
        force_scale=(5.0, 5.0, 10.0),
        kind="array",
    )
    free_running = True

    def __init__(
        self,
        port: str = "",
        rows: int = 12,
        columns: int = 32,
        span: float = 100.0,
        rate: float | None = None,
        baseline: int = 30,
        baudrate: int = 2_000_000,
        usb: str = "",
        serial_number: str = "",
    ) -> None:
        if rows < 1 or columns < 1:
            raise ConfigError(f"rows={rows} columns={columns}: give 1 or more of each")
        super().__init__(
            port=port,
            type="flexitac",
            shape=(rows, columns),
            payload=f"{rows * columns}B",
            header="aa55",
            span=span,
            rate=rate,
            baseline=baseline,
            fps=self.spec.fps,
            baudrate=baudrate,
            usb=usb,
            serial_number=serial_number,
        )

    def new_parser(self) -> Parser:
        """Builds a parser of its packets."""
        return GridParser(self.framing.header, self.framing.payload)
