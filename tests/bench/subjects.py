"""Subjects whose figures are known in closed form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from scipy import signal

from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import Identity, Subject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.variables import Variable

IDENTIFICATION = Identity("subject", "none", "", "closed form", "", "", "", "a test", (), ())
FIN_PORT = ("fin_angle", "fin_rate", "saturated", "at_stop")


class Known(Subject):
    """A subject whose fin angle is a function of the command and the hinge torque; its other outputs are zero.

    `outputs` are the names of the outputs that it has, by default those of the default actuator.
    """

    def __init__(self, values: Mapping[str, Any] | None = None, outputs: Iterable[str] | None = None) -> None:
        self._values = load_parameters().values if values is None else values
        if outputs is not None:
            self.outputs: Mapping[str, Variable] = {name: self.outputs[name] for name in outputs}

    @property
    def values(self) -> Mapping[str, Any]:
        return self._values

    @property
    def identification(self) -> Identity:
        return IDENTIFICATION

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        """Return the fin angle [rad] in every row, from command [rad], hinge torque [N.m] and the rows' step [s]."""
        raise NotImplementedError

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        zero = np.zeros(len(excitation.time))
        columns = {"time": excitation.time, **dict.fromkeys(self.outputs if outputs is None else outputs, zero)}
        torque = excitation.columns.get("aero_torque", zero)
        columns["fin_angle"] = self.angle(excitation.command, torque, excitation.step)
        return Run(excitation, columns, None, (), 0.0)


class Play(Known):
    """Follows the previous row's command with a play of `half_width` [deg] to each side; it starts in the middle."""

    def __init__(self, half_width: float = 0.05, values: Mapping[str, Any] | None = None,
                 outputs: Iterable[str] | None = None) -> None:
        super().__init__(values, outputs)
        self.half_width = half_width

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        # The output of a row is read before the row's command acts.
        degrees_out, angle = [], 0.0
        for level in np.degrees(np.append(0.0, command[:-1])):
            angle = min(max(angle, level - self.half_width), level + self.half_width)
            degrees_out.append(angle)
        return np.radians(degrees_out)


class SecondOrder(Known):
    """M x'' + B x' + K x = torque + K command, solved exactly with inputs that are constant during each step."""

    mass, damping, stiffness = 1.3, 104.0, 9000.0

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        a = np.array([[0.0, 1.0], [-self.stiffness / self.mass, -self.damping / self.mass]])
        system = (a, np.array([[0.0], [1.0 / self.mass]]), np.array([[1.0, 0.0]]), np.array([[0.0]]))
        _, response, _ = signal.dlsim(signal.cont2discrete(system, step), torque + self.stiffness * command)
        return response[:, 0]

    def dynamic_stiffness(self, frequency: Any) -> Any:
        """Return K - M w^2 + i w B [N.m/rad]."""
        w = 2.0 * np.pi * frequency
        return self.stiffness - self.mass * w**2 + 1j * w * self.damping


class Broken(Known):
    """A subject whose runs end after 10 ms with an error."""

    def run(self, excitation: Excitation, start_values: Mapping[str, Any] | None = None,
            outputs: Iterable[str] | None = None, substeps: int = 1, fine: Sequence[str] = ()) -> Run:
        names = self.outputs if outputs is None else outputs
        columns = {"time": np.array([0.0, 0.01]), **{name: np.zeros(2) for name in names}}
        return Run(excitation, columns, 0.01, ("error: the bridge is open",), 0.0)


def count(values: Mapping[str, Any]) -> float:
    """Return the fin angle [deg] of one count of the motor's encoder, with the lever at a right angle to the screw."""
    turn = 2.0 * np.pi / (values["encoder.pulses"] * values["encoder.multiplier"])
    return float(degrees(turn * values["screw.lead"] / values["kinematics.moment_arm"]))
