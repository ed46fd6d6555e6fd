"""Calibration of one unit: newtons, light and depth from recordings."""
