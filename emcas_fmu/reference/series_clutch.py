"""The series clutch actuator in time: rotor, clutch, screw, no-back and fin integrated from event to event.

Coordinates are the fin's angle and rate and the rotor's speed; the nut passes a moment M from the screw to the fin,
which the screw feels as e M/R, e by whether it drives the fin. A `Mode` says which way rotor, clutch and screw slide,
or that they stick, the sign of what passes the nut, and where drive and coil's amplifier stand. Motor and drive are
those of the thesis's actuator in this package, on a rotor that turns by itself; so are controllers, bus, lever and
loads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from .coil import Coil, warming
from .plant import FREE, Guard, Plant, Surroundings, Value, Vector
from .plant import Mode as Electrical
from .simulate import Array, Bus, Controllers, advance, columns_of, electric_starts, schedule

_RTOL = 1e-10
FIN, RATE, ROTOR, CURRENT, INTEGRAL, COIL, FLUX, TEMPERATURE = range(8)
_HOW = {"rtol": _RTOL, "atol": _RTOL * np.array([1e-2, 1.0, 10.0, 1.0, 1.0, 0.1, 0.1, 10.0]), "max_step": 2e-4}
OUTPUTS = ("fin_angle", "fin_rate", "motor_speed", "motor_current", "motor_voltage", "coil_current",
           "clutch_temperature", "drive_reference")
State = list[float]


class Mode(NamedTuple):
    """`screw`, `rotor` and `slip` are directions of sliding, 0 of what sticks; the screw drives the fin (`load` 1) or
    is driven by it (-1); `coil` and `drive` are where their voltages stand."""

    screw: int
    rotor: int
    slip: int
    load: int
    coil: int
    drive: int


def sign(value: float) -> int:
    """Return -1, 0 or 1."""
    return (value > 0.0) - (value < 0.0)


class _Drive(Plant):
    """Motor and drive of a rotor by itself, in place of the fin; `faster` [rad/s2] is how the rotor accelerates."""

    faster = 0.0

    def ratio(self, delta: float) -> float:
        """Return 1: what turns is the rotor."""
        return 1.0

    def bend(self, delta: float) -> float:
        """Return 0."""
        return 0.0

    def _omega_slope(self, state: Vector, motion: int, around: Surroundings) -> float:
        return self.faster


class SeriesClutch:
    """The plant of one series clutch actuator as built, and the `nominal` one that its controllers know."""

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.p = {name: float(value) for name, value in parameters.items()}
        driven, driving = p["clutch.driven_inertia"], p["clutch.driving_inertia"]
        whole = {"inertia.motor": p["inertia.motor"] + driving + driven}
        for way in ("positive", "negative"):
            whole[f"friction.coulomb.{way}[0]"] = p[f"friction.coulomb.{way}[0]"] + p["motor.coulomb_friction"]
        self.nominal = Plant({**p, **whole})
        self.screw = Plant({**p, "inertia.motor": driven}).as_built()
        drive = _Drive(p).as_built()
        assert isinstance(drive, _Drive)
        self.drive = drive
        self.coil = Coil(p, "coil.kp", "clutch.share")
        self.rotor_inertia = p["inertia.motor"] + driving
        self.screw_inertia = driven + p["inertia.screw"]
        self.forward, self.backward = 1.0 / p["efficiency.forward"], p["efficiency.backward"]

    # Parts --------------------------------------------------------------------------------------------------

    def turning(self, y: Vector) -> float:
        """Return the screw's speed [rad/s]."""
        return self.screw.ratio(y[FIN]) * y[RATE]

    def limit(self, y: Vector) -> float:
        """Return the torque [N.m] at which the clutch slips."""
        return self.coil.limit(y[FLUX], y[TEMPERATURE])

    def asked(self, around: Surroundings) -> float:
        """Return the current [A] asked of the coil."""
        return self.p["coil.connected"] * self.p["clutch.rated_current"] if around.enable else 0.0

    def _rotor(self, y: Vector, around: Surroundings) -> float:
        """Return the torque [N.m] on the rotor but dry friction and clutch."""
        return (self.drive.torque_constant * y[CURRENT] - self.p["motor.viscous_friction"] * y[ROTOR]
                - self.rotor_inertia * around.faster[0])

    def _screw(self, y: Vector, way: int, around: Surroundings) -> float:
        """Return the torque [N.m] on a screw that slides `way` but that of clutch and nut."""
        s = self.screw
        return (-self.screw_inertia * around.faster[0] - s.viscous[way] * self.turning(y)
                - way * s.coulomb_factor * s.motor_coulomb(y[FIN], way))

    def _fin(self, y: Vector, way: int, around: Surroundings) -> tuple[float, float]:
        """Return inertia [kg.m2] and moment [N.m] that the nut has to move: M = inertia * acceleration + moment."""
        s, delta, rate = self.screw, y[FIN], y[RATE]
        ratio, nut = s.ratio(delta), self.p["mass.nut"] * s.lead**2
        outside = s.loads(delta, around) + ratio * self.screw_inertia * around.faster[0]  # the screw's own share
        moment = (nut * ratio * ratio * s.bend(delta) * rate * rate + way * s.fin_coulomb + s.fin_viscous * rate
                  - outside)
        return s.fin_inertia + nut * ratio * ratio, moment

    # Motion -------------------------------------------------------------------------------------------------

    def _moved(self, y: Vector, mode: Mode, around: Surroundings) -> tuple[float, float, float]:
        """Return the accelerations of fin and rotor [rad/s2] and the moment M [N.m], of a screw that moves."""
        way, ratio = mode.screw, self.screw.ratio(y[FIN])
        torque, inertia = self._screw(y, way, around), self.screw_inertia
        if mode.slip:
            torque += mode.slip * self.limit(y)
        else:
            torque += self._rotor(y, around) - way * self.p["motor.coulomb_friction"]
            inertia += self.rotor_inertia
        felt = (self.forward if mode.load > 0 else self.backward) / ratio
        behind, moment = self._fin(y, way, around)
        bent = ratio * self.screw.bend(y[FIN]) * y[RATE] ** 2
        rate = (torque - inertia * bent - felt * moment) / (inertia * ratio + felt * behind)
        faster = self._apart(y, mode, around) if mode.slip else ratio * rate + bent
        return rate, faster, behind * rate + moment

    def _apart(self, y: Vector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of a rotor whose clutch slips."""
        if mode.rotor == 0:
            return 0.0
        dry = mode.rotor * self.p["motor.coulomb_friction"]
        return (self._rotor(y, around) - dry - mode.slip * self.limit(y)) / self.rotor_inertia

    def _held(self, y: Vector, mode: Mode, around: Surroundings) -> float:
        """Return the torque [N.m] of a clutch that holds, of a screw that moves."""
        _, faster, _ = self._moved(y, mode, around)
        return self._rotor(y, around) - mode.rotor * self.p["motor.coulomb_friction"] - self.rotor_inertia * faster

    def _accelerations(self, y: Vector, mode: Mode, around: Surroundings) -> tuple[float, float]:
        if mode.screw:
            return self._moved(y, mode, around)[:2]
        return 0.0, self._apart(y, mode, around) if mode.slip else 0.0

    def _motor(self, y: Vector, mode: Mode, around: Surroundings) -> State:
        """Return the state of motor and drive as that of a rotor in a fin's place."""
        if self.drive.electrical_inductance:  # else no limit moves with the speed
            self.drive.faster = self._accelerations(y, mode, around)[1]
        return [0.0, y[ROTOR], y[CURRENT], y[INTEGRAL]]

    def slope(self, y: Vector, mode: Mode, around: Surroundings) -> list[float]:
        """Return the time derivative of the state in a mode."""
        rate, faster = self._accelerations(y, mode, around)
        _, _, rise, integral = self.drive.slope(self._motor(y, mode, around), Electrical(1, mode.drive), around)
        current, flux = self.coil.slopes(self.asked(around), mode.coil, y[COIL], y[FLUX], around.supply)
        heat = mode.slip * self.limit(y) * (y[ROTOR] - self.turning(y))
        return [y[RATE] if mode.screw else 0.0, rate, faster, rise, integral, current, flux,
                warming(self.p, heat, y[TEMPERATURE])]

    # Modes --------------------------------------------------------------------------------------------------

    def _starts(self, y: Vector, around: Surroundings) -> tuple[float, float, float, float]:
        """Return the torques [N.m] from rotor to screw above which and below which a screw at rest starts up and down,
        and above which and below which a rotor at rest starts down and up."""
        bounds = []
        for way in (1, -1):
            _, moment = self._fin(y, way, around)
            felt = self.forward if way * moment > 0.0 else self.backward
            bounds.append(math.inf * way if way * y[FIN] >= self.screw.stop else
                          felt * moment / self.screw.ratio(y[FIN]) - self._screw(y, way, around))
        dry, rotor = self.p["motor.coulomb_friction"], self._rotor(y, around)
        return bounds[0], bounds[1], rotor + dry, rotor - dry

    def _loaded(self, y: Vector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode with what passes the nut as it is: its sign does not depend on how much of it is felt."""
        if not mode.screw:
            return mode
        return mode._replace(load=1 if mode.screw * self._moved(y, mode._replace(load=1), around)[2] > 0.0 else -1)

    def settle(self, y: Vector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode in which what does not slide in `mode` sticks, if it can."""
        screw, rotor, slip = mode[:3]
        up, down, most, least = self._starts(y, around)
        limit = self.limit(y)
        if slip == 0:
            way = screw or (1 if least > up else -1 if most < down else 0)
            joined = self._loaded(y, mode._replace(screw=way, rotor=way), around)
            if way:
                torque = self._held(y, joined, around)
            else:
                low, high = max(least, down), min(most, up)
                torque = low if low > 0.0 else min(high, 0.0)
            if abs(torque) <= limit:
                return joined
            slip = sign(torque)
        pushed = slip * limit
        screw = screw or (1 if pushed > up else -1 if pushed < down else 0)
        rotor = rotor or (1 if pushed < least else -1 if pushed > most else 0)
        return self._loaded(y, mode._replace(screw=screw, rotor=rotor, slip=slip), around)

    def admit(self, y: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; the current of an opened bridge is 0."""
        motor = self._motor(y, mode, around)
        drive = self.drive.admit(motor, Electrical(1, mode.drive), around).drive
        y[CURRENT], y[INTEGRAL] = motor[2:]
        coil = self.coil.side(self.asked(around), y[COIL], around.supply)
        return self.settle(y, mode._replace(coil=coil, drive=drive), around)

    def guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        """Return what ends a mode."""
        guards: list[Guard] = []

        def lose(value: Callable[[Vector], float], then: Callable[[State], Mode]) -> None:
            guards.append(Guard(value, -1, then))

        def go(**changes: int) -> Callable[[State], Mode]:
            return lambda y: self.settle(y, mode._replace(**changes), around)

        if mode.screw:
            self._while_moving(mode, around, lose)
        elif mode.slip:
            lose(lambda y: self._starts(y, around)[0] - mode.slip * self.limit(y), go(screw=1))
            lose(lambda y: mode.slip * self.limit(y) - self._starts(y, around)[1], go(screw=-1))
        else:
            # At rest as a whole, while a torque of the clutch keeps both: which two bounds of it meet says what starts.
            for low, high, begins in ((3, 0, (1, 1, 0)), (1, 2, (-1, -1, 0)), (3, None, (0, 1, 1)),
                                      (1, None, (-1, 0, 1)), (None, 2, (0, -1, -1)), (None, 0, (1, 0, -1))):
                def left(y: Vector, low: int | None = low, high: int | None = high) -> float:
                    bounds = self._starts(y, around)
                    return ((self.limit(y) if high is None else bounds[high])
                            - (-self.limit(y) if low is None else bounds[low]))

                lose(left, go(**dict(zip(Mode._fields, begins, strict=False))))
        if mode.slip:
            def meet(y: State) -> Mode:
                y[ROTOR] = self.turning(y) if mode.screw else 0.0
                return self.settle(y, mode._replace(rotor=mode.screw, slip=0), around)

            lose(lambda y: mode.slip * (y[ROTOR] - self.turning(y)), meet)
            if mode.rotor:
                def stand(y: State) -> Mode:
                    y[ROTOR] = 0.0
                    return self.settle(y, mode._replace(rotor=0), around)

                if mode.screw:  # of one that stands it is that event
                    lose(lambda y: mode.rotor * y[ROTOR], stand)
            else:
                lose(lambda y: self._starts(y, around)[2] - mode.slip * self.limit(y), go(rotor=-1))
                lose(lambda y: mode.slip * self.limit(y) - self._starts(y, around)[3], go(rotor=1))
        self._electric(mode, around, lose, guards)
        return guards

    def _while_moving(self, mode: Mode, around: Surroundings, lose: Callable[..., None]) -> None:
        """Add what ends a mode in which the screw moves."""
        way = mode.screw

        def halt(y: State) -> Mode:
            y[RATE] = 0.0
            if mode.slip == 0:
                y[ROTOR] = 0.0
            return self.settle(y, mode._replace(screw=0, rotor=mode.rotor if mode.slip else 0), around)

        def strike(y: State) -> Mode:
            y[FIN], y[RATE] = way * self.screw.stop, 0.0
            going = sign(y[ROTOR])
            return self.settle(y, mode._replace(screw=0, rotor=going, slip=going), around)

        lose(lambda y: way * y[RATE], halt)
        lose(lambda y: self.screw.stop - way * y[FIN], strike)
        lose(lambda y: mode.load * way * self._moved(y, mode, around)[2], lambda y: mode._replace(load=-mode.load))
        if mode.slip == 0:
            for side in (1, -1):
                lose(lambda y, side=side: self.limit(y) - side * self._held(y, mode, around),
                     lambda y, side=side: self.settle(y, mode._replace(slip=side), around))

    def _electric(self, mode: Mode, around: Surroundings, lose: Callable[..., None], guards: list[Guard]) -> None:
        """Add the limits of the coil's amplifier and of the drive's voltage."""
        asked = self.asked(around)
        for to in (0,) if mode.coil else (1, -1):
            lose(lambda y, to=to: self.coil.left(asked, mode.coil, y[COIL], around.supply)[to],
                 lambda y, to=to: mode._replace(coil=to))
        for guard in self.drive._drive_guards(Electrical(1, mode.drive), around):
            guards.append(Guard(
                lambda y, guard=guard: guard.value(self._motor(y, mode, around)), int(guard.direction),  # type: ignore[misc]
                lambda y, guard=guard: mode._replace(drive=guard.successor(self._motor(y, mode, around)).drive)))  # type: ignore[misc]


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from its start and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    plant = SeriesClutch(parameters)
    p, nominal = plant.p, plant.nominal
    columns = columns_of(inputs, electric_starts(parameters))
    if min(columns["supply_voltage"]) <= 0.0:
        raise ValueError("supply_voltage must be above 0: the modes of the drive are distinguished by its limits")
    instants, row_at, sample_at, arrival_at = schedule(inputs["time"], p)

    engaged = p["coil.connected"] * p["clutch.rated_current"]
    y = [p["fin.start_angle"], 0.0, 0.0, 0.0, 0.0, engaged, engaged, p["friction.temperature"]]
    controllers, bus = Controllers(plant.screw, nominal, y[FIN]), Bus(p)
    mode, active, dac = Mode(0, 0, 0, 1, 0, FREE), 0.0, [0.0]
    row: dict[str, float] = {name: column[0] for name, column in columns.items()}
    around = nominal.surroundings(row, active)
    records = []
    for t, following in zip(instants, [*instants[1:], None], strict=True):
        if t in row_at:
            voltage = plant.drive.voltage(plant._motor(y, mode, around), around)
            records.append((t, *y[:CURRENT + 1], voltage, y[COIL], y[TEMPERATURE], dac[-1]))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            command = bus.arrived(row["fin_command"])
            dac.append(controllers.sample(y[FIN], y[RATE], command, bool(row["enable"]), y[CURRENT]))
        if t in arrival_at:
            active = dac[1 + arrival_at[t]]
        around = nominal.surroundings(row, active)
        mode = plant.admit(y, mode, around)
        y, mode = advance(plant, y, mode, around, t, following, _HOW)
    return dict(zip(("time", *OUTPUTS), np.array(records).T, strict=True))
