"""The live page: one HTML file, light and dark, from 400 pixels on."""

from __future__ import annotations

from pathlib import Path

_FILE = Path(__file__).with_name("page.html")


def page_html(nonce: str) -> str:
    """The page.

    Args:
        nonce: Of its style and script, for the content security policy.
    """
    return _FILE.read_text("utf-8").replace("NONCE", nonce)
