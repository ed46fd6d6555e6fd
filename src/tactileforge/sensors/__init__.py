"""Types of sensors, and live sensors."""
