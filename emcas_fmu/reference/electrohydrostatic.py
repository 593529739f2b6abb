"""Integration of the electrohydrostatic actuator from event to event: motor, pump, cylinder and fin.

The equations of docs/model/electrohydrostatic.md are written again here. The state is fin angle [rad], fin rate
[rad/s], both pressures [Pa], motor speed [rad/s], motor current [A] and drive integral [V].
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import itemgetter
from typing import NamedTuple

from .actuator import Sample
from .drive import FREE, Driven
from .events import Accuracy, Body, Event, StateVector, band, switch
from .piston import ONE, RATE, TWO, Cylinder, PistonLoop
from .vehicle import Surroundings, clip

SPEED, CURRENT, INTEGRAL = range(4, 7)


class Mode(NamedTuple):
    """Directions of fin and shaft, 0 at rest; mode of the drive; direction of the relief valve's flow, 0 if closed;
    True for an open check valve, and for a chamber with a void."""

    fin: int
    shaft: int
    drive: int
    relief: int
    check_1: bool
    check_2: bool
    void_1: bool
    void_2: bool


class Electrohydrostatic(Cylinder, Driven):
    """Motor, drive, pump, valves, cylinder, lever and fin."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1e5, 1e5, 1.0, 1.0, 1.0), 5e-5)  # the shortest time constant is 0.11 ms
    names = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "motor_speed", "motor_current", "motor_voltage",
             "drive_reference")
    current = CURRENT

    def __init__(self, parameters: Mapping[str, float]):
        super().__init__(parameters)
        p = self.p
        self.bodies += Body("shaft", itemgetter(SPEED), self._shaft_excess, {SPEED: 0.0}),
        self.refill = p["reservoir.pressure"] - p["check_valve.cracking_pressure"]

    def start(self) -> tuple[StateVector, Mode]:
        void = self.p["oil.cavitation_pressure"]
        filled = max(self.p["reservoir.pressure"], void)
        refilled, empty = filled < self.refill, filled <= void
        return ([self.p["fin.start_angle"], 0.0, filled, filled, 0.0, 0.0, 0.0],
                Mode(0, 0, FREE, 0, refilled, refilled, empty, empty))

    def outputs(self, y: StateVector, around: Surroundings) -> tuple[float, ...]:
        return *y[:INTEGRAL], self.voltage(y, around)

    def speed(self, y: StateVector) -> float:
        return y[SPEED]

    def _shaft_torque(self, y: StateVector) -> float:
        """Return the torque [N.m] on the shaft from current and pressures."""
        return self.motor_torque(y[CURRENT]) - self.p["pump.displacement"] * (y[ONE] - y[TWO])

    def _shaft_dry(self, y: StateVector) -> float:
        """Return the dry friction [N.m] of the shaft."""
        return self.p["pump.coulomb_friction"] + self.p["pump.pressure_friction"] * abs(y[ONE] - y[TWO])

    def _shaft_excess(self, y: StateVector, _mode: Mode, _around: Surroundings, side: int) -> float:
        """Return the torque [N.m] on a resting shaft towards `side` beyond stiction."""
        return side * self._shaft_torque(y) - self._shaft_dry(y)

    def acceleration(self, y: StateVector, mode: Mode, _around: Surroundings) -> float:
        """Return the acceleration of the shaft [rad/s2]."""
        net = self._shaft_torque(y) - mode.shaft * self._shaft_dry(y) - self.p["pump.viscous_friction"] * y[SPEED]
        return net / self.p["inertia.motor"] if mode.shaft else 0.0

    def _leakage(self, around: Surroundings) -> float:
        """Return the leakage [m3/(s.Pa)] between the chambers, through pump, cylinder and bypass valve."""
        p = self.p
        opening = (1.0 if p["bypass_valve.opens_disabled"] and not around.enable else p["bypass_valve.opening"])
        return p["pump.leakage"] + p["cylinder.internal_leakage"] + opening * p["bypass_valve.conductance"]

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> list[float]:
        p, across, (displaced, volume_1, volume_2) = self.p, y[ONE] - y[TWO], self.chambers(y)
        pumped = p["pump.displacement"] * y[SPEED] - self._leakage(around) * across - displaced
        if mode.relief:
            pumped -= p["relief_valve.conductance"] * (across - mode.relief * p["relief_valve.pressure"])
        rises = []
        for pressure, flow, check, void, volume in ((y[ONE], pumped, mode.check_1, mode.void_1, volume_1),
                                                    (y[TWO], -pumped, mode.check_2, mode.void_2, volume_2)):
            flow += p["pump.case_leakage"] * (p["reservoir.pressure"] - pressure)
            if check:
                flow += p["check_valve.conductance"] * (self.refill - pressure)
            rises.append(p["oil.cavitated_modulus" if void else "oil.bulk_modulus"] / volume * flow)
        return [y[RATE], self.turning(y, mode.fin, around), *rises, self.acceleration(y, mode, around),
                *self.electrical(self.motor(y, mode, around), mode.drive, around)]

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        over, void = self.p["relief_valve.pressure"], self.p["oil.cavitation_pressure"]

        def below(field: str, chamber: int, level: float) -> Event:
            return switch(mode, field, lambda y: level - y[chamber])

        return [*super().events(mode, around), *band(mode, "relief", lambda y: y[ONE] - y[TWO], -over, over),
                below("check_1", ONE, self.refill), below("check_2", TWO, self.refill),
                below("void_1", ONE, void), below("void_2", TWO, void)]

    def controller(self, nominal: Electrohydrostatic) -> Sample:
        """Return a PI controller of the piston position and a P controller of the motor's speed with compensation."""
        p = nominal.p
        turns = p["cylinder.area"] / p["pump.displacement"]  # rad/m, motor angle per piston travel
        gain, offset = p["drive.current_gain"], p["drive.current_offset"]

        def inner(speed: float, piston: float, y: StateVector) -> tuple[float, float]:
            reference = turns * speed
            share = clip(reference / p["compensation.speed_band"], 1.0)
            torque = p["compensation.gain"] * nominal.friction(piston) * share
            raw = p["controller.velocity.kp"] * (reference - y[SPEED]) + torque / (p["motor.torque_constant"] * gain)
            output = clip(raw, p["drive.reference_limit"])
            excess = raw - (clip(gain * output + offset, p["drive.current_limit"]) - offset) / gain
            return output, excess if abs(excess) > 1e-9 else 0.0

        return PistonLoop(p, p["controller.speed_limit"] / turns, inner).sample

    def friction(self, piston: float) -> float:
        """Return the motor torque [N.m] that overcomes Coulomb friction of fin, piston and pump without load."""
        p = self.p
        arm = p["kinematics.moment_arm"]
        tangent = piston / arm + math.tan(p["kinematics.initial_angle"])
        force = p["cylinder.coulomb_friction"] + self.dry / (arm * (1.0 + tangent * tangent))
        drop = force / p["cylinder.area"]
        return p["pump.coulomb_friction"] + (p["pump.displacement"] + p["pump.pressure_friction"]) * drop


simulate = Electrohydrostatic.simulate
