"""Built-in objectives: one class a file, registered by entry point like anyone's."""
