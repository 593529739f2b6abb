"""The dual clutch actuator in time: fin and motor integrated from event to event.

Coordinates are the fin's angle and rate and the motor's speed; a `Mode` says which way each dry friction slides, or
that it sticks, and where each coil's amplifier and the motor's diode stand. SciPy's DOP853 integrates a mode until a
guard's zero. The motor has to keep turning: a run in which it comes to rest is refused. Controllers, bus and what is
known of lever, loads and friction are those of the thesis's actuator in this package.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .coil import Coil, warming
from .plant import Guard, Plant, Surroundings, Value
from .simulate import Array, Bus, Controllers, advance, columns_of, electric_starts, schedule

_RTOL = 1e-10
# Fin angle and rate, motor speed, coil currents, fluxes, temperature.
_HOW = {"rtol": _RTOL, "atol": _RTOL * np.array([1e-2, 1.0, 10.0, 0.1, 0.1, 0.1, 0.1, 10.0]), "max_step": 5e-4}
OUTPUTS = ("fin_angle", "fin_rate", "motor_speed", "coil_current_1", "coil_current_2", "clutch_temperature",
           "drive_reference")
State = list[float]
TURNS = (1.0, -1.0)  # of the motor, the way in which each clutch turns the screw


@dataclass(frozen=True)
class Mode:
    """`screw` and `slip` of the clutches are directions of sliding, 0 of what sticks; `coils` stand at 1, the supply's
    voltage, -1, the suppressor's, or 0, none; `feeds` is whether the motor draws current."""

    screw: int
    slip: tuple[int, int]
    coils: tuple[int, int]
    feeds: bool


def sign(value: float) -> int:
    """Return -1, 0 or 1."""
    return (value > 0.0) - (value < 0.0)


