"""What an electromechanical actuator is put together from: choices, not parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Structure:
    """Which equations hold.

    `constant_ratio`: the ratio between motor and fin is that of small angles, (2.18). `current`: a current loop
    controls the motor current, an ideal one makes it the reference at once, or a PWM amplifier puts a voltage on the
    winding. `drive_line`: the drive line between rotor and fin is elastic. `torsion_bar`: a bar loads the fin.
    `stribeck`: friction at the motor falls with speed. `screw_losses`: the screw has efficiencies; of a `worm` they
    follow from its lead angle and friction.
    """

    constant_ratio: bool = False
    current: Literal["loop", "ideal", "pwm"] = "loop"
    drive_line: bool = False
    torsion_bar: bool = False
    stribeck: bool = False
    screw_losses: bool = False
    worm: bool = False
