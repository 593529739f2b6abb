"""States of an actuator, and what acts on it: in a step of its plant, and in a sample of its controllers."""

from __future__ import annotations

import keyword
from dataclasses import dataclass, field
from typing import Any

from ..errors import EmcasError
from ..namespace import Record


@dataclass(frozen=True)
class State:
    """A state by name, a Python identifier, with its unit.

    A state that samples set has the value `start` in a plant without controllers, until a host sets it.
    """

    name: str
    unit: str = ""
    description: str = ""
    start: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()) or keyword.iskeyword(self.name):
            raise EmcasError(f"state {self.name!r}: a state's name is a Python identifier, such as fin_rate")
        if hasattr(Record, self.name):
            raise EmcasError(f"state {self.name!r}: is the name of a method of x; give it another name")


FIN = (State("fin_angle", "rad"), State("fin_rate", "rad/s"))
"""The states of the fin."""


class PlantInputs(Record):
    """Inputs of the plant during a step, ``u``, by name, in SI; constant during the step.

    - ``reference``: the output of the last sample that has arrived in the drive, after its delay
    - ``aero_torque`` [N.m]
    - of the vehicle's motion, in the fin's axes (:class:`emcas_fmu.physics.loads.MotionLoads`): specific force at the
      hinge ``f_x``, ``f_z`` [m/s2]; of its rates ``wx2_wz2``, ``wx_wz`` [rad2/s2]; angular acceleration about the screw
      and the hinge ``alpha_x``, ``alpha_y`` [rad/s2]
    - ``supply`` [V or Pa], ``enabled``, the actuator's further Real inputs and its sampled states
    - ``rated_current_limit`` [A]: the drive's without a fault, None if that is drive.current_limit
    - the values of discontinuities, by their names

    For `output_values` also ``command`` [rad]; of the last sample ``sampled_reference``, ``measured_fin_angle`` [rad],
    and ``limited``, above 0 if a limit was active.
    """


class SampleInputs(Record):
    """Inputs of a sample, by name, in SI.

    - ``command`` [rad], ``supply`` [V or Pa], ``enable``, the actuator's further inputs
    - ``position`` [rad]: the state of angle that the encoder reads
    - ``encoder_offset`` [counts]: error of the encoder's zero, None if that is the fin's
    - ``ahead``: what is fed forward of a motion (:class:`emcas_fmu.control.trajectory.Ahead`), None without one
    - ``observer``: what estimates the motor's speed from the measurement (:func:`emcas_fmu.control.filters.observed`),
      None without one
    """

    def __init__(self, **values: Any) -> None:
        super().__init__(**{"encoder_offset": None, "ahead": None, "observer": None, **values})
