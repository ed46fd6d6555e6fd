"""Shards, their index, and their download."""
