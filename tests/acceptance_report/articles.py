"""Articles whose every figure is known in closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import Any

import numpy as np
from scipy import signal

from emcas_fmu.acceptance.article import RECORDED, Identification, row_times
from emcas_fmu.parameters import load_parameters
from emcas_fmu.validation.runs import Columns, Run

IDENTIFICATION = Identification("article", "none", "", "closed form", "", "", "", "a test", (), ())


@dataclass(frozen=True)
class Known:
    """An article that answers with `angle`; everything else it puts out is zero."""

    values: Mapping[str, Any] = field(default_factory=lambda: load_parameters().values)
    identification: Identification = IDENTIFICATION

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """Fin angle [rad] at the rows."""
        raise NotImplementedError

    def run(self, inputs: Columns, step: float) -> Run:
        """The run of an article."""
        time = row_times(inputs, step)
        zero = np.zeros(len(time))
        columns = {"time": time, **dict.fromkeys(RECORDED, zero)}
        columns["fin_angle"] = self.angle(inputs.get("fin_command", zero), inputs.get("aero_torque", zero), step)
        return Run(columns, None, (), 0.0)


@dataclass(frozen=True)
class Play(Known):
    """Follows the command of the row before, but for a play of half-width `half` [deg], in whose middle it starts."""

    half: float = 0.05

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """The play operator."""
        # What a row commands acts after that row's output is read.
        wanted, found, at = np.degrees(np.append(0.0, command[:-1])), [], 0.0
        for level in wanted:
            at = min(max(at, level - self.half), level + self.half)
            found.append(at)
        return np.radians(found)


@dataclass(frozen=True)
class SecondOrder(Known):
    """M x'' + B x' + K x = T + K command, moment held over a step and solved exactly."""

    mass: float = 1.3
    damping: float = 104.0
    stiffness: float = 9000.0

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


@dataclass(frozen=True)
class Broken(Known):
    """Goes no further than 10 ms."""

    def run(self, inputs: Columns, step: float) -> Run:
        """A run that ends early."""
        columns = {"time": np.array([0.0, 0.01]), **{name: np.zeros(2) for name in RECORDED}}
        return Run(columns, 0.01, ("error: the bridge is open",), 0.0)


def count(values: Mapping[str, Any]) -> float:
    """Angle at the fin [deg] of a count of an encoder on the motor, the lever upright."""
    turn = 2.0 * np.pi / (values["encoder.pulses"] * values["encoder.multiplier"])
    return float(degrees(turn * values["screw.lead"] / values["kinematics.moment_arm"]))
