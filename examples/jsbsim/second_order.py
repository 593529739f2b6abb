"""The package's second-order model as four fins, fitted by the package to an FMU's own parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.bench.fmu import opened
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.studies import fitting
from emcas_fmu.studies.fitting import MODEL, Fit

from .actuators import Demand, Response
from .vehicle import FINS

_NAMES = [v.name for v in get(MODEL).outputs]
_ANGLE, _RATE, _SATURATED = (_NAMES.index(name) for name in ("fin_angle", "fin_rate", "saturated"))
_KEYS = {v.name: v.key for v in get(NONLINEAR).inputs if v.key}


def parameters_of(path: Path) -> ParameterSet:
    """The nonlinear model's parameters that an FMU starts with; of a unit of four those of fin 1."""
    with opened(path) as unit:
        starts = {_KEYS.get(name, name): value for name, value in unit.starts.items()}
    return load_parameters().with_values(
        {v.name: starts[v.name] for v in get(NONLINEAR).file_entries if v.name in starts})


def fit(path: Path) -> Fit:
    """The second-order model that comes nearest to an FMU's fin 1, by :func:`emcas_fmu.studies.fitting.fit`."""
    return fitting.fit(parameters_of(path))


def undelayed(parameters: ParameterSet) -> ParameterSet:
    """The same second-order model without its delay."""
    return parameters.with_values({"drive.transport_delay": 0.0})


class SecondOrder:
    """No hinge moment, no friction, no bus: command, delay, second order, limits of rate and angle."""

    def __init__(self, parameters: ParameterSet) -> None:
        """`parameters` are of the second-order model."""
        self._cores = [codegen.core(parameters.values, MODEL) for _ in FINS]

    def step(self, time: float, step: float, demand: Demand) -> Response:
        """The power is mechanical, against the hinge moments, which do not move the fins."""
        loads = zip(demand.commands.tolist(), demand.hinge_moments.tolist(), strict=True)
        rows = np.array([core.run(time + step, codegen.inputs_at_rest(command, moment, 0.0))
                         for core, (command, moment) in zip(self._cores, loads, strict=True)], dtype=float)
        rates = rows[:, _RATE]
        return Response(rows[:, _ANGLE], rates, -float(rates @ demand.hinge_moments), rows[:, _SATURATED] > 0.5)

    def close(self) -> None:
        """Nothing is held."""
