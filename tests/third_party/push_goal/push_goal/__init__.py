"""A package of a third party, as its author wrote it; never edited with the framework."""
