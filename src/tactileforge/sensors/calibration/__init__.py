"""Calibration of one unit of a sensor: light, scale and force (`docs/calibrate.md`)."""
