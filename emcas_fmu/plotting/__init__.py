"""Plots by Matplotlib for pages and image files, and their curves as data for the script curves.js of pages."""

from __future__ import annotations

from pathlib import Path

from ..errors import EmcasError

IMAGES = (".svg", ".png", ".pdf")
PICTURES = (".html", *IMAGES)
"""Endings of plots: of pages and of images."""


def check_image(path: Path | None, endings: tuple[str, ...] = IMAGES) -> Path | None:
    """Return the path of an image, or None. Raises EmcasError if it has none of the `endings`."""
    if path is not None and path.suffix not in endings:
        raise EmcasError(f"{path}: the name of a plot must end in {', '.join(endings)}")
    return path
