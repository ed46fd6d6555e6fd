from shared_fixtures import _cache, _one_process, _seeded  # noqa: F401
