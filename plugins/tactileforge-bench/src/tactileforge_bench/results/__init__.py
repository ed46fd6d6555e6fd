"""Results on disk: cells, predictions, intervals, the release gate."""
