"""Integration of the dual clutch actuator from event to event.

Coordinates are the fin's angle and rate and the motor's speed. A `Mode` contains the direction of sliding
of each dry friction, 0 if it sticks, and the modes of both coils' amplifiers and of the motor's diode. The motor must
keep turning: a run in which it comes to rest raises ValueError. Controllers, bus, lever, loads and friction are those
of the thesis's actuator (:mod:`.screw`).
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any, NamedTuple

from .actuator import ReferenceActuator, Sample
from .coil import Coil
from .controllers import Controllers
from .events import Accuracy, Body, Changes, Event, StateVector, switch
from .screw import Screw
from .vehicle import Surroundings, sign

FIN, RATE, MOTOR, COIL_1, COIL_2, FLUX_1, FLUX_2, TEMPERATURE = range(8)
TURNS = (1.0, -1.0)  # turns of the screw per turn of the motor through each clutch


class Mode(NamedTuple):
    """Directions of sliding of screw and clutches, 0 if they stick; modes of both coils' amplifiers; True while the
    motor consumes current."""

    screw: int = 0
    slip_1: int = 1
    slip_2: int = -1
    coil_1: int = 0
    coil_2: int = 0
    feeds: bool = True

    @property
    def slip(self) -> tuple[int, int]:
        """Directions of sliding of both clutches."""
        return self.slip_1, self.slip_2


class Clutches(ReferenceActuator):
    """Motor, both clutches, screw and fin."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 10.0, 0.1, 0.1, 0.1, 0.1, 10.0), 5e-4)
    names = ("fin_angle", "fin_rate", "motor_speed", "coil_current_1", "coil_current_2", "clutch_temperature",
             "drive_reference")

    def __init__(self, parameters: Mapping[str, float]):
        p = self.p = parameters
        self.coils = [Coil(p, "drive.kp", f"clutch.share_{k + 1}", f"coil_{k + 1}", COIL_1 + k, FLUX_1 + k, TEMPERATURE)
                      for k in (0, 1)]
        per_ampere = p["clutch.rated_torque"] * (1.0 - p["clutch.residual"]) / p["clutch.rated_current"]
        # Lever, screw, fin and loads of the thesis's actuator, with the driven halves in place of its rotor.
        self.screw = Screw({**p, "inertia.motor": p["clutch.driven_inertia"], "motor.torque_constant": per_ampere})
        self.rotor = p["inertia.motor"] + p["clutch.driving_inertia"]
        # At rest the screw cannot stick to the turning motor.
        rest: Changes = {RATE: 0.0, "slip_1": lambda y, _: sign(self.slips(y)[0]) or 1,
                "slip_2": lambda y, _: sign(self.slips(y)[1]) or -1}
        self.bodies = (Body("screw", itemgetter(RATE), self._excess, rest, FIN, self.screw.stop),
                       self._clutch(0), self._clutch(1))

    def _clutch(self, k: int) -> Body:
        """Return clutch `k` as a body that slides against the motor."""
        return Body(f"slip_{k + 1}", lambda y: self.slips(y)[k],
                    lambda y, mode, around, side: side * self.locked(y, mode, k, around)[2] - self.coils[k].limit(y),
                    {MOTOR: lambda y, _: TURNS[k] * self.screw.ratio(y[FIN]) * y[RATE]})

    def start(self) -> tuple[StateVector, Mode]:
        p, bias = self.p, self.p["clutch.bias_current"]
        return ([p["fin.start_angle"], 0.0, p["motor.start_speed"], bias, bias, bias, bias, p["friction.temperature"]],
                Mode())

    def controller(self, nominal: Clutches) -> Sample:
        """Return the thesis's controllers, which read the difference of the coils' currents as motor current."""
        loops = Controllers(self.screw, nominal.screw)
        return lambda y, command, enable: loops.sample(y[FIN], y[RATE], command, enable, y[COIL_1] - y[COIL_2])

    def outputs(self, y: StateVector, _around: Surroundings) -> tuple[float, ...]:
        return *y[:FLUX_1], y[TEMPERATURE]

    def slips(self, y: StateVector) -> tuple[float, float]:
        """Return the sliding speeds [rad/s] of both clutches: speed of the driving half minus speed of the screw."""
        speed = self.screw.ratio(y[FIN]) * y[RATE]
        return y[MOTOR] - speed, -y[MOTOR] - speed

    def references(self, around: Surroundings) -> tuple[float, float]:
        """Return the current references [A] of both coils."""
        if not around.enable:
            return 0.0, 0.0
        net, bias = around.reference, self.p["clutch.bias_current"]
        return self.p["coil.connected_1"] * (bias + max(net, 0.0)), bias + max(-net, 0.0)

    def surplus(self, y: StateVector, around: Surroundings) -> float:
        """Return the supply voltage minus the motor's back-EMF [V]."""
        return around.supply - self.p["motor.back_emf_constant"] * y[MOTOR]

    def _loads(self, y: StateVector, mode: Mode, around: Surroundings, without: int = -1) -> tuple[float, float]:
        """Return the moment on the fin and the torque on the motor [N.m].

        The clutch with index `without` and the friction of a resting screw are omitted.
        """
        p, s, (delta, rate, speed) = self.p, self.screw, y[:COIL_1]
        ratio = s.ratio(delta)
        fin = s.loads(delta, around) - s.motor_inertia * ratio * ratio * s.bend(delta) * rate * rate
        if mode.screw:
            fin -= (ratio * ratio * s.viscous[mode.screw] + s.fin_viscous) * rate
            fin -= mode.screw * s.coulomb(delta, mode.screw)
        motor = p["motor.torque_constant"] * self.surplus(y, around) / p["motor.resistance"] if mode.feeds else 0.0
        motor -= p["motor.viscous_friction"] * speed + p["motor.coulomb_friction"]
        for k, coil in enumerate(self.coils):
            if k != without:
                torque = mode.slip[k] * coil.limit(y)  # on the screw
                fin, motor = fin + ratio * torque, motor - TURNS[k] * torque
        return fin, motor

    def _inertia(self, ratio: float) -> float:
        return self.screw.fin_inertia + self.screw.motor_inertia * ratio**2

    def locked(self, y: StateVector, mode: Mode, k: int, around: Surroundings) -> tuple[float, float, float]:
        """Return the accelerations of fin and motor [rad/s2] with clutch `k` locked, and its torque [N.m]."""
        ratio, turn = self.screw.ratio(y[FIN]), TURNS[k]
        fin, motor = self._loads(y, mode, around, k)
        bent = ratio * self.screw.bend(y[FIN]) * y[RATE] ** 2
        fin_acceleration = ((fin + ratio * turn * motor - self.rotor * ratio * bent)
                            / (self._inertia(ratio) + self.rotor * ratio * ratio))
        screw_acceleration = ratio * fin_acceleration + bent
        return fin_acceleration, turn * screw_acceleration, turn * motor - self.rotor * screw_acceleration

    def _excess(self, y: StateVector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] about the hinge on a resting screw towards `side` beyond stiction."""
        return side * self._loads(y, mode, around)[0] - self.screw.coulomb(y[FIN], side)

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> list[float]:
        if 0 in mode.slip:
            fin_acceleration, acceleration, _ = self.locked(y, mode, mode.slip.index(0), around)
        else:
            fin, motor = self._loads(y, mode, around)
            fin_acceleration, acceleration = fin / self._inertia(self.screw.ratio(y[FIN])), motor / self.rotor
        heat = sum(coil.limit(y) * way * slip for coil, way, slip in zip(self.coils, mode.slip, self.slips(y),
                                                                         strict=True))
        (first, flux_1), (second, flux_2) = (coil.slopes(y, mode, reference, around.supply) for coil, reference
                                             in zip(self.coils, self.references(around), strict=True))
        return [y[RATE], fin_acceleration if mode.screw else 0.0, acceleration, first, second, flux_1, flux_2,
                self.coils[0].warming(y, heat)]

    def admit(self, y: StateVector, mode: Mode, around: Surroundings) -> Any:
        for coil, reference in zip(self.coils, self.references(around), strict=True):
            mode = coil.admit(y, mode, reference, around.supply)
        return super().admit(y, mode._replace(feeds=self.surplus(y, around) > 0.0), around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        def motor_rests(y: StateVector, _around: Surroundings) -> int:
            raise ValueError("the motor comes to rest; this reference requires inputs with which it keeps turning")

        coils = zip(self.coils, self.references(around), strict=True)
        return [Event(itemgetter(MOTOR), {MOTOR: motor_rests}), *super().events(mode, around),
                *(event for coil, reference in coils for event in coil.events(mode, reference, around.supply)),
                switch(mode, "feeds", lambda y: self.surplus(y, around))]


simulate = Clutches.simulate
