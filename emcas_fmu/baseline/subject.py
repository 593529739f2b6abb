"""What a baseline is recorded of or compared with: a parameter file run by the kernel, or an FMU run by fmpy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..actuators import NONLINEAR
from ..bench.subject import Subject, open_subject
from ..errors import EmcasError


@contextmanager
def opened_subject(path: Path, fin: int | None = None, parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """The parameter file (.toml), with those of `parameters` over it, or the FMU at `path`.

    `fin` from 1 on chooses one of an FMU of several.
    Raises EmcasError or ParameterError where it cannot be used.
    """
    with open_subject(path, None, fin, parameters) as subject:
        if subject.model != NONLINEAR:
            raise EmcasError(f"{path}: is {subject.identification.name}, one of the other models; a baseline is for "
                             "the nonlinear actuator, whose FMU `emcas build` makes without --model")
        yield subject
