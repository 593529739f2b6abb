"""The parameter set of all entries, and the runs that several entries share, each simulated once."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, lru_cache
from math import degrees, radians
from pathlib import Path

import numpy as np

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.bench.excitation import COMMAND, LOAD, Excitation, reference_case, times
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.motions import LEAD_IN, LOAD_RISE, RATED, STEP
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.reference.files import supply_start

from . import friction_rig, loading_rig

WARM, COLD = 24.0, -6.0  # degC, at which the thesis measured friction


class Runs:
    """Runs of the nonlinear and other actuators; the values of `files` override the shipped parameters."""

    def __init__(self, files: Iterable[Path] = ()) -> None:
        self.files = tuple(files)
        self.parameters = load_parameters(self.files)
        self.values = self.parameters.values
        self.subject = self.of(NONLINEAR)
        self.friction = lru_cache(maxsize=None)(self._friction)

    def of(self, model: str) -> ParameterSubject:
        """Return an actuator, with its extensions, as a subject with the parameters of the files."""
        parameters = self.parameters if model == NONLINEAR else self.parameters_of(model)
        return ParameterSubject(parameters, self.files)

    def parameters_of(self, model: str) -> ParameterSet:
        """Return the parameters of an actuator with its extensions."""
        return load_parameters(self.files, model=model)

    @property
    def reach(self) -> float:
        """The largest command of the entries [rad]: Table 2's 20 deg, or the set's limit if that is less."""
        return min(radians(20.0), float(self.values["command.limit"]))

    def levels(self, *sizes: float) -> list[float]:
        """Return the sizes [deg] of a step that do not exceed `reach`; `reach` alone if all are larger."""
        reach = round(degrees(self.reach), 9)
        return [size for size in sizes if size <= reach] or [reach]

    def conditions(self, command: str, load: str = "none", temperature: float | None = None) -> str:
        """Return temperature [degC] (None: the set's), command and load in a line."""
        ambient = self.values["friction.temperature"] if temperature is None else temperature
        return f"{ambient:g} °C · command: {command} · load: {load}"

    def run(self, excitation: Excitation, **changes: float) -> Run:
        """Return a finished run with changed parameters, by names with ``__`` for the dot. Raises StoppedError."""
        run = self.subject.run(excitation, {name.replace("__", "."): value for name, value in changes.items()})
        run.finished()
        return run

    def case(self, name: str) -> Run:
        """Return the run of a reference case with the encoder as in the parameter set."""
        return self.run(reference_case(name, exact=False, supply=supply_start(NONLINEAR, self.values)))

    def _friction(self, rpm: float, temperature: float) -> friction_rig.Sweep:
        return friction_rig.sweep(self.values, rpm, temperature)

    @cached_property
    def loaded(self) -> loading_rig.Loaded:
        """The loaded test on the loading test setup."""
        return loading_rig.run(self.values, loaded_test(self.reach))

    @cached_property
    def ideal(self) -> Run:
        """The loaded test with exactly the requested moment."""
        return self.run(loaded_test(self.reach))


def loaded_test(reach: float) -> Excitation:
    """Return the loaded test: to -`reach` [rad], to +`reach` against RATED [N.m], back to -`reach` with RATED."""
    time = times(3.0)
    command = np.select([time < LEAD_IN - STEP / 2, time < SLEWS[0] - STEP / 2, time < SLEWS[1] - STEP / 2],
                        [0.0, -reach, reach], -reach)
    rising = np.clip((time - SLEWS[0]) / LOAD_RISE, 0.0, 1.0)
    return Excitation("loaded test", {COMMAND: command, LOAD: -RATED * rising}, SLEWS[0])


SLEWS: tuple[float, float] = (1.0, 2.0)
"""Instants [s] of the loaded test at which the command slews from end to end: against the load, and with it."""
