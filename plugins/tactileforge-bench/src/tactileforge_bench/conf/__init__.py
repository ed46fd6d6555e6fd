"""Suites, and trainings that a suite compares, as options of the command line."""
