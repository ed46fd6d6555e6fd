"""Helpers that know nothing of touch; private, of no promise to anyone outside."""
