"""States of an actuator, and the inputs of a step of its plant and of a sample of its controllers."""

from __future__ import annotations

import keyword
from dataclasses import dataclass, field
from typing import Any

from ..errors import EmcasError
from ..namespace import Record


@dataclass(frozen=True)
class State:
    """A state with its name, a Python identifier in ASCII, and its unit. Raises EmcasError for another name.

    `start` is the value of a sampled state in the plant half, until a host sets it.
    """

    name: str
    unit: str = ""
    description: str = ""
    start: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()) or keyword.iskeyword(self.name):
            raise EmcasError(f"state {self.name!r}: a state's name is a Python identifier in ASCII and not a keyword; "
                             "rename it, for example fin_rate")
        if hasattr(Record, self.name):
            raise EmcasError(f"state {self.name!r}: is the name of a method of x; give it another name")


FIN = (State("fin_angle", "rad"), State("fin_rate", "rad/s"))
"""The states of the fin."""


class PlantInputs(Record):
    """Inputs of the plant, ``u``, by name, in SI; constant during a step.

    - ``reference``: the controllers' reference at the drive, after the transport delay, in its actuator's unit
    - ``aero_torque`` [N.m]
    - the vehicle's motion in the fin's axes (:class:`emcas_fmu.physics.loads.MotionLoads`): gravity minus acceleration
      at the hinge ``f_x``, ``f_z`` [m/s2]; angular rates W as ``wx2_wz2``, W_x^2 - W_z^2, and ``wx_wz``, W_x W_z
      [rad2/s2]; angular acceleration about the screw and the hinge ``alpha_x``, ``alpha_y`` [rad/s2]
    - ``supply`` [V or Pa], ``enabled``, the actuator's additional Real inputs and its sampled states
    - ``rated_current_limit`` [A]: the drive's current limit without a fault; None if it is drive.current_limit
    - the values of the actuator's discontinuities, by their names (:mod:`emcas_fmu.steppers.discontinuities`)

    `output_values` also gets ``command`` [rad] and, of the last sample, ``sampled_reference``, ``measured_fin_angle``
    [rad] and ``limited``, above 0 if a limit was active.
    """


class SampleInputs(Record):
    """Inputs of a sample, by name, in SI.

    - ``command`` [rad], ``supply`` [V or Pa], ``enable``, the actuator's additional inputs
    - ``position`` [rad]: the state that the encoder of position reads
    - ``encoder_offset`` [counts]: error of the encoder's zero; None without such an error
    - ``ahead``: feed-forward of a motion (:class:`emcas_fmu.control.trajectory.Ahead`), otherwise None
    - ``observer``: function that estimates the motor's speed from the measurement
      (:func:`emcas_fmu.control.filters.observed`); None without an observer
    """

    def __init__(self, **values: Any) -> None:
        super().__init__(**{"encoder_offset": None, "ahead": None, "observer": None, **values})
