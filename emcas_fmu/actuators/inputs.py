"""What acts on an actuator: in a step of its plant, and in a sample of its controllers."""

from __future__ import annotations

from typing import Any

from ..namespace import Record


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
