"""Maps of published formats: ``NAME.yaml`` is ``data.preset=NAME``."""
