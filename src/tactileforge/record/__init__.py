"""Live sensors: read in threads, recorded to shards (`docs/record.md`)."""
