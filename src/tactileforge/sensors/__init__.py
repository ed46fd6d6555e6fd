"""Built-in live sensors: one class a file, registered by entry point like anyone's."""
