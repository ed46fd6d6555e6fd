"""Sensor plugins that come with the package."""
