from published_weights import published  # noqa: F401
