"""Findings of a check of an archive."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Finding:
    """One finding: in which file of the archive, at which connection or parameter, and its remedy."""

    level: Literal["error", "warning"]
    file: str
    place: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"{': '.join(filter(None, (self.file, self.place, self.message)))}; {self.remedy}"


@dataclass
class Report:
    """The findings about an archive, each once, and how many connections and parameters were checked."""

    path: Path
    variants: tuple[str, ...] = ()
    connections: int = 0
    parameters: int = 0
    _findings: dict[Finding, None] = field(default_factory=dict)

    def add(self, findings: Iterable[Finding]) -> None:
        """Add findings."""
        self._findings.update(dict.fromkeys(findings))

    def error(self, file: str, place: str, message: str, remedy: str) -> None:
        """Add something that makes hosts fail or compute something else."""
        self.add([Finding("error", file, place, message, remedy)])

    def warning(self, file: str, place: str, message: str, remedy: str) -> None:
        """Add something that is allowed and may be intended."""
        self.add([Finding("warning", file, place, message, remedy)])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Errors and warnings."""
        return tuple(self._findings)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that make the check fail."""
        return tuple(f for f in self._findings if f.level == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """The findings that do not make the check fail."""
        return tuple(f for f in self._findings if f.level == "warning")

    def document(self) -> dict[str, Any]:
        """Return the report for JSON."""
        return {"file": str(self.path), "passed": not self.errors, "variants": self.variants,
                "connections": self.connections, "parameters": self.parameters,
                "findings": [asdict(f) for f in self._findings]}


def nearest(name: str, names: Iterable[str], otherwise: str) -> str:
    """Return the remedy for a name that does not exist: the one among `names` that is close, or `otherwise`."""
    candidates = list(names)
    # The most common slip is a name without its group or with another one's.
    close = get_close_matches(name, candidates, 1) or [c for c in candidates if c.endswith(f".{name}")][:1]
    return f"did you mean {close[0]}?" if close else otherwise
