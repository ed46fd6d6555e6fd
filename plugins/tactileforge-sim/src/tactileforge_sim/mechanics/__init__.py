"""Contact mechanics of the gel: pressure, friction, motion and surface."""
