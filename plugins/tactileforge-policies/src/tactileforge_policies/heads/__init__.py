"""Policy heads: from observations of a robot to a chunk of commands."""
