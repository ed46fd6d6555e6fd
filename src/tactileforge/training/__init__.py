"""Parts of a training: what is built, fitted, logged and kept."""
