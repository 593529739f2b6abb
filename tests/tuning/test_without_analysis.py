"""Shipped studies without the packages of the extra `analysis`."""

from __future__ import annotations

import sys

import pytest

from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.report.outcome import Rig
from emcas_fmu.studies.starter import TUNING, starter_files
from emcas_fmu.studies.tuning.study import shipped_cases, shipped_study


@pytest.fixture(autouse=True)
def _absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)  # import fails


def test_cases_and_starter_files_are_available() -> None:
    base = load_parameters()
    cases, file = Rig(ParameterSubject(base)).tolerances
    assert file == "models/tuning.toml"
    assert {case.name for case in cases} < {case.name for case in shipped_cases(base)}
    assert TUNING in starter_files(base)


def test_error_names_the_missing_package() -> None:
    with pytest.raises(EmcasError, match="need the Python package control") as refused:
        shipped_study(load_parameters())
    assert "do not fit" not in str(refused.value)
