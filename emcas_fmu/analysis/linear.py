"""The actuator linearised at an operating point, as python-control systems.

Five blocks come from exact Jacobians of the model's own functions: motor with mechanics, current
controller, sensor, sampled controllers, and the fin angle. The plant between samples is solved by
matrix exponentials, cut where the delayed reference reaches the drive, and the DAC values on
their way to the drive are states: sampling and transport delay are exact, without a rational approximation
(Astroem & Wittenmark, "Computer-Controlled Systems", 3rd ed., section 2.6).

What is linearised: no limits, no Coulomb friction and no compensation of it, no quantisation; the
encoder's speed from the difference of two samples stays, where the encoder is on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees, pi
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from .. import control, sensors
from ..actuators import fin_port
from ..actuators.electromechanical import nonlinear
from ..errors import EmcasError
from ..ops.base import Value
from ..ops.floats import FLOATS
from ..ops.symbols import SymbolOps, jacobian
from ..physics import kinematics
from ..schedule import schedule
from . import wiring

Array = NDArray[Any]
System = Any
"""A control.StateSpace with named inputs and outputs."""
LOOPS = ("current", "velocity", "position", "reference")
_LINKS = (("reference", "dac"), ("motor_angle", "true_angle"), ("motor_speed", "true_speed"),
          ("measured_angle", "seen_angle"), ("measured_speed", "seen_speed"))
_BROKEN = {"velocity": ("measured_speed", "seen_speed"), "position": ("measured_angle", "seen_angle"),
           "reference": ("reference", "dac")}
# Signals a loop is broken without: the inner loop is judged with the outer one open.
_OPEN = {"velocity": ("measured_angle", "seen_angle")}


class _Fine(SymbolOps):
    """Symbols with encoder counts that are no whole numbers: the encoder without its quantisation."""

    @staticmethod
    def floor(x: Value) -> Value:
        return x


FINE = _Fine()


@dataclass(frozen=True)
class OperatingPoint:
    """A rest: fin [rad] and motor angle [rad], hinge moment [N.m], current [A], voltage [V], drive reference [V]."""

    fin_angle: float
    aero_torque: float
    motor_angle: float
    ratio: float
    current: float
    voltage: float
    reference: float


class LinearActuator:
    """The linearised actuator of flat parameter `values` in SI, at rest at `fin_angle` [rad] under `aero_torque` [N.m].

    ``motor`` and ``drive`` are continuous, ``plant`` (both, with the delay), ``sensor`` and
    ``controller`` sampled. Raises EmcasError where the actuator cannot rest there.
    """

    def __init__(self, values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0) -> None:
        limit = values["command.limit"]
        if not abs(fin_angle) <= limit * (1.0 + 1e-9):
            raise EmcasError(f"operating point {degrees(fin_angle):g} deg: no command reaches it; give an angle within "
                             f"±{degrees(limit):g} deg (command.limit)")
        # At the end of the range the command's limit has no slope; a linear model has no limits.
        self.values = {**values, "command.limit": 0.5 * pi, "compensation.gain": 0.0}
        self.p = p = nonlinear.ACTUATOR.namespace(self.values)
        self.period = float(p.controller.sample_time)
        self._force = fin_port.specific_force(FLOATS, p, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.point = self._rest(values, fin_angle, aero_torque)
        self.motor, self.drive = self._motor(), self._drive()
        self.sensor, self.controller = self._sensor(), self._controller()
        self.continuous = wire([self.drive, self.motor], [("demand", "voltage"), ("current", "sensed")],
                               ["dac", "aero_torque"], ["motor_angle", "motor_speed", "fin_angle"])
        plan = schedule(FLOATS, p, nonlinear.ACTUATOR)
        self.plant = sampled(self.continuous, self.period, int(plan.delay_samples), plan.arrival)

    def _rest(self, values: Mapping[str, Any], fin_angle: float, aero_torque: float) -> OperatingPoint:
        p = self.p
        angle = kinematics.motor_angle(FLOATS, p, fin_angle)
        ratio = kinematics.reduction_ratio(FLOATS, p, kinematics.lever_tangent(FLOATS, p, angle))

        def forces(current: Value, reference: Value, integral: Value) -> tuple[Value, ...]:
            change, demand = wiring.current_controller(FINE, p, integral, reference, current)
            return (*wiring.motor(FINE, p, self._force, angle, 0.0, current, demand, aero_torque)[1:], change)

        # Within the limits the balance is linear: one Newton step solves it. Without integral action xi stays 0.
        size = 3 if p.drive.ki > 0.0 else 2
        there, slopes = jacobian(forces, [0.0] * 3)
        balance = np.zeros(3)
        balance[:size] = np.linalg.solve(slopes[:size, :size], -there[:size])
        current, reference, integral = map(float, balance)
        _, voltage = wiring.current_controller(FLOATS, p, integral, reference, current)
        for name, needed, limit, unit in (
                ("drive.current_limit", current, p.drive.current_limit, "A"),
                ("drive.supply_voltage", voltage, values["drive.supply_voltage"], "V"),
                ("drive.reference_limit", reference, p.drive.reference_limit, "V")):
            if abs(needed) >= limit:
                raise EmcasError(f"operating point {degrees(fin_angle):g} deg under {aero_torque:g} N.m: holding it "
                                 f"takes {abs(needed):.4g} {unit}, {name} is {limit:g} {unit}; give a smaller torque")
        return OperatingPoint(fin_angle, aero_torque, angle, ratio, current, voltage, reference)

    def _motor(self) -> System:
        p, at = self.p, self.point

        def function(angle: Value, speed: Value, current: Value, voltage: Value, torque: Value) -> tuple[Value, ...]:
            change = wiring.motor(FINE, p, self._force, angle, speed, current, voltage, torque)
            return (*change, angle, speed, wiring.fin(FINE, p, angle), current)

        return block(function, [at.motor_angle, 0.0, at.current, at.voltage, at.aero_torque], 3,
                     ["voltage", "aero_torque"], ["motor_angle", "motor_speed", "fin_angle", "current"])

    def _drive(self) -> System:
        def function(integral: Value, reference: Value, current: Value) -> tuple[Value, ...]:
            return wiring.current_controller(FINE, self.p, integral, reference, current)

        return block(function, [0.0, self.point.reference, self.point.current], 1, ["dac", "sensed"], ["demand"])

    def _sensor(self) -> System:
        def function(counts: Value, angle: Value, speed: Value) -> tuple[Value, ...]:
            seen = sensors.measure(FINE, self.p, angle, speed, counts)
            return seen.counts, seen.motor_angle, seen.motor_speed

        angle = self.point.motor_angle
        before = sensors.counts(FINE, self.p, angle) if self.p.encoder.enabled else 0.0
        return block(function, [float(before), angle, 0.0], 1, ["true_angle", "true_speed"],
                     ["measured_angle", "measured_speed"], self.period)

    def _controller(self) -> System:
        p, at = self.p, self.point

        def function(integral: Value, command: Value, angle: Value, speed: Value) -> tuple[Value, ...]:
            out = control.output(FINE, p, integral, sensors.Measurement(angle, speed, at.fin_angle, 0.0), command)
            return control.update(FINE, p, integral, out), out.reference

        return block(function, [0.0, at.fin_angle, at.motor_angle, 0.0], 1, ["command", "seen_angle", "seen_speed"],
                     ["reference"], self.period)

    @cached_property
    def closed(self) -> System:
        """Closed loop at the sample times: from ``command`` [rad] and ``aero_torque`` [N.m] to ``fin_angle`` [rad].

        A load is held between samples like a host's input over a communication step.
        """
        return wire([self.controller, self.plant, self.sensor], _LINKS, ["command", "aero_torque"], ["fin_angle"])

    @property
    def command_to_angle(self) -> System:
        """Fin angle over command [rad/rad]."""
        return channel(self.closed, 0)

    @property
    def load_to_angle(self) -> System:
        """Fin angle over hinge moment [rad/(N.m)]."""
        return channel(self.closed, 1)

    def loop(self, name: str) -> System:
        """Loop transfer function L (closed by 1 + L) of one of LOOPS, all the others in their places.

        ``current`` is broken at the drive's voltage, in continuous time, the outer loops open;
        ``velocity`` at the measured speed, the position loop open; ``position`` at the measured
        angle, the velocity loop closed; ``reference`` at the drive's reference u, where the gain and the delay
        of the hardware act on all that is fed back.
        """
        if name == "current":
            return -wire([self.drive, self.motor], [("current", "sensed")], ["voltage"], ["demand"])
        out, into = _BROKEN[name]
        links = [link for link in _LINKS if link not in (_BROKEN[name], _OPEN.get(name))]
        return -wire([self.controller, self.plant, self.sensor], links, [into], [out])

    @property
    def stable(self) -> bool:
        """Whether every mode of the closed loop decays."""
        return bool(np.max(np.abs(self.closed.poles())) < 1.0)

    def rational(self, order: int = 3) -> System:
        """A continuous rational approximation of `closed`, where a tool needs one.

        Padé of `order` for the transport delay and half a sample of hold; the controllers' integral
        as the differential equation it is the Euler step of, speed measured without lag. Nothing here
        is computed from it but the crosses in the root locus.
        """
        c, period = self.controller, self.period
        law = ct.ss((c.A - np.eye(len(c.A))) / period, c.B / period, c.C, c.D,
                    inputs=c.input_labels, outputs=c.output_labels)
        late = ct.ss(ct.tf(*ct.pade(self.p.drive.transport_delay + 0.5 * period, order)), inputs=["written"],
                     outputs=["arrived"])
        links = [("reference", "written"), ("arrived", "dac"), ("motor_angle", "seen_angle"),
                 ("motor_speed", "seen_speed")]
        return wire([law, late, self.continuous], links, ["command", "aero_torque"], ["fin_angle"])


def block(function: Callable[..., Sequence[Value]], point: Sequence[float], states: int, inputs: Sequence[str],
          outputs: Sequence[str], period: float = 0.0) -> System:
    """A system from a function of states and inputs to changes (or next states) and outputs, linearised at a point.

    Continuous without a sample `period` [s]. States that nothing moves, such as the integral of a
    controller without integral action, are left out: they are no modes of the system.
    """
    _, slopes = jacobian(function, point)
    a, b, c, d = slopes[:states, :states], slopes[:states, states:], slopes[states:, :states], slopes[states:, states:]
    still = np.eye(states) if period else np.zeros((states, states))
    moving = np.any(a != still, axis=1) | np.any(b != 0.0, axis=1)
    return ct.ss(a[np.ix_(moving, moving)], b[moving], c[:, moving], d, period, inputs=list(inputs),
                 outputs=list(outputs))


def wire(blocks: Sequence[System], links: Sequence[tuple[str, str]], inputs: Sequence[str],
         outputs: Sequence[str]) -> System:
    """Blocks of one time base connected from output to input by name, with the inputs and outputs chosen."""
    whole = ct.append(*blocks)
    ins = [label for one in blocks for label in one.input_labels]
    outs = [label for one in blocks for label in one.output_labels]
    connection = np.zeros((len(ins), len(outs)))
    for out, into in links:
        connection[ins.index(into), outs.index(out)] = 1.0
    closed = whole.feedback(connection, 1)
    columns, rows = [ins.index(name) for name in inputs], [outs.index(name) for name in outputs]
    return ct.ss(closed.A, closed.B[:, columns], closed.C[rows], closed.D[np.ix_(rows, columns)], whole.dt,
                 inputs=list(inputs), outputs=list(outputs))


def channel(system: System, number: int) -> System:
    """The single-input system of one input."""
    return ct.ss(system.A, system.B[:, [number]], system.C, system.D[:, [number]], system.dt,
                 inputs=[system.input_labels[number]], outputs=system.output_labels)


def sampled(plant: System, period: float, whole: int, rest: float) -> System:
    """The plant at the sample times; its first input is delayed by `whole` periods and `rest` [s], the second held.

    The state is the plant's, then the values on their way, the newest first.
    """
    n, waiting = len(plant.A), whole + (rest > 0.0)
    joined = np.block([[plant.A, plant.B], [np.zeros((2, n + 2))]])
    before, after = expm(joined * rest), expm(joined * (period - rest))
    free = after[:n, :n] @ before[:n, :n]
    held = after[:n, :n] @ before[:n, n:] + after[:n, n:]
    newer, older = after[:n, n], after[:n, :n] @ before[:n, n]
    a, b = np.zeros((n + waiting, n + waiting)), np.zeros((n + waiting, 2))
    a[:n, :n], b[:n, 1] = free, held[:, 1]
    if rest > 0.0:
        a[:n, n + whole] = older
    if whole:
        a[:n, n + whole - 1] = newer
    else:
        b[:n, 0] = newer
    if waiting:
        b[n, 0] = 1.0
        a[n + 1:, n:-1] = np.eye(waiting - 1)
    c = np.hstack([plant.C, np.zeros((len(plant.C), waiting))])
    return ct.ss(a, b, c, plant.D, period, inputs=plant.input_labels, outputs=plant.output_labels)
