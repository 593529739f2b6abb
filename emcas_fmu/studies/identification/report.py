"""One page on an identification: estimates, what they rest on, pictures. Nothing outside the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...bench.writers import write_page
from ...plots import style, svg
from .result import Identification


def figures(result: Identification) -> list[tuple[str, str, str]]:
    """Title, SVG and caption of every picture."""
    drawn = []
    with style():
        for picture in result.pictures:
            drawn.append((picture.title, svg(picture.draw(), picture.title), picture.caption))
    return drawn


def _number(value: float | None, digits: int = 6) -> str:
    return "–" if value is None else f"{value:.{digits}g}"


def write_report(result: Identification, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    write_page(path, "studies/identification/report.html.j2", result=result, figures=figures(result), number=_number,
               correlated=_strongest(*result.correlation), files={n["file"]: n for n in result.noise})


def _strongest(names: Any, matrix: Any) -> list[tuple[str, str, float]]:
    """Pairs of estimates correlated by more than 0.8, strongest first, ten at most."""
    pairs = [(names[i], names[j], float(matrix[i][j])) for i in range(len(names)) for j in range(i)
             if abs(matrix[i][j]) > 0.8]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))[:10]
