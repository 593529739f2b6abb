"""The choice of equations of an electromechanical actuator, by its declaration and extensions, not by parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Structure:
    """The equations that an actuator has; the defaults are those of the thesis."""

    constant_ratio: bool = False  # the ratio between motor and fin is that of small angles, (2.18)
    current: Literal["loop", "ideal", "pwm"] = "loop"  # ideal: no lag behind the reference; pwm: no current loop
    drive_line: bool = False  # the drive line between rotor and fin is elastic
    torsion_bar: bool = False  # a torsion bar loads the fin
    stribeck: bool = False  # friction at the motor falls with speed
    screw_losses: bool = False  # the screw has efficiencies: its friction rises with the load
    worm: bool = False  # the efficiencies follow from lead angle and friction of a worm
    inverter: bool = False  # the bridge has a dead time, and diodes that conduct while it is open
