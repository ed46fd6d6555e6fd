"""Types of sensors that are published, as data."""
