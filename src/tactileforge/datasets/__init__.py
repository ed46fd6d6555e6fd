"""Built-in datasets: one class a file, registered by entry point like anyone's."""
