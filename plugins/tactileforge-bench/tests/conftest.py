from shared_fixtures import (  # noqa: F401
    _cache,
    _no_thread_is_left,
    _one_process,
    _seeded,
    batch,
    encoded,
    encoder,
    installed,
    levels,
    realdata,
    scripted,
    warm,
)
