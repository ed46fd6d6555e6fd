from shared_fixtures import _cache  # noqa: F401
