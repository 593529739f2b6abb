"""Actuators of the fins from the package's second-order model, fitted to an FMU's start values."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.bench.fmu import opened
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.studies import fitting
from emcas_fmu.studies.fitting import MODEL, SecondOrderFit

from .actuators import Demand, Response
from .vehicle import FINS

_NAMES = [v.name for v in get(MODEL).outputs]
_ANGLE, _RATE, _SATURATED = (_NAMES.index(name) for name in ("fin_angle", "fin_rate", "saturated"))
_KEYS = {v.name: v.key for v in get(NONLINEAR).inputs if v.key}


def parameters_of(path: Path) -> ParameterSet:
    """Return an FMU's start values as parameters of the nonlinear model; those of fin 1 for an FMU of four."""
    with opened(path) as unit:
        starts = {_KEYS.get(name, name): value for name, value in unit.starts.items()}
    return load_parameters().with_values(
        {v.name: starts[v.name] for v in get(NONLINEAR).file_entries if v.name in starts})


def fit(path: Path) -> SecondOrderFit:
    """Return the second-order model that :func:`emcas_fmu.studies.fitting.fit` fits to fin 1 of an FMU."""
    return fitting.fit(parameters_of(path))


def undelayed(parameters: ParameterSet) -> ParameterSet:
    """Return the parameters of a second-order model without its delay."""
    return parameters.with_values({"drive.transport_delay": 0.0})


class SecondOrder:
    """Four second-order fins with delay and limits of rate and angle, without hinge moment, friction or bus."""

    def __init__(self, parameters: ParameterSet) -> None:
        self._cores = [codegen.core(parameters.values, MODEL) for _ in FINS]

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """Return the response; its power is that against the hinge moments, which do not act on the fins."""
        loads = zip(demand.commands.tolist(), demand.hinge_moments.tolist(), strict=True)
        rows = np.array([core.run(time + step, codegen.inputs_at_rest(command, moment, 0.0))
                         for core, (command, moment) in zip(self._cores, loads, strict=True)], dtype=float)
        rates = rows[:, _RATE]
        return Response(rows[:, _ANGLE], rates, -float(rates @ demand.hinge_moments), rows[:, _SATURATED] > 0.5)

    def close(self) -> None:
        """Do nothing."""
