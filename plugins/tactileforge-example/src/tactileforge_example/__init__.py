"""Plugins for tactileforge."""
