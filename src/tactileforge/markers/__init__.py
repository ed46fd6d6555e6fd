"""Printed markers of a gel: found at rest, followed, and summed up ([how](markers.md))."""
