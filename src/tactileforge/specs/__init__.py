"""Published types of sensors, as data."""
