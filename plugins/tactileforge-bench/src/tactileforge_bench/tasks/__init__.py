"""Tasks of the benchmark: clips, targets, splits and metrics."""
