"""Plots of pages and files by Matplotlib, and their curves as data for the pages' script."""

from __future__ import annotations

from pathlib import Path

from ..errors import EmcasError

PICTURES = (".html", ".svg", ".png", ".pdf")


def check_ending(path: Path | None) -> Path | None:
    """Return the path of a picture. Raises EmcasError if its ending is none of `PICTURES`."""
    if path is not None and path.suffix not in PICTURES:
        raise EmcasError(f"{path}: a plot ends in {', '.join(PICTURES)}")
    return path
