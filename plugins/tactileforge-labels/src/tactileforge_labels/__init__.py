"""Contact, slip and bad frames of recordings, marked by hand on a local page."""
