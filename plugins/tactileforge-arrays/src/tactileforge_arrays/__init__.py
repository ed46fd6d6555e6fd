"""Arrays of taxels for tactileforge: a driver to derive from, simulated arrays, and a recipe."""

from tactileforge_arrays.serial_array import SerialArray

__all__ = ["SerialArray"]
