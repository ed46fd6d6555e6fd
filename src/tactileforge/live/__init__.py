"""Live sensors: read in threads, estimated, shown and published (`docs/live.md`)."""
