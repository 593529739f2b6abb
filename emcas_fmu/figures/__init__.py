"""Plots by Matplotlib for pages and files, and their curves as data for the pages' script."""

from __future__ import annotations

from pathlib import Path

from ..errors import EmcasError

PICTURES = (".html", ".svg", ".png", ".pdf")


def check_ending(path: Path | None) -> Path | None:
    """Return the path of a picture, or None. Raises EmcasError if it has none of the endings `PICTURES`."""
    if path is not None and path.suffix not in PICTURES:
        raise EmcasError(f"{path}: the name of a plot must end in {', '.join(PICTURES)}")
    return path
