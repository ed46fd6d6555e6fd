"""Lazy frames of videos, image files, arrays and archives."""
