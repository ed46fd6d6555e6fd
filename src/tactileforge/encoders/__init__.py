"""Built-in encoders: one class a file, registered by entry point like anyone's."""
