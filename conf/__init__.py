"""Hydra configuration, shipped with the package as ``tactileforge.conf``."""
