"""From recordings to batches: sources, clips, pairs and streams."""
