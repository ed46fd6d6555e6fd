"""Shapes of indenters: signed distances, solids, height fields and textures."""
