"""Built-in data sets: one class a file, registered by entry points like those of plugins."""
