from shared_fixtures import *  # noqa: F403
