"""Simulated touch: gels, contact, light, and what sensors make of them."""
