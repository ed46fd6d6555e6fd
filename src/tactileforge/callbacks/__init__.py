"""Lightning callbacks: progress and checkpoints."""
