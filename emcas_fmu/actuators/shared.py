"""Parameters of the shared equations, for an actuator that declares only some of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf
from typing import Any

from ..namespace import with_values
from ..ops.base import Ops
from . import capabilities

TABLE_POINTS = 5  # number of points of the tables of friction over temperature
WITHOUT_EFFECT: Mapping[str, Any] = {
    "kinematics.initial_angle": 0.0, "inertia.screw": 0.0, "mass.nut": 0.0,
    "friction.coulomb.positive": (0.0,) * 7, "friction.coulomb.negative": (0.0,) * 7, "friction.fin_coulomb": 0.0,
    "friction.table.temperature": tuple(map(float, range(TABLE_POINTS))),
    "friction.table.viscous": (1.0,) * TABLE_POINTS, "friction.table.coulomb": (1.0,) * TABLE_POINTS,
    "friction.temperature": 24.0, "compensation.gain": 0.0, "compensation.speed_band": 1.0,
    "motor.pole_pairs": 0, "drive.current_limit": inf, "drive.current_offset": 0.0, "drive.reference_limit": inf,
    "controller.speed_limit": inf, "controller.antiwindup": 0.0, "controller.drive_antiwindup": 0.0,
    "controller.velocity.ki": 0.0, "controller.load_observer": 0.0, "controller.position.setpoint_weight": 1.0,
    "controller.position.velocity_feedforward": 0.0,
    "encoder.enabled": False, "encoder.on_fin": False, "encoder.pulses": 1, "encoder.multiplier": 1}
"""Parameters of the shared equations that an actuator need not have, with values that have no effect."""


class AsDeclared:
    """The parameters that an actuator declares, completed by values WITHOUT_EFFECT if it has shared equations.

    `loop` says whether a loop controls the motor current. ``missing`` lists the parameters of shared equations that the
    capabilities need, but that are neither declared nor in WITHOUT_EFFECT.
    """

    def __init__(self, declared: Iterable[str] = (), provides: Iterable[str] = (), loop: bool = True) -> None:
        names = {name.partition("[")[0] for name in declared}
        shared = {name for each in provides for name in capabilities.NEEDED_PARAMETERS.get(each, ())
                  if loop or name not in capabilities.OF_LOOP}
        self._absent = {name: value for name, value in WITHOUT_EFFECT.items() if shared and name not in names}
        self.missing = sorted(shared - names - set(self._absent))

    def __call__(self, ops: Ops, p: Any) -> Any:
        """Return the parameters of the equations."""
        return with_values(p, self._absent) if self._absent else p
