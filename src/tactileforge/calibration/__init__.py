"""What one unit of a sensor has of its own: light, scale and force (`docs/calibrate.md`)."""
