"""What a baseline is recorded of or compared with: a parameter file run by the kernel, or an FMU run by fmpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..acceptance.article import (
    RECORDED,
    FmuArticle,
    Identification,
    ParameterArticle,
    opened_article,
    row_times,
)
from ..errors import EmcasError
from ..excitation import Excitation
from ..validation.runs import Run


@dataclass(frozen=True)
class Subject:
    """An article and which `fin` of it, None for a parameter file."""

    article: ParameterArticle | FmuArticle
    fin: int | None = None

    @property
    def identification(self) -> Identification:
        """File, GUID and hashes."""
        return self.article.identification

    @property
    def values(self) -> Mapping[str, Any]:
        """Parameters by name, in the variable table's units."""
        return self.article.values

    def run(self, excitation: Excitation) -> Run:
        """Outputs RECORDED at the rows of the excitation, SI. Raises ParameterError or EmcasError."""
        inputs, step = excitation.columns, excitation.step
        if isinstance(self.article, ParameterArticle):
            changed = self.article.parameters.replace(excitation.overrides)
            return ParameterArticle(changed, self.article.files).run(inputs, step)
        return self.article.unit.run({**inputs, "time": row_times(inputs, step)}, step, excitation.overrides, RECORDED)


@contextmanager
def opened_subject(path: Path, fin: int | None = None, parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """The parameter file (.toml), with those of `parameters` over it, or the FMU at `path`.

    `fin` from 1 on chooses one of an FMU of several.
    Raises EmcasError or ParameterError where it cannot be used.
    """
    if fin is not None and path.suffix.lower() == ".toml":
        raise EmcasError(f"--fin {fin}: {path} is a parameter file, that is one fin; leave --fin out")
    with opened_article(path, fin, "a baseline", parameters) as article:
        yield Subject(article, None if isinstance(article, ParameterArticle) else fin or 1)
