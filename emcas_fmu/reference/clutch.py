"""The dual clutch actuator in time: fin and motor integrated from event to event.

Coordinates are the fin's angle and rate and the motor's speed. A `Mode` holds for each dry friction the direction of
sliding, or that it sticks, and the modes of both coils' amplifiers and of the motor's diode. The motor has to keep
turning: a run in which it comes to rest is refused. Controllers, bus, lever, loads and friction are those of the
thesis's actuator (:mod:`.plant`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from .coil import Coil, warming
from .controllers import Controllers
from .events import Accuracy, Event, State, Successor, Value, Vector, friction_events
from .plant import FinPlant
from .simulate import Array, run, voltage_starts
from .vehicle import Surroundings, as_built

FIN, RATE, MOTOR, COIL_1, COIL_2, FLUX_1, FLUX_2, TEMPERATURE = range(8)
OUTPUTS = ("fin_angle", "fin_rate", "motor_speed", "coil_current_1", "coil_current_2", "clutch_temperature",
           "drive_reference")
TURNS = (1.0, -1.0)  # direction of the motor in which each clutch turns the screw


class Mode(NamedTuple):
    """Directions of sliding of the screw and of both clutches, 0 of what sticks; the modes of both coils' amplifiers;
    whether the motor draws current."""

    screw: int
    slip: tuple[int, int]
    coils: tuple[int, int]
    feeds: bool


def sign(value: float) -> int:
    """Return -1, 0 or 1."""
    return (value > 0.0) - (value < 0.0)


def _with(pair: tuple[int, int], k: int, value: int) -> tuple[int, int]:
    """Return the pair with its element k replaced."""
    return (value, pair[1]) if k == 0 else (pair[0], value)


class Clutches:
    """The plant of one dual clutch actuator as built, and the `nominal` fin side that its controllers compute with."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 10.0, 0.1, 0.1, 0.1, 0.1, 10.0), 5e-4)

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.p = {name: float(value) for name, value in parameters.items()}
        self.coils = [Coil(p, "drive.kp", f"clutch.share_{k}") for k in (1, 2)]
        per_ampere = p["clutch.rated_torque"] * (1.0 - p["clutch.residual"]) / p["clutch.rated_current"]
        # Lever, screw, fin and loads of the thesis's actuator: the driven halves turn where its rotor does.
        nominal = {**p, "inertia.motor": p["clutch.driven_inertia"], "motor.torque_constant": per_ampere}
        self.nominal, self.screw = FinPlant(nominal), FinPlant(as_built(nominal))
        built = as_built(p)
        self.torque_constant, self.emf = built["motor.torque_constant"], built["motor.back_emf_constant"]
        self.rotor = p["inertia.motor"] + p["clutch.driving_inertia"]

    def start(self) -> tuple[State, Mode]:
        """Return the state and the mode at the start."""
        p, bias = self.p, self.p["clutch.bias_current"]
        return ([p["fin.start_angle"], 0.0, p["motor.start_speed"], bias, bias, bias, bias, p["friction.temperature"]],
                Mode(0, (1, -1), (0, 0), True))

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return what acts under an input row and a delayed DAC value [V]."""
        return self.nominal.surroundings(row, reference)

    def outputs(self, y: Vector, _mode: Mode, _around: Surroundings) -> tuple[float, ...]:
        """Return the outputs up to the clutch's temperature."""
        return *y[:FLUX_1], y[TEMPERATURE]

    # Parts --------------------------------------------------------------------------------------------------

    def ratios(self, delta: float) -> tuple[float, float]:
        """Return R and R' at a fin angle [rad]."""
        tangent = math.tan(delta + self.screw.assembly)
        ratio = self.screw.ratio(delta)
        return ratio, 2.0 * ratio * tangent

    def slips(self, y: Vector) -> tuple[float, float]:
        """Return the sliding speeds [rad/s] of both clutches: of the motor's side over the screw's."""
        speed = self.ratios(y[FIN])[0] * y[RATE]
        return y[MOTOR] - speed, -y[MOTOR] - speed

    def limits(self, y: Vector) -> tuple[float, float]:
        """Return the torques [N.m] at which the clutches slip."""
        first, second = (coil.limit(y[FLUX_1 + k], y[TEMPERATURE]) for k, coil in enumerate(self.coils))
        return first, second

    def references(self, around: Surroundings) -> tuple[float, float]:
        """Return the current references [A] of both coils."""
        if not around.enable:
            return 0.0, 0.0
        net, bias = around.reference, self.p["clutch.bias_current"]
        return self.p["coil.connected_1"] * (bias + max(net, 0.0)), bias + max(-net, 0.0)

    def surplus(self, y: Vector, around: Surroundings) -> float:
        """Return the voltage [V] left for the motor's winding."""
        return around.supply - self.emf * y[MOTOR]

    # Motion -------------------------------------------------------------------------------------------------

    def _loads(self, y: Vector, mode: Mode, around: Surroundings, without: int = -1) -> tuple[float, float]:
        """Return moment and torque [N.m] on fin and motor.

        The clutch `without` is left out, and so is the friction of a screw at rest.
        """
        delta, rate, speed = y[:COIL_1]
        ratio, ratio_slope = self.ratios(delta)
        s = self.screw
        fin = s.loads(delta, around) - s.motor_inertia * ratio * ratio_slope * rate * rate
        if mode.screw:
            fin -= (ratio * ratio * s.viscous[mode.screw] + s.fin_viscous) * rate
            fin -= mode.screw * s.coulomb(delta, mode.screw)
        motor = self.torque_constant * self.surplus(y, around) / self.p["motor.resistance"] if mode.feeds else 0.0
        motor -= self.p["motor.viscous_friction"] * speed + self.p["motor.coulomb_friction"]
        for k, limit in enumerate(self.limits(y)):
            if k != without:
                torque = mode.slip[k] * limit  # on the screw
                fin, motor = fin + ratio * torque, motor - TURNS[k] * torque
        return fin, motor

    def _inertia(self, delta: float) -> float:
        return self.screw.fin_inertia + self.screw.motor_inertia * self.ratios(delta)[0] ** 2

    def locked(self, y: Vector, mode: Mode, k: int, around: Surroundings) -> tuple[float, float, float]:
        """Return the fin's and the motor's acceleration [rad/s2] with clutch k locked, and its torque [N.m]."""
        ratio, ratio_slope = self.ratios(y[FIN])
        turn = TURNS[k]
        fin, motor = self._loads(y, mode, around, k)
        bent = ratio_slope * y[RATE] * y[RATE]
        rate = ((fin + ratio * turn * motor - self.rotor * ratio * bent)
                / (self._inertia(y[FIN]) + self.rotor * ratio * ratio))
        faster = ratio * rate + bent
        return rate, turn * faster, turn * motor - self.rotor * faster

    def slope(self, y: Vector, mode: Mode, around: Surroundings) -> list[float]:
        """Return the time derivative of the state in a mode."""
        slips, limits = self.slips(y), self.limits(y)
        if 0 in mode.slip:
            rate, faster, _ = self.locked(y, mode, mode.slip.index(0), around)
        else:
            fin, motor = self._loads(y, mode, around)
            rate, faster = fin / self._inertia(y[FIN]), motor / self.rotor
        if mode.screw == 0:
            rate = 0.0
        heat = sum(limits[k] * mode.slip[k] * slips[k] for k in (0, 1))
        (first, flux_1), (second, flux_2) = (
            coil.slopes(reference, side, y[COIL_1 + k], y[FLUX_1 + k], around.supply)
            for k, (coil, reference, side) in enumerate(
                zip(self.coils, self.references(around), mode.coils, strict=True)))
        return [y[RATE] if mode.screw else 0.0, rate, faster, first, second, flux_1, flux_2,
                warming(self.p, heat, y[TEMPERATURE])]

    # Modes --------------------------------------------------------------------------------------------------

    def _excess(self, y: Vector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a screw at rest towards `side` beyond what friction, or a stop, holds."""
        if side * y[FIN] >= self.screw.stop:
            return -1.0
        return side * self._loads(y, mode._replace(screw=0), around)[0] - self.screw.coulomb(y[FIN], side)

    def rest(self, y: Vector, mode: Mode, around: Surroundings) -> int:
        """Return the direction in which a screw at rest breaks away, or 0."""
        return next((side for side in (1, -1) if self._excess(y, mode, around, side) > 0.0), 0)

    def stuck(self, y: Vector, mode: Mode, k: int, around: Surroundings) -> Mode:
        """Return the mode of clutch k with no slip: locked, or sliding the way its torque drives it."""
        _, _, torque = self.locked(y, mode, k, around)
        slip = 0 if abs(torque) <= self.limits(y)[k] else sign(torque)
        return mode._replace(slip=_with(mode.slip, k, slip))

    def admit(self, y: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped."""
        first, second = (coil.mode(reference, y[COIL_1 + k], around.supply)
                         for k, (coil, reference) in enumerate(zip(self.coils, self.references(around), strict=True)))
        mode = mode._replace(coils=(first, second), feeds=self.surplus(y, around) > 0.0)
        if mode.screw == 0:
            mode = mode._replace(screw=self.rest(y, mode, around))
        return self.stuck(y, mode, mode.slip.index(0), around) if 0 in mode.slip else mode

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end a mode."""
        def motor_rests(y: State) -> Mode:
            raise ValueError("the motor comes to rest, which this reference does not follow")

        feeding = 1.0 if mode.feeds else -1.0
        events = [Event(lambda y: y[MOTOR], motor_rests), *self._screw_events(mode, around)]
        for k, (coil, reference) in enumerate(zip(self.coils, self.references(around), strict=True)):
            events += self._slip_events(mode, k, around)
            events += coil.events(reference, mode.coils[k], COIL_1 + k, around.supply,
                                  lambda to, k=k: mode._replace(coils=_with(mode.coils, k, to)))  # type: ignore[misc]
        return [*events, Event(lambda y: feeding * self.surplus(y, around),
                               lambda _: mode._replace(feeds=not mode.feeds))]

    def _screw_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        def halt(y: State) -> Mode:
            y[RATE] = 0.0
            # No clutch holds a screw at rest to a motor that turns.
            first, second = self.slips(y)
            loose = mode._replace(slip=(sign(first) or 1, sign(second) or -1))
            return loose._replace(screw=self.rest(y, loose, around))

        def strike(y: State) -> Mode:
            y[FIN] = mode.screw * self.screw.stop
            return halt(y)

        events = friction_events(mode.screw, lambda y: y[RATE], lambda y, side: self._excess(y, mode, around, side),
                                 halt, lambda side: lambda _: mode._replace(screw=side))
        return [*events, Event(lambda y: self.screw.stop - mode.screw * y[FIN], strike)] if mode.screw else events

    def _slip_events(self, mode: Mode, k: int, around: Surroundings) -> list[Event]:
        def meet(y: State) -> Mode:
            y[MOTOR] = TURNS[k] * self.ratios(y[FIN])[0] * y[RATE]
            return self.stuck(y, mode, k, around)

        def slide(side: int) -> Successor:
            return lambda _: mode._replace(slip=_with(mode.slip, k, side))

        return friction_events(
            mode.slip[k], lambda y: self.slips(y)[k],
            lambda y, side: side * self.locked(y, mode, k, around)[2] - self.limits(y)[k], meet, slide)


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from its start and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    plant = Clutches(parameters)
    controllers = Controllers(plant.screw, plant.nominal, plant.p["fin.start_angle"])
    return run(plant, lambda y, command, enable: controllers.sample(y[FIN], y[RATE], command, enable,
                                                                    y[COIL_1] - y[COIL_2]),
               plant.p, inputs, voltage_starts(parameters), OUTPUTS)
