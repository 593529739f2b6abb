"""Subjects whose every figure is known in closed form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from scipy import signal

from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import Identification, Subject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.variables import Variable

IDENTIFICATION = Identification("subject", "none", "", "closed form", "", "", "", "a test", (), ())
FIN_PORT = ("fin_angle", "fin_rate", "saturated", "at_stop")


class Known(Subject):
    """A subject that answers with `angle`; everything else it puts out is zero, and it has only `there` of it."""

    def __init__(self, values: Mapping[str, Any] | None = None, there: Iterable[str] | None = None) -> None:
        self._values = load_parameters().values if values is None else values
        if there is not None:
            self.outputs: Mapping[str, Variable] = {name: self.outputs[name] for name in there}

    @property
    def values(self) -> Mapping[str, Any]:
        """The parameters."""
        return self._values

    @property
    def identification(self) -> Identification:
        """A name."""
        return IDENTIFICATION

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """Fin angle [rad] at the rows."""
        raise NotImplementedError

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        """The run of a subject."""
        zero = np.zeros(len(excitation.time))
        columns = {"time": excitation.time, **dict.fromkeys(self.outputs if outputs is None else outputs, zero)}
        moment = excitation.columns.get("aero_torque", zero)
        columns["fin_angle"] = self.angle(excitation.command, moment, excitation.step)
        return Run(excitation, columns, None, (), 0.0)


class Play(Known):
    """Follows the command of the row before, but for a play of half-width `half` [deg], in whose middle it starts."""

    def __init__(self, half: float = 0.05, values: Mapping[str, Any] | None = None,
                 there: Iterable[str] | None = None) -> None:
        super().__init__(values, there)
        self.half = half

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """The play operator."""
        # What a row commands acts after that row's output is read.
        wanted, found, at = np.degrees(np.append(0.0, command[:-1])), [], 0.0
        for level in wanted:
            at = min(max(at, level - self.half), level + self.half)
            found.append(at)
        return np.radians(found)


class SecondOrder(Known):
    """M x'' + B x' + K x = T + K command, moment held over a step and solved exactly."""

    mass, damping, stiffness = 1.3, 104.0, 9000.0

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """Matrix exponential over every step."""
        a = np.array([[0.0, 1.0], [-self.stiffness / self.mass, -self.damping / self.mass]])
        system = (a, np.array([[0.0], [1.0 / self.mass]]), np.array([[1.0, 0.0]]), np.array([[0.0]]))
        _, found, _ = signal.dlsim(signal.cont2discrete(system, step), moment + self.stiffness * command)
        return found[:, 0]

    def dynamic_stiffness(self, frequency: Any) -> Any:
        """K - M w^2 + i w B."""
        w = 2.0 * np.pi * frequency
        return self.stiffness - self.mass * w**2 + 1j * w * self.damping


class Broken(Known):
    """Goes no further than 10 ms."""

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        """A run that ends early."""
        names = self.outputs if outputs is None else outputs
        columns = {"time": np.array([0.0, 0.01]), **{name: np.zeros(2) for name in names}}
        return Run(excitation, columns, 0.01, ("error: the bridge is open",), 0.0)


def count(values: Mapping[str, Any]) -> float:
    """Angle at the fin [deg] of a count of an encoder on the motor, the lever upright."""
    turn = 2.0 * np.pi / (values["encoder.pulses"] * values["encoder.multiplier"])
    return float(degrees(turn * values["screw.lead"] / values["kinematics.moment_arm"]))
