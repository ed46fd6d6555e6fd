"""Draws the pictures of docs/gallery.md and writes the page.

Run: python benchmarks/gallery_page.py [KIND | NAME ...]   (pictures of reports need Chromium)
"""

from __future__ import annotations

import argparse

from gallery.page import PAGE, entries, text


def main() -> None:
    """Draws the chosen cards, and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("chosen", nargs="*", help="kinds or names; all of them by default")
    chosen = set(parser.parse_args().chosen)
    for entry in entries():
        if not chosen or {entry.kind, entry.name} & chosen:
            print(entry.save(), flush=True)
    PAGE.write_text(text(), "utf-8")


if __name__ == "__main__":
    main()
