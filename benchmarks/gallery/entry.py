"""An entry of the gallery, and its picture as a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ASSETS = Path(__file__).parents[2] / "docs" / "assets" / "gallery"
#: Width of a card on the page at a device scale of 1.5, pixels.
WIDTH = 620
#: Quality of the pictures: no artefact is seen at the size of a card.
QUALITY = 70


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One part of the software.

    Attributes:
        kind: ``sensor``, ``objective``, ``reader`` or ``report``.
        name: Name of the part, as in commands.
        lines: Three lines of Markdown: purpose, facts, and where to read on.
        alt: Description of the picture for those who do not see it.
        draw: Function to draw the picture.
    """

    kind: str
    name: str
    lines: tuple[str, str, str]
    alt: str
    draw: Callable[[], Image.Image]

    @property
    def file(self) -> str:
        """Name of the picture."""
        return f"{self.kind}_{self.name}.webp"

    def save(self, folder: Path = ASSETS) -> Path:
        """Draws the picture and writes it to a folder."""
        picture = self.draw().convert("RGB")
        if picture.width > WIDTH:
            height = round(picture.height * WIDTH / picture.width)
            picture = picture.resize((WIDTH, height), Image.Resampling.LANCZOS)
        folder.mkdir(parents=True, exist_ok=True)
        picture.save(folder / self.file, quality=QUALITY, method=6)
        return folder / self.file

    def markdown(self) -> str:
        """The card on the page."""
        text = "".join(f"<br>\n    {line}" for line in self.lines)
        picture = f"![{self.alt}](assets/gallery/{self.file})"
        return f"-   {picture}\n\n    **`{self.name}`**{text}\n"
