"""The live page: one HTML file, light and dark, for widths from 400 pixels."""

from __future__ import annotations

from pathlib import Path

_FILE = Path(__file__).with_name("page.html")


def page_html(nonce: str) -> str:
    """Text of the page.

    Args:
        nonce: Nonce of its style and script, for the content security policy.
    """
    return _FILE.read_text("utf-8").replace("NONCE", nonce)
