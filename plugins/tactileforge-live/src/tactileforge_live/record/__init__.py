"""Recording of live sensors: read in threads, written to shards (`docs/record.md`)."""
