"""YAML options of this package: ``GROUP/NAME.yaml`` is ``GROUP=NAME`` on the command line."""
