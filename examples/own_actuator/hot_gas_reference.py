"""The hot-gas actuator integrated by SciPy from event to event, with equations that are written again."""

import math
from typing import NamedTuple

from emcas_fmu.reference.actuator import ReferenceActuator
from emcas_fmu.reference.events import Accuracy, Body, switch
from emcas_fmu.reference.vehicle import clip, hinge_moment, masses_of, surroundings

FIN, RATE, ONE, TWO, SPOOL = range(5)


class Mode(NamedTuple):
    """Direction of the fin, 0 at rest; `up` if the spool is on the side of chamber 1."""

    fin: int = 0
    up: bool = False


class HotGas(ReferenceActuator):
    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1e6, 1e6, 1.0), 1e-4)
    names = ("fin_angle", "fin_rate", "pressure_1", "pressure_2")
    supply = ("supply_pressure", "gas_supply.pressure")

    def __init__(self, parameters):
        self.p = p = parameters
        self.masses, self.swept = masses_of(p), p["cylinder.area"] * p["rack.radius"]
        self.inertia = sum(p[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
        self.bodies = Body("fin", lambda y: y[RATE], self.excess, {RATE: 0.0}, FIN, p["fin.stop_angle"]),

    def start(self):
        pressure = 0.8 * self.p["gas_supply.pressure"]
        return [self.p["fin.start_angle"], 0.0, pressure, pressure, 0.0], Mode()

    def controller(self, nominal):
        p, period, state = nominal.p, nominal.p["controller.sample_time"], {"integral": 0.0}

        def sample(y, command, enable):
            error = clip(command, p["command.limit"]) - y[FIN]
            wanted = p["controller.kp"] * error + state["integral"] - p["controller.kd"] * (y[ONE] - y[TWO])
            if abs(wanted) <= 1.0:
                state["integral"] += period * p["controller.ki"] * error
            state["integral"] *= enable
            return clip(wanted, 1.0) * enable

        return sample

    def surroundings(self, row, reference):
        return surroundings(self.p, row, reference * row["enable"], self.supply[0])

    def outputs(self, y, around):
        return y[:SPOOL]

    def through(self, opening, before, behind):
        p, q = self.p, behind / before
        b, laminar = p["gas.critical_ratio"], p["gas.laminar_ratio"]
        choked = math.sqrt(1.0 - ((min(max(q, b), laminar) - b) / (1.0 - b)) ** 2)
        return p["valve.conductance"] * opening * before * choked * min(1.0, (1.0 - q) / (1.0 - laminar))

    def moment(self, y, around):
        return self.swept * (y[ONE] - y[TWO]) + hinge_moment(self.masses, self.inertia, y[FIN], around)

    def excess(self, y, mode, around, side):
        return side * self.moment(y, around) - self.p["friction.fin"]

    def slope(self, y, mode, around):
        p, exhaust = self.p, self.p["exhaust.pressure"]
        up, down = (p["valve.clearance"] + (y[SPOOL] if mode.up else 0.0),
                    p["valve.clearance"] - (0.0 if mode.up else y[SPOOL]))
        into_1 = self.through(up, around.supply, y[ONE]) - self.through(down, y[ONE], exhaust)
        into_2 = self.through(down, around.supply, y[TWO]) - self.through(up, y[TWO], exhaust)
        rates = [p["gas.exponent"] * (p["gas.energy"] * into - way * pressure * self.swept * y[RATE])
                 / (p["cylinder.volume"] + way * self.swept * y[FIN])
                 for way, pressure, into in ((1.0, y[ONE], into_1), (-1.0, y[TWO], into_2))]
        fin = (self.moment(y, around) - mode.fin * p["friction.fin"]) / self.inertia
        return y[RATE], fin * (mode.fin != 0), *rates, (around.reference - y[SPOOL]) / p["valve.time_constant"]

    def events(self, mode, around):
        return [*super().events(mode, around), switch(mode, "up", lambda y: y[SPOOL])]


simulate = HotGas.simulate
