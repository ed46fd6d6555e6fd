"""Packages of plugins; the example is shipped, `tactileforge plugins new` starts from it."""
