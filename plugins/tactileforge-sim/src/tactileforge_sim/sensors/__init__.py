"""Simulated sensors, for use without hardware."""
