"""One page on an identification: estimates, what they rest on, pictures. Nothing outside the page."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

from ...bench.writers import write_page
from ...plots import pictures
from .result import Identification


def _number(value: float | None, digits: int = 6) -> str:
    return "–" if value is None else f"{value:.{digits}g}"


def write_report(result: Identification, path: Path) -> None:
    """Write the page; the same result gives the same bytes."""
    write_page(path, "studies/identification/report.html.j2", result=result, figures=pictures(result.drawings()),
               number=_number, correlated=_strongest(result), files={n["file"]: n for n in result.noise})


def _strongest(result: Identification) -> list[tuple[str, str, float]]:
    """Return pairs of estimates correlated by more than 0.8, strongest first, ten at most."""
    names, matrix = result.fit.names, result.fit.correlation
    pairs = [(names[i], names[j], float(matrix[i, j])) for j, i in combinations(range(len(names)), 2)
             if abs(matrix[i, j]) > 0.8]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))[:10]
