"""What a baseline is recorded of or compared with: a parameter file run by the kernel, or an FMU run by fmpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..acceptance.article import RECORDED, FmuArticle, Identification, ParameterArticle, row_times
from ..errors import EmcasError
from ..excitation import Excitation
from ..parameters import load_parameters
from ..validation.runs import Run, opened
from ..variables import INPUTS, PARAMETERS


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
            return ParameterArticle(changed, self.article.path).run(inputs, step)
        return self.article.unit.run({**inputs, "time": row_times(inputs, step)}, step, excitation.overrides, RECORDED)


@contextmanager
def opened_subject(path: Path, fin: int | None = None) -> Iterator[Subject]:
    """The parameter file (.toml) or FMU at `path`; `fin` from 1 on chooses one of several.

    Raises EmcasError or ParameterError where it cannot be used.
    """
    suffix = path.suffix.lower()
    if suffix == ".toml":
        if fin is not None:
            raise EmcasError(f"--fin {fin}: {path} is a parameter file, that is one fin; leave --fin out")
        yield Subject(ParameterArticle(load_parameters(path), path))
    elif suffix == ".fmu":
        with opened(path, fin) as unit:
            unit.require_nonlinear("a baseline")
            unit.require([v.name for v in INPUTS], "input")
            unit.require(RECORDED, "output")
            unit.require([v.name for v in PARAMETERS], "parameter")
            yield Subject(FmuArticle(unit), fin or 1)
    else:
        raise EmcasError(f"{path}: is neither an FMU nor a parameter file by its name; give a file that ends in .fmu "
                         "or .toml")
