"""The suite ``manipulation``: policies trained on demonstrations, rolled out, and compared."""
