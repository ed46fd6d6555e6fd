"""Live sensors: specs, packets, health, and reading in threads."""
