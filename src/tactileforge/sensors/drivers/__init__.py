"""Sensor plugins of the package."""
