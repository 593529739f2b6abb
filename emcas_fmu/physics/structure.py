"""The equations that an electromechanical actuator is composed of: choices, not parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Structure:
    """The choice of equations.

    `constant_ratio`: the ratio between motor and fin is that of small angles, (2.18). `current`: a current loop
    controls the motor current, an ideal loop sets it to its reference at once, or a PWM amplifier applies a voltage to
    the winding. `drive_line`: the drive line between rotor and fin is elastic. `torsion_bar`: a torsion bar loads the
    fin. `stribeck`: friction at the motor falls with speed. `screw_losses`: the screw has efficiencies; those of a
    `worm` follow from its lead angle and friction. `inverter`: the bridge has a dead time, and diodes that conduct
    while it is open.
    """

    constant_ratio: bool = False
    current: Literal["loop", "ideal", "pwm"] = "loop"
    drive_line: bool = False
    torsion_bar: bool = False
    stribeck: bool = False
    screw_losses: bool = False
    worm: bool = False
    inverter: bool = False
