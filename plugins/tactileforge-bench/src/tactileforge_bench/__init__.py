"""Compares encoders: tasks, probes, metrics, tables."""
