"""The series clutch actuator in time: rotor, clutch, screw, no-back and fin integrated from event to event.

Coordinates are the fin's angle and rate and the rotor's speed; the nut transmits a moment M from the screw to the fin,
which the screw feels as e M/R, with e by whether it drives the fin. A `Mode` holds the directions in which rotor,
clutch and screw slide, or that they stick, the sign of M, and the modes of the drive and of the coil's amplifier.
Drive, controllers, bus, lever and loads are those of the thesis's actuator; the rotor turns by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from .coil import Coil, warming
from .controllers import Controllers
from .drive import FREE, Drive, Motor
from .events import Accuracy, Event, State, Successor, Value, Vector
from .plant import FinPlant
from .simulate import Array, check_supply, run, voltage_starts
from .vehicle import Surroundings, as_built

FIN, RATE, ROTOR, CURRENT, INTEGRAL, COIL, FLUX, TEMPERATURE = range(8)
OUTPUTS = ("fin_angle", "fin_rate", "motor_speed", "motor_current", "motor_voltage", "coil_current",
           "clutch_temperature", "drive_reference")


class Mode(NamedTuple):
    """`screw`, `rotor` and `slip` are directions of sliding, 0 of what sticks; the screw drives the fin (`load` 1) or
    is driven by it (-1); `coil` and `drive` are the modes of amplifier and drive."""

    screw: int
    rotor: int
    slip: int
    load: int
    coil: int
    drive: int


def sign(value: float) -> int:
    """Return -1, 0 or 1."""
    return (value > 0.0) - (value < 0.0)


class SeriesClutch:
    """The plant of one series clutch actuator as built, and the `nominal` one that its controllers compute with."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 10.0, 1.0, 1.0, 0.1, 0.1, 10.0), 2e-4)

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.p = {name: float(value) for name, value in parameters.items()}
        driven, driving = p["clutch.driven_inertia"], p["clutch.driving_inertia"]
        whole = {"inertia.motor": p["inertia.motor"] + driving + driven}
        for way in ("positive", "negative"):
            whole[f"friction.coulomb.{way}[0]"] = p[f"friction.coulomb.{way}[0]"] + p["motor.coulomb_friction"]
        self.nominal = FinPlant({**p, **whole})
        built = as_built(p)
        self.screw, self.drive = FinPlant({**built, "inertia.motor": driven}), Drive(built)
        self.coil = Coil(p, "coil.kp", "clutch.share")
        self.rotor_inertia = p["inertia.motor"] + driving
        self.screw_inertia = driven + p["inertia.screw"]
        self.forward, self.backward = 1.0 / p["efficiency.forward"], p["efficiency.backward"]

    def start(self) -> tuple[State, Mode]:
        """Return the state and the mode at the start."""
        p, engaged = self.p, self.p["coil.connected"] * self.p["clutch.rated_current"]
        return ([p["fin.start_angle"], 0.0, 0.0, 0.0, 0.0, engaged, engaged, p["friction.temperature"]],
                Mode(0, 0, 0, 1, 0, FREE))

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return what acts under an input row and a delayed DAC value [V]."""
        return self.nominal.surroundings(row, reference)

    def outputs(self, y: Vector, _mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return the outputs up to the clutch's temperature."""
        return *y[:INTEGRAL], self.drive.voltage(_motor(y), around), y[COIL], y[TEMPERATURE]

    # Parts --------------------------------------------------------------------------------------------------

    def turning(self, y: Vector) -> float:
        """Return the screw's speed [rad/s]."""
        return self.screw.ratio(y[FIN]) * y[RATE]

    def limit(self, y: Vector) -> float:
        """Return the torque [N.m] at which the clutch slips."""
        return self.coil.limit(y[FLUX], y[TEMPERATURE])

    def reference(self, around: Surroundings) -> float:
        """Return the current reference [A] of the coil."""
        return self.p["coil.connected"] * self.p["clutch.rated_current"] if around.enable else 0.0

    def _rotor(self, y: Vector, around: Surroundings) -> float:
        """Return the torque [N.m] on the rotor without dry friction and clutch."""
        return (self.drive.torque_constant * y[CURRENT] - self.p["motor.viscous_friction"] * y[ROTOR]
                - self.rotor_inertia * around.faster[0])

    def _screw(self, y: Vector, way: int, around: Surroundings) -> float:
        """Return the torque [N.m] on a screw that slides `way`, without clutch and nut."""
        s = self.screw
        return (-self.screw_inertia * around.faster[0] - s.viscous[way] * self.turning(y)
                - way * s.coulomb_factor * s.motor_coulomb(y[FIN], way))

    def _fin(self, y: Vector, way: int, around: Surroundings) -> tuple[float, float]:
        """Return inertia [kg.m2] and moment [N.m] that the nut has to move: M = inertia * acceleration + moment."""
        s, delta, rate = self.screw, y[FIN], y[RATE]
        ratio, nut = s.ratio(delta), self.p["mass.nut"] * s.lead**2
        outside = s.loads(delta, around) + ratio * self.screw_inertia * around.faster[0]  # the screw's share
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
        """Return the accelerations of fin and rotor [rad/s2]."""
        if mode.screw:
            return self._moved(y, mode, around)[:2]
        return 0.0, self._apart(y, mode, around) if mode.slip else 0.0

    def slope(self, y: Vector, mode: Mode, around: Surroundings) -> list[float]:
        """Return the time derivative of the state in a mode."""
        rate, faster = self._accelerations(y, mode, around)
        rise, integral = self.drive.slopes(_motor(y), mode.drive, around, lambda: faster)
        current, flux = self.coil.slopes(self.reference(around), mode.coil, y[COIL], y[FLUX], around.supply)
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
        """Return the mode with the sign of M as it is: that does not depend on how much of M the screw feels."""
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
        drive = self.drive.admit(_motor(y), around, lambda: self._accelerations(y, mode, around)[1])
        if not around.enable:
            y[CURRENT] = y[INTEGRAL] = 0.0
        coil = self.coil.mode(self.reference(around), y[COIL], around.supply)
        return self.settle(y, mode._replace(coil=coil, drive=drive), around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end a mode."""
        events = self._moving_events(mode, around) if mode.screw else self._rest_events(mode, around)
        if mode.slip:
            events += self._slip_events(mode, around)
        events += self.coil.events(self.reference(around), mode.coil, COIL, around.supply,
                                   lambda to: mode._replace(coil=to))
        return events + self.drive.events(mode.drive, around, _motor, lambda y: self._accelerations(y, mode, around)[1],
                                          lambda _, drive: mode._replace(drive=drive))

    def _rest_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that start a screw at rest, and its rotor where the clutch holds."""
        def settled(**changes: int) -> Successor:
            return lambda y: self.settle(y, mode._replace(**changes), around)

        if mode.slip:
            return [Event(lambda y: self._starts(y, around)[0] - mode.slip * self.limit(y), settled(screw=1)),
                    Event(lambda y: mode.slip * self.limit(y) - self._starts(y, around)[1], settled(screw=-1))]

        def left(low: int | None, high: int | None, screw: int, rotor: int, slip: int) -> Event:
            def margin(y: Vector) -> float:
                bounds = self._starts(y, around)
                return ((self.limit(y) if high is None else bounds[high])
                        - (-self.limit(y) if low is None else bounds[low]))

            return Event(margin, settled(screw=screw, rotor=rotor, slip=slip))

        # All is at rest while there is a torque of the clutch, at most its limit (None), that keeps both at rest. What
        # starts follows from which lower and upper bounds of it meet.
        return [left(3, 0, 1, 1, 0), left(1, 2, -1, -1, 0), left(3, None, 0, 1, 1), left(1, None, -1, 0, 1),
                left(None, 2, 0, -1, -1), left(None, 0, 1, 0, -1)]

    def _slip_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end the slip of the clutch, or the rest or the motion of its rotor."""
        def meet(y: State) -> Mode:
            y[ROTOR] = self.turning(y) if mode.screw else 0.0
            return self.settle(y, mode._replace(rotor=mode.screw, slip=0), around)

        def halt(y: State) -> Mode:
            y[ROTOR] = 0.0
            return self.settle(y, mode._replace(rotor=0), around)

        def start(side: int) -> Successor:
            return lambda y: self.settle(y, mode._replace(rotor=side), around)

        events = [Event(lambda y: mode.slip * (y[ROTOR] - self.turning(y)), meet)]
        if not mode.rotor:
            events += [Event(lambda y: self._starts(y, around)[2] - mode.slip * self.limit(y), start(-1)),
                       Event(lambda y: mode.slip * self.limit(y) - self._starts(y, around)[3], start(1))]
        elif mode.screw:  # with a screw at rest the end of the slip is the same event
            events.append(Event(lambda y: mode.rotor * y[ROTOR], halt))
        return events

    def _moving_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events of a screw that moves."""
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

        def slide(side: int) -> Event:
            return Event(lambda y: self.limit(y) - side * self._held(y, mode, around),
                         lambda y: self.settle(y, mode._replace(slip=side), around))

        events = [Event(lambda y: way * y[RATE], halt), Event(lambda y: self.screw.stop - way * y[FIN], strike),
                  Event(lambda y: mode.load * way * self._moved(y, mode, around)[2],
                        lambda _: mode._replace(load=-mode.load))]
        return events if mode.slip else [*events, slide(1), slide(-1)]


def _motor(y: Vector) -> Motor:
    return Motor(y[ROTOR], y[CURRENT], y[INTEGRAL])


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from its start and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    check_supply(inputs)
    plant = SeriesClutch(parameters)
    controllers = Controllers(plant.screw, plant.nominal, plant.p["fin.start_angle"])
    return run(plant, lambda y, command, enable: controllers.sample(y[FIN], y[RATE], command, enable, y[CURRENT]),
               plant.p, inputs, voltage_starts(parameters), OUTPUTS)
