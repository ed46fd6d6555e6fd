"""Reports on the content and the faults of a data set."""