class Clutches:
    """The plant of one dual clutch actuator as built."""

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.p = {name: float(value) for name, value in parameters.items()}
        self.coils = [Coil(p, "drive.kp", f"clutch.share_{k}") for k in (1, 2)]
        per_ampere = p["clutch.rated_torque"] * (1.0 - p["clutch.residual"]) / p["clutch.rated_current"]
        # Lever, screw, fin and loads of the thesis's actuator: the driven halves turn where its rotor does.
        self.nominal = Plant({**p, "inertia.motor": p["clutch.driven_inertia"],
                              "motor.torque_constant": per_ampere, "motor.inductance": 1.0,
                              "motor.pole_pairs": 0.0, "drive.ki": 0.0})
        self.screw = self.nominal.as_built()
        flux = 1.0 + p["deviation.motor.torque_constant"]
        self.torque_constant, self.emf = p["motor.torque_constant"] * flux, p["motor.back_emf_constant"] * flux
        self.rotor = p["inertia.motor"] + p["clutch.driving_inertia"]

    # Parts --------------------------------------------------------------------------------------------------

    def ratios(self, delta: float) -> tuple[float, float]:
        """Return R and R' at a fin angle [rad]."""
        tangent = math.tan(delta + self.screw.assembly)
        ratio = self.screw.ratio(delta)
        return ratio, 2.0 * ratio * tangent

    def slips(self, y: Sequence[float]) -> tuple[float, float]:
        """Return the sliding speeds [rad/s] of both clutches: of the motor's side over the screw's."""
        speed = self.ratios(y[0])[0] * y[1]
        return y[2] - speed, -y[2] - speed

    def limits(self, y: Sequence[float]) -> tuple[float, float]:
        """Return the torques [N.m] at which the clutches slip."""
        first, second = (coil.limit(y[5 + k], y[7]) for k, coil in enumerate(self.coils))
        return first, second

    def asked(self, around: Surroundings) -> tuple[float, float]:
        """Return the currents [A] asked of both coils."""
        if not around.enable:
            return 0.0, 0.0
        net, bias = around.current_reference, self.p["clutch.bias_current"]
        return self.p["coil.connected_1"] * (bias + max(net, 0.0)), bias + max(-net, 0.0)

    def surplus(self, y: Sequence[float], around: Surroundings) -> float:
        """Return the voltage [V] left for the motor's winding."""
        return around.supply - self.emf * y[2]

    # Motion -------------------------------------------------------------------------------------------------

    def _loads(self, y: Sequence[float], mode: Mode, around: Surroundings, without: int = -1) -> tuple[float, float]:
        """Return what acts on fin and motor [N.m] but the clutch `without` and, at rest, the screw's friction."""
        delta, rate, speed = y[:3]
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

    def locked(self, y: Sequence[float], mode: Mode, k: int, around: Surroundings) -> tuple[float, float, float]:
        """Return the fin's and the motor's acceleration [rad/s2] with clutch k locked, and its torque [N.m]."""
        ratio, ratio_slope = self.ratios(y[0])
        turn = TURNS[k]
        fin, motor = self._loads(y, mode, around, k)
        bent = ratio_slope * y[1] * y[1]
        rate = ((fin + ratio * turn * motor - self.rotor * ratio * bent)
                / (self._inertia(y[0]) + self.rotor * ratio * ratio))
        faster = ratio * rate + bent
        return rate, turn * faster, turn * motor - self.rotor * faster

    def slope(self, y: Sequence[float], mode: Mode, around: Surroundings) -> list[float]:
        """Return the time derivative of the state in a mode."""
        heat, slips, limits = 0.0, self.slips(y), self.limits(y)
        if 0 in mode.slip:
            k = mode.slip.index(0)
            rate, faster, _ = self.locked(y, mode, k, around)
        else:
            fin, motor = self._loads(y, mode, around)
            rate, faster = fin / self._inertia(y[0]), motor / self.rotor
        if mode.screw == 0:
            rate = 0.0
        for k in (0, 1):
            heat += limits[k] * mode.slip[k] * slips[k]
        (first, flux_1), (second, flux_2) = (
            coil.slopes(asked, side, y[3 + k], y[5 + k], around.supply) for k, (coil, asked, side) in enumerate(
                zip(self.coils, self.asked(around), mode.coils, strict=True)))
        return [y[1] if mode.screw else 0.0, rate, faster, first, second, flux_1, flux_2, warming(self.p, heat, y[7])]

    # Modes --------------------------------------------------------------------------------------------------

    def rest(self, y: Sequence[float], mode: Mode, around: Surroundings) -> int:
        """Return the way in which a screw at rest breaks away, or 0."""
        moment, _ = self._loads(y, replace(mode, screw=0), around)
        for side in (1, -1):
            if side * moment > self.screw.coulomb(y[0], side) and side * y[0] < self.screw.stop:
                return side
        return 0

    def stuck(self, y: Sequence[float], mode: Mode, k: int, around: Surroundings) -> Mode:
        """Return the mode of clutch k with no slip: locked, or sliding the way its torque drives it."""
        _, _, torque = self.locked(y, mode, k, around)
        slip = list(mode.slip)
        slip[k] = 0 if abs(torque) <= self.limits(y)[k] else sign(torque)
        return replace(mode, slip=(slip[0], slip[1]))

    def amplifiers(self, y: Sequence[float], around: Surroundings) -> tuple[int, int]:
        """Return where the amplifiers of both coils stand."""
        first, second = (coil.side(asked, y[3 + k], around.supply)
                         for k, (coil, asked) in enumerate(zip(self.coils, self.asked(around), strict=True)))
        return first, second

    def admit(self, y: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped."""
        mode = replace(mode, coils=self.amplifiers(y, around), feeds=self.surplus(y, around) > 0.0)
        if mode.screw == 0:
            mode = replace(mode, screw=self.rest(y, mode, around))
        return self.stuck(y, mode, mode.slip.index(0), around) if 0 in mode.slip else mode

    def guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        """Return what ends a mode."""
        guards: list[Guard] = []

        def lose(value: Callable[[Sequence[float]], float], then: Callable[[State], Mode]) -> None:
            guards.append(Guard(value, -1, then))

        def motor_rests(y: State) -> Mode:
            raise ValueError("the motor comes to rest, which this reference does not follow")

        lose(lambda y: y[2], motor_rests)

        if mode.screw:
            side = mode.screw

            def halt(y: State) -> Mode:
                y[1] = 0.0
                loose = self._released(y, mode)
                return replace(loose, screw=self.rest(y, loose, around))

            def strike(y: State) -> Mode:
                y[0] = side * self.screw.stop
                return halt(y)

            lose(lambda y: side * y[1], halt)
            lose(lambda y: self.screw.stop - side * y[0], strike)
        else:
            for way in (1, -1):
                lose(lambda y, way=way: self.screw.coulomb(y[0], way) - way * self._loads(y, mode, around)[0]  # type: ignore[misc]
                     if way * y[0] < self.screw.stop else 1.0, lambda y, way=way: replace(mode, screw=way))  # type: ignore[misc]
        for k, way in enumerate(mode.slip):
            if way:
                def meet(y: State, k: int = k) -> Mode:
                    y[2] = TURNS[k] * self.ratios(y[0])[0] * y[1]
                    return self.stuck(y, mode, k, around)

                lose(lambda y, k=k, way=way: way * self.slips(y)[k], meet)  # type: ignore[misc]
            else:
                for side in (1, -1):
                    def slide(y: State, k: int = k, side: int = side) -> Mode:
                        return replace(mode, slip=(side, mode.slip[1]) if k == 0 else (mode.slip[0], side))

                    lose(lambda y, k=k, side=side: self.limits(y)[k]  # type: ignore[misc]
                         - side * self.locked(y, mode, k, around)[2], slide)
        for k, (coil, asked, at) in enumerate(zip(self.coils, self.asked(around), mode.coils, strict=True)):
            def left(y: Sequence[float], k: int = k, coil: Coil = coil, asked: float = asked, at: int = at
                     ) -> dict[int, float]:
                return coil.left(asked, at, y[3 + k], around.supply)

            def switched(to: int, k: int = k) -> Callable[[State], Mode]:
                return lambda y: replace(mode, coils=(to, mode.coils[1]) if k == 0 else (mode.coils[0], to))

            for to in (0,) if at else (1, -1):
                lose(lambda y, left=left, to=to: left(y)[to], switched(to))  # type: ignore[misc]
        feeding = 1.0 if mode.feeds else -1.0
        lose(lambda y: feeding * self.surplus(y, around), lambda y: replace(mode, feeds=not mode.feeds))
        return guards

    def _released(self, y: State, mode: Mode) -> Mode:
        """Return a mode in which no clutch holds a screw that stands to a motor that turns."""
        first, second = self.slips(y)
        return replace(mode, slip=(sign(first) or 1, sign(second) or -1))


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from its start and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    plant = Clutches(parameters)
    p, nominal = plant.p, plant.nominal
    columns = columns_of(inputs, electric_starts(parameters))
    instants, row_at, sample_at, arrival_at = schedule(inputs["time"], p)

    bias = p["clutch.bias_current"]
    y = [p["fin.start_angle"], 0.0, p["motor.start_speed"], bias, bias, bias, bias, p["friction.temperature"]]
    controllers, bus = Controllers(plant.screw, nominal, y[0]), Bus(p)
    mode, active, dac = Mode(0, (1, -1), (0, 0), True), 0.0, [0.0]
    row: dict[str, float] = {name: column[0] for name, column in columns.items()}
    records = []
    for t, following in zip(instants, [*instants[1:], None], strict=True):
        if t in row_at:
            records.append((t, *y[:5], y[7], dac[-1]))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            command = bus.arrived(row["fin_command"])
            dac.append(controllers.sample(y[0], y[1], command, bool(row["enable"]), y[3] - y[4]))
        if t in arrival_at:
            active = dac[1 + arrival_at[t]]
        around = nominal.surroundings(row, active)
        mode = plant.admit(y, mode, around)
        y, mode = advance(plant, y, mode, around, t, following, _HOW)
    return dict(zip(("time", *OUTPUTS), np.array(records).T, strict=True))
