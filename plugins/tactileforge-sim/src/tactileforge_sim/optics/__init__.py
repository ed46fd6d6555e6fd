"""Rendering: light, camera, markers, and calibrations fitted on real images."""
