"""Suites, and trainings to compare, as options of the command line."""
