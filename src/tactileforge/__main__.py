"""Entry point of ``python -m tactileforge``."""

from tactileforge.cli import main

main()
