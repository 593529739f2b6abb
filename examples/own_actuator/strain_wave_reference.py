"""The strain-wave actuator integrated by SciPy from event to event, with equations that are written again."""

from typing import NamedTuple

from emcas_fmu.reference.actuator import ReferenceActuator
from emcas_fmu.reference.events import Accuracy, Body, band
from emcas_fmu.reference.vehicle import clip, hinge_moment, masses_of, surroundings

MOTOR, MOTOR_RATE, FIN, FIN_RATE, CURRENT = range(5)


class Mode(NamedTuple):
    """Directions of motor and fin, 0 at rest; sides on which the voltage is limited and the gear is stiff, or 0."""

    motor: int = 0
    fin: int = 0
    voltage: int = 0
    stiff: int = 0


class StrainWave(ReferenceActuator):
    accuracy = Accuracy(1e-10, (1.0, 100.0, 1e-2, 1.0, 10.0), 1e-3)
    names = ("fin_angle", "fin_rate", "motor_current", "windup")

    def __init__(self, parameters):
        self.p = p = parameters
        self.ratio, self.masses = p["gear.ratio"], masses_of(p)
        self.inertia = sum(p[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
        self.bodies = (
            Body("motor", lambda y: y[MOTOR_RATE], self.excess_of_motor, {MOTOR_RATE: 0.0}),
            Body("fin", lambda y: y[FIN_RATE], self.excess_of_fin, {FIN_RATE: 0.0}, FIN, p["fin.stop_angle"]))

    def start(self):
        angle = self.p["fin.start_angle"]
        return [self.ratio * angle, 0.0, angle, 0.0, 0.0], Mode()

    def controller(self, nominal):
        p, period, state = nominal.p, nominal.p["controller.sample_time"], {"integral": 0.0}

        def sample(y, command, enable):
            error = clip(command, p["command.limit"]) - y[MOTOR] / p["gear.ratio"]
            current = (p["controller.kp"] * error + state["integral"]
                       - p["controller.kd"] * y[MOTOR_RATE] / p["gear.ratio"])
            if abs(current) <= p["drive.current_limit"]:
                state["integral"] += period * p["controller.ki"] * error
            state["integral"] *= enable
            return clip(current, p["drive.current_limit"]) * enable

        return sample

    def surroundings(self, row, reference):
        return surroundings(self.p, row, reference, "supply_voltage")

    def outputs(self, y, around):
        return y[FIN], y[FIN_RATE], y[CURRENT], self.windup(y)

    def windup(self, y):
        return y[MOTOR] / self.ratio - y[FIN]

    def gear(self, y, stiff):
        p, a = self.p, self.windup(y)
        beyond = (p["gear.stiffness_loaded"] - p["gear.stiffness"]) * (a - stiff * p["gear.soft_windup"]) * abs(stiff)
        return p["gear.stiffness"] * a + beyond + p["gear.damping"] * (y[MOTOR_RATE] / self.ratio - y[FIN_RATE])

    def on_motor(self, y, stiff):
        return self.p["motor.torque_constant"] * y[CURRENT] - self.gear(y, stiff) / self.ratio

    def on_fin(self, y, stiff, around):
        return self.gear(y, stiff) + hinge_moment(self.masses, self.inertia, y[FIN], around)

    def excess_of_motor(self, y, mode, around, side):
        turning = self.p["inertia.motor"] * around.faster[1]
        return side * (self.on_motor(y, mode.stiff) - turning) - self.p["friction.motor"]

    def excess_of_fin(self, y, mode, around, side):
        return side * self.on_fin(y, mode.stiff, around) - self.p["friction.fin"]

    def demand(self, y, around):
        p = self.p
        demand = p["drive.kp"] * (around.reference - y[CURRENT]) + p["motor.back_emf_constant"] * y[MOTOR_RATE]
        return demand * around.enable

    def slope(self, y, mode, around):
        p = self.p
        voltage = mode.voltage * around.supply if mode.voltage else self.demand(y, around)
        motor = (self.on_motor(y, mode.stiff) - mode.motor * p["friction.motor"]) / p["inertia.motor"]
        fin = (self.on_fin(y, mode.stiff, around) - mode.fin * p["friction.fin"]) / self.inertia
        current = voltage - p["motor.resistance"] * y[CURRENT] - p["motor.back_emf_constant"] * y[MOTOR_RATE]
        return (y[MOTOR_RATE], (motor - around.faster[1]) * (mode.motor != 0), y[FIN_RATE], fin * (mode.fin != 0),
                current / p["motor.inductance"])

    def admit(self, y, mode, around):
        demand, limit = self.demand(y, around), around.supply
        return self.settled(y, mode._replace(voltage=(demand > limit) - (demand < -limit)), around)

    def events(self, mode, around):
        soft = self.p["gear.soft_windup"]
        return [*super().events(mode, around), *band(mode, "stiff", self.windup, -soft, soft),
                *band(mode, "voltage", lambda y: self.demand(y, around), -around.supply, around.supply)]


simulate = StrainWave.simulate
