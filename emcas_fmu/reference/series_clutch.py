"""Integration of the series clutch actuator from event to event: rotor, clutch, screw, no-back and fin.

Coordinates are the fin's angle and rate and the rotor's speed. The nut transmits a moment M from screw to fin. It loads
the screw by e M/R, where e depends on whether the screw drives the fin. A `Mode` contains the directions in which
rotor, clutch and screw slide, 0 if they stick, the direction of power, and the modes of drive and coil amplifier.
Drive, controllers, bus, lever and loads are those of the thesis's actuator; the rotor is a separate body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from .actuator import Sample
from .coil import Coil
from .controllers import Controllers
from .drive import FREE, Driven
from .events import Accuracy, Changes, Event, StateVector
from .screw import Screw
from .vehicle import Surroundings, sign

FIN, RATE, ROTOR, CURRENT, INTEGRAL, COIL, FLUX, TEMPERATURE = range(8)
_KEPT = 1e-9  # N.m at the fin; below it, as by rounding, M keeps its direction from the last event


class Mode(NamedTuple):
    """`screw`, `rotor` and `slip` are directions of sliding, 0 for sticking. The screw drives the fin (`load` 1) or the
    fin drives the screw (-1). `coil` and `drive` are the modes of amplifier and drive."""

    screw: int = 0
    rotor: int = 0
    slip: int = 0
    load: int = 1
    coil: int = 0
    drive: int = FREE


class SeriesClutch(Driven):
    """Rotor with drive, clutch, screw and fin; the controllers compute with `whole`, the thesis's actuator."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 10.0, 1.0, 1.0, 0.1, 0.1, 10.0), 2e-4)
    names = ("fin_angle", "fin_rate", "motor_speed", "motor_current", "motor_voltage", "coil_current",
             "clutch_temperature", "drive_reference")
    current = CURRENT

    def __init__(self, parameters: Mapping[str, float]):
        p = self.p = parameters
        driven, driving, dry = p["clutch.driven_inertia"], p["clutch.driving_inertia"], p["motor.coulomb_friction"]
        constant = [f"friction.coulomb.{way}[0]" for way in ("positive", "negative")]
        self.whole = Screw({**p, "inertia.motor": p["inertia.motor"] + driving + driven,
                            **{name: p[name] + dry for name in constant}})
        self.screw = Screw({**p, "inertia.motor": driven})
        self.coil = Coil(p, "coil.kp", "clutch.share", "coil", COIL, FLUX, TEMPERATURE)
        self.rotor_inertia = p["inertia.motor"] + driving
        self.screw_inertia = driven + p["inertia.screw"]
        self.forward, self.backward = 1.0 / p["efficiency.forward"], p["efficiency.backward"]

    def start(self) -> tuple[StateVector, Mode]:
        p, engaged = self.p, self.p["coil.connected"] * self.p["clutch.rated_current"]
        return [p["fin.start_angle"], 0.0, 0.0, 0.0, 0.0, engaged, engaged, p["friction.temperature"]], Mode()

    def controller(self, nominal: SeriesClutch) -> Sample:
        loops = Controllers(self.screw, nominal.whole)
        return lambda y, command, enable: loops.sample(y[FIN], y[RATE], command, enable, y[CURRENT])

    def outputs(self, y: StateVector, around: Surroundings) -> tuple[float, ...]:
        return *y[:INTEGRAL], self.voltage(y, around), y[COIL], y[TEMPERATURE]

    def speed(self, y: StateVector) -> float:
        """Return the rotor's speed [rad/s]."""
        return y[ROTOR]

    def turning(self, y: StateVector) -> float:
        """Return the screw's speed [rad/s]."""
        return self.screw.ratio(y[FIN]) * y[RATE]

    def reference(self, around: Surroundings) -> float:
        """Return the current reference [A] of the coil."""
        return self.p["coil.connected"] * self.p["clutch.rated_current"] if around.enable else 0.0

    def _rotor(self, y: StateVector, way: int, around: Surroundings) -> float:
        """Return the torque [N.m] on a rotor that turns in the direction `way`, without clutch."""
        return (self.motor_torque(y[CURRENT]) - self.p["motor.viscous_friction"] * y[ROTOR]
                - self.rotor_inertia * around.faster[0] - way * self.p["motor.coulomb_friction"])

    def _screw(self, y: StateVector, way: int, around: Surroundings) -> float:
        """Return the torque [N.m] on a screw that turns in the direction `way`, without clutch and nut."""
        s = self.screw
        return (-self.screw_inertia * around.faster[0] - s.viscous[way] * self.turning(y)
                - way * s.coulomb_factor * s.motor_coulomb(y[FIN], way))

    def _fin(self, y: StateVector, way: int, around: Surroundings) -> tuple[float, float]:
        """Return inertia [kg.m2] and moment [N.m] about the hinge in M = inertia * acceleration + moment."""
        s, delta, rate = self.screw, y[FIN], y[RATE]
        ratio, nut = s.ratio(delta), self.p["mass.nut"] * s.lead**2
        outside = s.loads(delta, around) + ratio * self.screw_inertia * around.faster[0]  # the screw's share
        moment = (nut * ratio * ratio * s.bend(delta) * rate * rate + way * s.fin_coulomb + s.fin_viscous * rate
                  - outside)
        return s.fin_inertia + nut * ratio * ratio, moment

    def _moved(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, float, float]:
        """Return the accelerations of fin and rotor [rad/s2] and the moment M [N.m] while the screw turns."""
        way, ratio = mode.screw, self.screw.ratio(y[FIN])
        torque, inertia = self._screw(y, way, around), self.screw_inertia
        if mode.slip:
            torque += mode.slip * self.coil.limit(y)
        else:
            torque += self._rotor(y, way, around)
            inertia += self.rotor_inertia
        load_ratio = (self.forward if mode.load > 0 else self.backward) / ratio
        fin_inertia, moment = self._fin(y, way, around)
        bent = ratio * self.screw.bend(y[FIN]) * y[RATE] ** 2
        fin = (torque - inertia * bent - load_ratio * moment) / (inertia * ratio + load_ratio * fin_inertia)
        rotor = self._slipping_rotor(y, mode, around) if mode.slip else ratio * fin + bent
        return fin, rotor, fin_inertia * fin + moment

    def _slipping_rotor(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of the rotor while its clutch slips."""
        if mode.rotor == 0:
            return 0.0
        return (self._rotor(y, mode.rotor, around) - mode.slip * self.coil.limit(y)) / self.rotor_inertia

    def _locked_torque(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the torque [N.m] through a locked clutch while the screw turns."""
        _, acceleration, _ = self._moved(y, mode, around)
        return self._rotor(y, mode.rotor, around) - self.rotor_inertia * acceleration

    def _accelerations(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, float]:
        """Return the accelerations of fin and rotor [rad/s2]."""
        if mode.screw:
            return self._moved(y, mode, around)[:2]
        return 0.0, self._slipping_rotor(y, mode, around) if mode.slip else 0.0

    def acceleration(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration of the rotor [rad/s2]."""
        return self._accelerations(y, mode, around)[1]

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> list[float]:
        heat = mode.slip * self.coil.limit(y) * (y[ROTOR] - self.turning(y))
        electrical = self.electrical(self.motor(y, mode, around), mode.drive, around)
        return [y[RATE], *self._accelerations(y, mode, around), *electrical,
                *self.coil.slopes(y, mode, self.reference(around), around.supply), self.coil.warming(y, heat)]

    def _starts(self, y: StateVector, around: Surroundings) -> tuple[float, float, float, float]:
        """Return four limits [N.m] of the torque from rotor to screw.

        A resting screw starts forwards above the first and backwards below the second; a resting rotor starts backwards
        above the third and forwards below the fourth.
        """
        bounds = []
        for way in (1, -1):
            _, moment = self._fin(y, way, around)
            factor = self.forward if way * moment > 0.0 else self.backward
            bounds.append(math.inf * way if way * y[FIN] >= self.screw.stop else
                          factor * moment / self.screw.ratio(y[FIN]) - self._screw(y, way, around))
        return bounds[0], bounds[1], self._rotor(y, -1, around), self._rotor(y, 1, around)

    def _with_load(self, y: StateVector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode with the present direction of power; its sign does not depend on e."""
        driving = mode.screw * self._moved(y, mode, around)[2] if mode.screw else 0.0
        return mode._replace(load=sign(driving)) if abs(driving) > _KEPT else mode

    def settled(self, y: StateVector, mode: Mode, around: Surroundings) -> Any:
        """Return the mode in which clutch, screw and rotor that do not slide in `mode` stick if they can."""
        screw, rotor, slip = mode[:3]
        up, down, most, least = self._starts(y, around)
        limit = self.coil.limit(y)
        if slip == 0:
            way = screw or (1 if least > up else -1 if most < down else 0)
            locked_mode = self._with_load(y, mode._replace(screw=way, rotor=way), around)
            if way:
                torque = self._locked_torque(y, locked_mode, around)
            else:
                low, high = max(least, down), min(most, up)
                torque = low if low > 0.0 else min(high, 0.0)
            if abs(torque) <= limit:
                return locked_mode
            slip = sign(torque)
        clutch_torque = slip * limit
        screw = screw or (1 if clutch_torque > up else -1 if clutch_torque < down else 0)
        rotor = rotor or (1 if clutch_torque < least else -1 if clutch_torque > most else 0)
        return self._with_load(y, mode._replace(screw=screw, rotor=rotor, slip=slip), around)

    def admit(self, y: StateVector, mode: Mode, around: Surroundings) -> Any:
        return super().admit(y, self.coil.admit(y, mode, self.reference(around), around.supply), around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        return [*(self._moving_events(mode, around) if mode.screw else self._rest_events(mode, around)),
                *(self._slip_events(mode, around) if mode.slip else ()),
                *self.coil.events(mode, self.reference(around), around.supply), *super().events(mode, around)]

    def _rest_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that start a resting screw, and its rotor if the clutch is locked."""
        if mode.slip:
            return [Event(lambda y: self._starts(y, around)[0] - mode.slip * self.coil.limit(y), {"screw": 1}),
                    Event(lambda y: mode.slip * self.coil.limit(y) - self._starts(y, around)[1], {"screw": -1})]

        def starting(low: int | None, high: int | None, screw: int, rotor: int, slip: int) -> Event:
            def margin(y: StateVector) -> float:
                bounds, limit = self._starts(y, around), self.coil.limit(y)
                return (limit if high is None else bounds[high]) - (-limit if low is None else bounds[low])

            return Event(margin, {"screw": screw, "rotor": rotor, "slip": slip})

        # Both bodies rest while a torque within the limits of clutch (None) and `_starts` (index) keeps them at rest.
        # The lower and the upper limit of this torque that meet first determine which bodies start.
        return [starting(3, 0, 1, 1, 0), starting(1, 2, -1, -1, 0), starting(3, None, 0, 1, 1),
                starting(1, None, -1, 0, 1), starting(None, 2, 0, -1, -1), starting(None, 0, 1, 0, -1)]

    def _slip_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end the clutch's slip, and the rest or motion of its rotor."""
        meet = Event(lambda y: mode.slip * (y[ROTOR] - self.turning(y)),
                     {ROTOR: lambda y, _: self.turning(y), "rotor": mode.screw, "slip": 0})
        if not mode.rotor:
            return [meet,
                    Event(lambda y: self._starts(y, around)[2] - mode.slip * self.coil.limit(y), {"rotor": -1}),
                    Event(lambda y: mode.slip * self.coil.limit(y) - self._starts(y, around)[3], {"rotor": 1})]
        # With a resting screw the rotor stops as the slip ends.
        return [meet, Event(lambda y: mode.rotor * y[ROTOR], {ROTOR: 0.0, "rotor": 0})] if mode.screw else [meet]

    def _moving_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events of a turning screw."""
        way = mode.screw
        halted: Changes = {RATE: 0.0, "screw": 0, **({} if mode.slip else {ROTOR: 0.0, "rotor": 0})}
        struck: Changes = {FIN: way * self.screw.stop, RATE: 0.0, "screw": 0, "rotor": lambda y, _: sign(y[ROTOR]),
                           "slip": lambda y, _: sign(y[ROTOR])}
        events = [Event(lambda y: way * y[RATE], halted), Event(lambda y: self.screw.stop - way * y[FIN], struck),
                  Event(lambda y: mode.load * way * self._moved(y, mode, around)[2], {"load": -mode.load})]
        if mode.slip:
            return events
        return [*events, Event(lambda y: self.coil.limit(y) - self._locked_torque(y, mode, around), {"slip": 1}),
                Event(lambda y: self.coil.limit(y) + self._locked_torque(y, mode, around), {"slip": -1})]


simulate = SeriesClutch.simulate
