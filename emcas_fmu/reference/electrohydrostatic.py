"""The electrohydrostatic actuator in time: motor, pump, cylinder and fin integrated from event to event.

The equations are those of docs/model/electrohydrostatic.md, written again. The state is fin angle [rad], fin rate
[rad/s], both pressures [Pa], motor speed [rad/s], motor current [A], integral of the drive [V].
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from .drive import FREE, Drive, Motor
from .events import Accuracy, Event, State, Value, Vector, friction_events
from .piston import PistonLoop, lever
from .simulate import Array, check_supply, run, voltage_starts
from .vehicle import Surroundings, as_built, clip, hinge_moment, masses_of, surroundings

OUTPUTS = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "motor_speed", "motor_current", "motor_voltage",
           "drive_reference")
FIN, RATE, ONE, TWO, SPEED, CURRENT, INTEGRAL = range(7)


class Mode(NamedTuple):
    """Directions of fin and shaft (0: at rest); the drive's mode; the relief valve's direction; which check valves are
    open, and in which chambers there is a void."""

    fin: int
    shaft: int
    drive: int
    relief: int
    check_1: bool
    check_2: bool
    void_1: bool
    void_2: bool


class Plant:
    """Motor, drive, pump, valves, cylinder, lever and fin as built."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1e5, 1e5, 1.0, 1.0, 1.0), 5e-5)  # s; the fastest mode has 0.11 ms

    def __init__(self, nominal: Mapping[str, float]):
        p = self.p = as_built(nominal)
        self.drive = Drive(p)
        self.refill = p["reservoir.pressure"] - p["check_valve.cracking_pressure"]
        self.inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        self.masses, self.stop = masses_of(p), p["fin.stop_angle"]

    def start(self) -> tuple[State, Mode]:
        """Return the state at rest at the start angle, and its mode."""
        void = self.p["oil.cavitation_pressure"]
        filled = max(self.p["reservoir.pressure"], void)
        refilled, empty = filled < self.refill, filled <= void
        return ([self.p["fin.start_angle"], 0.0, filled, filled, 0.0, 0.0, 0.0],
                Mode(0, 0, FREE, 0, refilled, refilled, empty, empty))

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return what acts under an input row and a delayed reference of the drive [V]."""
        p = self.p
        current = clip(p["drive.current_gain"] * reference + p["drive.current_offset"], p["drive.current_limit"])
        return surroundings(p, row, current, "supply_voltage")

    def outputs(self, y: Vector, _mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return the outputs up to the motor's voltage."""
        return *y[:INTEGRAL], self.drive.voltage(_motor(y), around)

    # Equations ----------------------------------------------------------------------------------------------

    def fin_moment(self, y: Vector, around: Surroundings) -> float:
        """Return the moment [N.m] of pressures and loads."""
        force = self.p["cylinder.area"] * (y[ONE] - y[TWO]) + self.p["cylinder.moving_mass"] * around.force[0]
        return lever(self.p, y[FIN])[1] * force + hinge_moment(self.masses, self.inertia, y[FIN], around)

    def fin_dry(self, y: Vector) -> float:
        """Return the dry friction [N.m] at the fin."""
        return self.p["friction.fin_coulomb"] + lever(self.p, y[FIN])[1] * self.p["cylinder.coulomb_friction"]

    def shaft_torque(self, y: Vector) -> float:
        """Return the torque [N.m] of current and pressures on the shaft."""
        return self.drive.torque_constant * y[CURRENT] - self.p["pump.displacement"] * (y[ONE] - y[TWO])

    def shaft_dry(self, y: Vector) -> float:
        """Return the dry friction [N.m] of the shaft."""
        return self.p["pump.coulomb_friction"] + self.p["pump.pressure_friction"] * abs(y[ONE] - y[TWO])

    def leakage(self, around: Surroundings) -> float:
        """Return the leakage [m3/(s.Pa)] between the chambers: of pump, cylinder and bypass valve."""
        p = self.p
        opening = (1.0 if p["bypass_valve.opens_disabled"] and not around.enable else p["bypass_valve.opening"])
        return p["pump.leakage"] + p["cylinder.internal_leakage"] + opening * p["bypass_valve.conductance"]

    def slope(self, y: Vector, mode: Mode, around: Surroundings) -> list[float]:
        """Return d/dt of the state in a mode."""
        p, (angle, rate, one, two, speed, _, _) = self.p, y
        position, ratio, bend = lever(p, angle)
        area, mass = p["cylinder.area"], p["cylinder.moving_mass"]
        turning = 0.0
        if mode.fin:
            viscous = p["cylinder.viscous_friction"] * ratio**2 + p["friction.fin_viscous"]
            net = (self.fin_moment(y, around) - mode.fin * self.fin_dry(y) - viscous * rate
                   - mass * ratio * bend * rate**2)
            turning = net / (self.inertia + mass * ratio**2)
        over = (one - two) - mode.relief * p["relief_valve.pressure"] if mode.relief else 0.0
        across = (p["pump.displacement"] * speed - self.leakage(around) * (one - two)
                  - p["relief_valve.conductance"] * over - area * ratio * rate)
        rises = []
        for pressure, flow, check, void, volume in (
                (one, across, mode.check_1, mode.void_1, p["cylinder.dead_volume"] + area * position),
                (two, -across, mode.check_2, mode.void_2, p["cylinder.dead_volume"] - area * position)):
            flow += p["pump.case_leakage"] * (p["reservoir.pressure"] - pressure)
            flow += p["check_valve.conductance"] * (self.refill - pressure) if check else 0.0
            rises.append(p["oil.cavitated_modulus" if void else "oil.bulk_modulus"] / volume * flow)
        spinning = self._shaft_acceleration(y, mode.shaft)
        return [rate, turning, *rises, spinning, *self.drive.slopes(_motor(y), mode.drive, around, lambda: spinning)]

    def _shaft_acceleration(self, y: Vector, direction: int) -> float:
        """Return the acceleration [rad/s2] of a shaft that turns in a direction, 0 at rest."""
        net = self.shaft_torque(y) - direction * self.shaft_dry(y) - self.p["pump.viscous_friction"] * y[SPEED]
        return net / self.p["inertia.motor"] if direction else 0.0

    # Modes --------------------------------------------------------------------------------------------------

    def _fin_excess(self, y: Vector, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond what friction, or a stop, holds."""
        return -1.0 if side * y[FIN] >= self.stop else side * self.fin_moment(y, around) - self.fin_dry(y)

    def _shaft_excess(self, y: Vector, side: int) -> float:
        """Return the torque [N.m] on a resting shaft towards `side` beyond what friction holds."""
        return side * self.shaft_torque(y) - self.shaft_dry(y)

    def _released(self, y: Vector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode in which fin and shaft at rest start where nothing holds them."""
        fin = next((side for side in (1, -1) if self._fin_excess(y, around, side) > 0.0), 0)
        shaft = next((side for side in (1, -1) if self._shaft_excess(y, side) > 0.0), 0)
        return mode._replace(fin=mode.fin or fin, shaft=mode.shaft or shaft)

    def admit(self, y: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; an opened bridge loses its current."""
        if not around.enable:
            y[CURRENT] = y[INTEGRAL] = 0.0
        mode = self._released(y, mode, around)
        return mode._replace(drive=self.drive.admit(_motor(y), around, lambda: self._shaft_acceleration(y, mode.shaft)))

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end a mode."""
        drive = self.drive.events(mode.drive, around, _motor, lambda y: self._shaft_acceleration(y, mode.shaft),
                                  lambda _, changed: mode._replace(drive=changed))
        return [*self._motion_events(mode, around), *self._valve_events(mode), *drive]

    def _motion_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        def halt(y: State) -> Mode:
            y[RATE] = 0.0
            return mode._replace(fin=self._released(y, mode._replace(fin=0), around).fin)

        def strike(y: State) -> Mode:
            y[FIN] = mode.fin * self.stop
            return halt(y)

        def halt_shaft(y: State) -> Mode:
            y[SPEED] = 0.0
            return mode._replace(shaft=self._released(y, mode._replace(shaft=0), around).shaft)

        events = friction_events(mode.fin, lambda y: y[RATE], lambda y, side: self._fin_excess(y, around, side), halt,
                                 lambda side: lambda _: mode._replace(fin=side))
        if mode.fin:
            events.append(Event(lambda y: self.stop - mode.fin * y[FIN], strike))
        return events + friction_events(mode.shaft, lambda y: y[SPEED], self._shaft_excess, halt_shaft,
                                        lambda side: lambda _: mode._replace(shaft=side))

    def _valve_events(self, mode: Mode) -> list[Event]:
        over, void = self.p["relief_valve.pressure"], self.p["oil.cavitation_pressure"]

        def passed(name: str, chamber: int, level: float) -> Event:
            below = getattr(mode, name)
            return Event(lambda y: (level - y[chamber]) * (1.0 if below else -1.0),
                         lambda _: mode._replace(**{name: not below}))

        if mode.relief:
            events = [Event(lambda y: mode.relief * (y[ONE] - y[TWO]) - over, lambda _: mode._replace(relief=0))]
        else:
            events = [Event(lambda y: over - (y[ONE] - y[TWO]), lambda _: mode._replace(relief=1)),
                      Event(lambda y: over + (y[ONE] - y[TWO]), lambda _: mode._replace(relief=-1))]
        return [*events, passed("check_1", ONE, self.refill), passed("check_2", TWO, self.refill),
                passed("void_1", ONE, void), passed("void_2", TWO, void)]


def _motor(y: Vector) -> Motor:
    return Motor(y[SPEED], y[CURRENT], y[INTEGRAL])


class Loop(PistonLoop):
    """PI on the piston position from the fin's transducer, P on the motor's speed, Coulomb friction fed forward."""

    def friction(self, piston: float) -> float:
        """Return the motor torque [N.m] against Coulomb friction of fin, piston and pump without load."""
        p = self.p
        arm = p["kinematics.moment_arm"]
        tangent = piston / arm + math.tan(p["kinematics.initial_angle"])
        force = p["cylinder.coulomb_friction"] + p["friction.fin_coulomb"] / (arm * (1.0 + tangent * tangent))
        drop = force / p["cylinder.area"]
        return p["pump.coulomb_friction"] + (p["pump.displacement"] + p["pump.pressure_friction"]) * drop

    def sample(self, angle: float, speed: float, command: float, enable: bool) -> float:
        """Return the drive's reference [V] of one sample."""
        p, read = self.p, self.read(angle)
        if not enable:
            self.reset(read)
            return 0.0
        target = self.piston(clip(command, p["command.limit"]))
        turns = p["cylinder.area"] / p["pump.displacement"]  # of the motor, for the piston's travel
        fastest = p["controller.speed_limit"] / turns
        speed_reference = (p["controller.position.kp"] * (p["controller.position.setpoint_weight"] * target - read)
                 + self.integral)
        gain, offset = p["drive.current_gain"], p["drive.current_offset"]
        motor_reference = turns * clip(speed_reference, fastest)
        compensated = clip(motor_reference / p["compensation.speed_band"], 1.0)
        torque = p["compensation.gain"] * self.friction(read) * compensated
        raw = p["controller.velocity.kp"] * (motor_reference - speed) + torque / (p["motor.torque_constant"] * gain)
        sent = clip(raw, p["drive.reference_limit"])
        possible = (clip(gain * sent + offset, p["drive.current_limit"]) - offset) / gain
        change = p["controller.sample_time"] * p["controller.position.ki"] * (target - read)
        beyond_speed = abs(speed_reference) > fastest and speed_reference * change > 0.0
        beyond_drive = abs(raw - possible) > 1e-9 and (raw - possible) * change > 0.0
        if beyond_speed or beyond_drive:
            self.hold(read)
        else:
            self.integral += change
        self.before = read
        return sent


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from rest and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    check_supply(inputs)
    p = {name: float(value) for name, value in parameters.items()}
    loop = Loop(p, p["fin.start_angle"])
    return run(Plant(p), lambda y, command, enable: loop.sample(y[FIN], y[SPEED], command, enable), p, inputs,
               voltage_starts(p), OUTPUTS)
