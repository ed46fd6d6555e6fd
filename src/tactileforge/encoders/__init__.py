"""Built-in encoders: one class per file, with entry points like those of other packages."""
