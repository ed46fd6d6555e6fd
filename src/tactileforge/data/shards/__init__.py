"""Shards, their index, and how they are fetched."""
