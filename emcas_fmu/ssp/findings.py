"""What a check finds, as objects, table and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

Level = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """One thing found: in which file of the archive, at which connection or parameter, and what to do."""

    level: Level
    file: str
    place: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"{': '.join(filter(None, (self.file, self.place, self.message)))}; {self.remedy}"


@dataclass(frozen=True)
class Report:
    """All findings about an archive, in the order of its files, and how much was looked at."""

    path: Path
    variants: tuple[str, ...]
    connections: int
    parameters: int
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Those that make the check fail."""
        return tuple(f for f in self.findings if f.level == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Those that do not."""
        return tuple(f for f in self.findings if f.level == "warning")


class Log:
    """Findings as they come, each kept once."""

    def __init__(self) -> None:
        self.findings: dict[Finding, None] = {}
        self.connections = self.parameters = 0

    def error(self, file: str, place: str, message: str, remedy: str) -> None:
        """Something that makes hosts fail or compute something else."""
        self.findings[Finding("error", file, place, message, remedy)] = None

    def warning(self, file: str, place: str, message: str, remedy: str) -> None:
        """Something that is allowed and may be meant."""
        self.findings[Finding("warning", file, place, message, remedy)] = None


def nearest(name: str, known: Iterable[str], otherwise: str) -> str:
    """What to say of a name that does not exist."""
    candidates = list(known)
    # The most common slip is a name without its group or with another one's.
    close = get_close_matches(name, candidates, 1) or [c for c in candidates if c.endswith(f".{name}")][:1]
    return f"did you mean {close[0]}?" if close else otherwise


def write_json(report: Report, target: Path) -> None:
    """The report as JSON: file, passed, counts and the list of findings."""
    target.write_text(json.dumps({
        "file": str(report.path), "passed": not report.errors, "variants": list(report.variants),
        "connections": report.connections, "parameters": report.parameters,
        "findings": [asdict(f) for f in report.findings]}, indent=1) + "\n", encoding="utf-8")
