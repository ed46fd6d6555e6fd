"""Domain randomisation: the table of ranges, and draws from it."""
