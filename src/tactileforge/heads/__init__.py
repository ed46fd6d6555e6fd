"""Built-in heads: one class per file, registered by entry points like those of other packages."""
