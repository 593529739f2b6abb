"""The loading test setup (section 3.5): a geared motor with a torque loop loads the fin shaft.

    J_l dw_l/dt = T_m - C_l sgn w_l - b_l w_l - T        T = k (a_l - fin angle) + d (w_l - fin rate)
    T_m = N K_l i,  a current loop of first order,  i_ref = K (T_ref + k_p e + k_i int e)/(N K_l),  e = T_ref - T

with all quantities at the fin. T is the torque that the sensor reads and that loads the fin. A moving fin also moves
the rig's inertia against the rig's friction; the torque loop compensates these within its bandwidth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign
from typing import Any

import numpy as np

from emcas_fmu.bench.excitation import COMMAND, LOAD, Excitation
from emcas_fmu.simulation import Array

from .rigs import Columns, rig_values
from .stepping import SteppedActuator

_SUBSTEPS = 5  # steps in a sample of the torque loop: the coupling oscillates at 35 Hz


@dataclass(frozen=True)
class Loaded:
    """A run on the rig: excitation, the actuator's outputs by name, and the moment [N.m] that the rig applied.

    Rows are the samples of the torque loop.
    """

    excitation: Excitation
    columns: Columns
    applied: Array

    @property
    def requested(self) -> Array:
        """The moment [N.m] that is requested from the rig."""
        return self.excitation.columns[LOAD]


def run(values: Mapping[str, Any], excitation: Excitation) -> Loaded:
    """Return the response to an excitation whose hinge moment the rig applies."""
    rig = rig_values("loading")
    step = excitation.step / _SUBSTEPS
    actuator, load = SteppedActuator(values, step), _Load(rig, float(values["fin.start_angle"]), step)
    angle_index, rate_index = actuator.index("fin_angle"), actuator.index("fin_rate")
    command, requested = excitation.command.tolist(), excitation.columns[LOAD].tolist()
    applied = [0.0]
    for k in range(len(command) - 1):
        load.sample(requested[k])
        for _ in range(_SUBSTEPS):
            outputs = actuator.run(**{COMMAND: command[k], LOAD: load.moment})
            load.advance(outputs[angle_index], outputs[rate_index])
        applied.append(load.moment)
    columns = {name: column[::_SUBSTEPS] for name, column in actuator.columns().items()}
    return Loaded(excitation, columns, np.array(applied))


class _Load:
    """The rig's state at the fin: angle [rad] and rate [rad/s] of its side, motor torque and moment applied [N.m]."""

    def __init__(self, rig: Any, angle: float, step: float) -> None:
        self.moment = 0.0
        self._rig, self._step = rig, step
        self._inertia = rig.inertia * rig.ratio**2
        self._largest = rig.current_gain * rig.reference_limit * rig.torque_constant * rig.ratio
        self._lag = float(np.exp(-step / rig.current_time_constant))
        self._angle, self._rate, self._torque, self._reference, self._integral = angle, 0.0, 0.0, 0.0, 0.0

    def sample(self, requested: float) -> None:
        """Execute a sample of the torque loop, which controls the sensor's reading to `requested` [N.m]."""
        rig, error = self._rig, requested - self.moment
        unlimited = requested + rig.torque_kp * error + self._integral
        self._reference = min(max(unlimited, -self._largest), self._largest)
        if self._reference == unlimited:
            self._integral += rig.torque_ki * rig.sample_time * error

    def advance(self, fin: float, rate: float) -> None:
        """Advance by a step (semi-implicit Euler), at whose end the fin is at `fin` [rad] with `rate` [rad/s]."""
        rig, step = self._rig, self._step
        self._torque = self._reference + self._lag * (self._torque - self._reference)
        driving = self._torque - self.moment - rig.viscous * self._rate
        moved = self._rate + step * (driving - self._dry(driving)) / self._inertia
        # Dry friction stops a motion, and does not reverse it.
        self._rate = 0.0 if moved * self._rate < 0.0 and abs(driving) <= rig.coulomb else moved
        self._angle += step * self._rate
        self.moment = rig.stiffness * (self._angle - fin) + rig.damping * (self._rate - rate)

    def _dry(self, driving: float) -> float:
        if self._rate == 0.0:
            return copysign(min(abs(driving), float(self._rig.coulomb)), driving)
        return copysign(float(self._rig.coulomb), self._rate)
