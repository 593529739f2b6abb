"""An actuator with a sampled position loop, linearised at an operating point, as python-control systems.

Two blocks come from exact Jacobians of what the actuator declares: the plant from `derivatives` and the fin angle
among `output_values`, the sampled controllers with their encoder from `sample`. The plant between samples is solved
by matrix exponentials, cut where the delayed reference reaches the drive, and the references on their way to it are
states: sampling and transport delay are exact, without a rational approximation (Astroem & Wittenmark,
"Computer-Controlled Systems", 3rd ed., section 2.6).

What is linearised: no limits, no dry friction and no compensation of it, no gaps, no quantisation of the encoder or the
command, which is taken at every sample; its latency stays, and so does the encoder's speed from the difference of two
samples, where the encoder is on. Of extensions, heat gives the motor its temperatures
at the start; faults and homing are laid aside, and friction's and the screw's have nothing that is smooth at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees, nan
from typing import Any

import control as ct
import numpy as np

from ...actuators import NONLINEAR, capabilities, get, parts, require
from ...control import command as bus
from ...errors import EmcasError
from ...namespace import Record, with_values
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import kinematics
from ...runtime.schedule import schedule
from .plant import linear_plant, solve
from .smooth import Equations, gains_of, traced
from .systems import Array, System, cleared, decays, measured, moving, shown, waiting, wire

LOOPS = {"current": capabilities.CURRENT_LOOP, "velocity": capabilities.CASCADE, "position": capabilities.CASCADE,
         "reference": capabilities.POSITION_LOOP}
"""Loops by name, with what an actuator needs to have them."""
_ONE_DEGREE = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 0.0}
_LAID_ASIDE = ("homing", "faults")
_PORTS = (("command", "aero_torque"), ("fin_angle", "reference"))
# The controllers' command is the one on the bus; its latency is a block of its own, in no loop.
_AT_ONCE = {"command.latency": 0.0, "command.resolution": 0.0, "command.update_time": 0.0}
_REST = 1e-6  # of what the reference does to the states: more is no rest


@dataclass(frozen=True)
class OperatingPoint:
    """A rest: fin angle [rad], hinge moment [N.m], reference [V of a drive]; motor angle [rad], ratio R [1], current
    [A] and voltage [V], nan of an actuator that has none."""

    fin_angle: float
    aero_torque: float
    reference: float
    motor_angle: float
    ratio: float
    current: float
    voltage: float


def sound(parameters: ParameterSet) -> ParameterSet:
    """Return a set as that of the sound, homed actuator: without faults and homing.

    Raises EmcasError for an actuator that linear analysis cannot take.
    """
    actuator, extensions = parts(parameters.model)
    model = "+".join((actuator, *(each for each in extensions if each not in _LAID_ASIDE)))
    require(parameters.model, "emcas analyse", capabilities.POSITION_LOOP, actuator=get(model))
    names = {v.name for v in get(model).file_entries}
    return ParameterSet(tuple(e for e in parameters.entries if e.variable.name in names), model)


class LinearActuator:
    """The linearised actuator of flat parameter `values` in SI, at rest at `fin_angle` [rad] under `aero_torque` [N.m].

    ``continuous`` is its plant, ``plant`` that at the samples with the delay, ``controller`` the sampled controllers;
    ``rest`` are the plant's states there, ``loops`` those of LOOPS that it has. Sampled states stay as at the start
    while the rest is solved for. Raises EmcasError where the actuator cannot rest there.
    """

    def __init__(self, values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR) -> None:
        self.actuator = actuator = get(model)
        if actuator.derivatives is None:
            raise EmcasError(f"--model {model}: linear analysis takes an actuator's derivatives; {actuator.name} "
                             "declares a step alone, give it both")
        limit = values["command.limit"]
        if not abs(fin_angle) <= limit * (1.0 + 1e-9):
            raise EmcasError(f"operating point {degrees(fin_angle):g} deg: no command reaches it; give an angle within "
                             f"±{degrees(limit):g} deg (command.limit)")
        given = actuator.namespace(values)
        self._late = int(bus.late(FLOATS, given))
        left_out = {"compensation.gain": 0.0, **_AT_ONCE}
        self.values, self.p = {**values, **left_out}, with_values(given, left_out)
        self.period = float(given.controller.sample_time)
        self.loops = tuple(name for name, need in LOOPS.items() if need in actuator.provides)
        self._at, self.model = (fin_angle, aero_torque), model
        self._equations = Equations(actuator, self.values, self.p, fin_angle)
        gains = gains_of(actuator, self.values)
        fixed = tuple((name, value) for name, value in self.values.items() if name not in gains)
        self._traced, self._gains = traced(model, fixed, tuple(gains), fin_angle), tuple(gains.values())
        self._linearise_plant()
        self.controller = self._linear_controllers()

    def _linearise_plant(self) -> None:
        """Solve for the rest, and take the plant there, anew only where gains change it."""
        equations, (fin_angle, aero_torque) = self._equations, self._at
        start, count = self._traced.start(self._gains).tolist(), len(equations.states)
        self._kept = start[count:]
        held = self._kept[len(self._kept) - len(equations.sampled):]
        too_much = EmcasError(f"{self._where} no reference within the drive's limits holds it; give a smaller torque")
        try:
            plant = linear_plant(self._traced, tuple(start[:count]), tuple(held),
                                 self._gains if self._traced.plant_varies else (1.0,) * len(self._gains),
                                 fin_angle, aero_torque)
        except ArithmeticError as error:
            raise too_much from error
        self.rest, self.continuous, self._voltage = plant.states, plant.continuous, plant.voltage
        self.point = self._resting(plant.reference, *plant.outputs[1:])
        x = Record(**dict(zip(equations.states, map(float, self.rest), strict=True)))
        limited = self.actuator.rates(FLOATS, self.p, x, equations.acting(plant.reference, aero_torque, held)).values()
        if not max(plant.residual, *map(abs, limited)) <= _REST * plant.scale:
            raise too_much
        plan = schedule(FLOATS, self.p, self.actuator)
        self.plant = plant.sampled(self.period, int(plan.delay_samples), float(plan.arrival))

    @property
    def _where(self) -> str:
        return f"operating point {degrees(self._at[0]):g} deg under {self._at[1]:g} N.m:"

    def _resting(self, *solved: float) -> OperatingPoint:
        """Return the operating point. Raises EmcasError where a limit keeps the actuator from it."""
        provides, (fin_angle, aero_torque) = self.actuator.provides, self._at
        reference, motor, current, voltage = (cleared(float(x), 1e-12) for x in solved)
        for capability, name, needed, unit in (
                (capabilities.CURRENT_LIMIT, "drive.current_limit", current, "A"),
                (capabilities.VOLTAGE_LIMIT, "drive.supply_voltage", voltage, "V"),
                (capabilities.REFERENCE_LIMIT, "drive.reference_limit", reference, "V")):
            if capability in provides and abs(needed) >= (limit := self.values[name]):
                raise EmcasError(f"{self._where} holding it takes {abs(needed):.4g} {unit}, {name} is {limit:g} "
                                 f"{unit}; give a smaller torque")
        ratio = nan
        if capabilities.SCREW_DRIVE in provides:
            built = self.actuator.plant_parameters(FLOATS, self.p)
            tangent = kinematics.lever_tangent(FLOATS, built, kinematics.motor_angle(FLOATS, built, fin_angle))
            ratio = float(kinematics.reduction_ratio(FLOATS, built, tangent))
        return OperatingPoint(fin_angle, aero_torque, reference, motor, ratio, current, voltage)

    def _linear_controllers(self) -> System:
        """Return the sampled controllers from the plant's states and the command to the reference."""
        names, count, rest = self._traced.states, len(self._kept), self.rest
        still = np.append(np.eye(count), np.zeros((1, count)), axis=0)

        def at(kept: Array, command: float) -> tuple[Array, Array]:
            return self._traced.controllers([*kept, *rest, command], self._gains)

        start = np.array(self._kept)
        # The command that the controllers take for the fin's angle: what they know of the plant may be wrong.
        command = float(at(start, self._at[0])[0][count + 1])

        def balance(state: Array) -> tuple[Array, Array]:
            values, slopes = at(state, command)
            return (values[:count + 1] - np.append(state, self.point.reference), slopes[:count + 1, :count] - still)

        _, slopes = at(solve(balance, start), command)
        a, b, c, d = slopes[:count, :count], slopes[:count, count:], slopes[count:, :count], slopes[count:, count:]
        return moving(a, b, c, d, self.period, [*map(measured, names), "command"],
                      ["reference", "measured_angle", *self._traced.sampled])

    @cached_property
    def _links(self) -> list[tuple[str, str]]:
        return [(name, name) for name in ("reference", *self._traced.sampled, *map(measured, self._traced.states))]

    @cached_property
    def _whole(self) -> System:
        blocks, links, (inputs, outputs) = [self.controller, self.plant], self._links, _PORTS
        if self._late:
            blocks, links = [waiting(self._late, self.period), *blocks], [("arrived", "command"), *links]
            inputs = ("sent", "aero_torque")
        return wire(blocks, links, inputs, outputs)

    @cached_property
    def _shown(self) -> tuple[System, Array]:
        return shown(self._whole)

    @property
    def closed(self) -> System:
        """Closed loop at the sample times: from ``command`` [rad] and ``aero_torque`` [N.m] to ``fin_angle`` [rad].

        A load is held between samples like a host's input over a communication step. Modes in `hidden` are not in it.
        """
        return self._shown[0][:1, :]

    @property
    def hidden(self) -> Array:
        """Poles of the modes that command and load do not reach, or that fin angle and reference do not show."""
        return self._shown[1]

    @property
    def command_to_angle(self) -> System:
        """Fin angle over command [rad/rad]."""
        return self.closed[:, 0]

    @property
    def load_to_angle(self) -> System:
        """Fin angle over hinge moment [rad/(N.m)]."""
        return self.closed[:, 1]

    def loop(self, name: str) -> System:
        """Return loop transfer function L (closed by 1 + L) of one of `loops`, all the others in their places.

        ``current`` is broken at the drive's voltage, in continuous time, the outer loops open; ``velocity`` at the
        measured speed, the position loop open; ``position`` at the measured angle, the velocity loop closed;
        ``reference`` at the drive's reference u, where the gain and the delay of the hardware act on all that is fed
        back. The command's latency is in none of them. With one degree of freedom, which changes no loop, loops in
        cascade see command and measured angle by their difference: a command of the measured angle opens the position
        loop, and with it open the velocity loop is all that passes the reference.
        """
        if name == "current":
            return self._current_loop()
        commanded = name != "reference"
        if commanded and any(self.values.get(parameter, value) != value for parameter, value in _ONE_DEGREE.items()):
            return LinearActuator({**self.values, **_ONE_DEGREE}, *self._at, self.model).loop(name)
        blocks, opened = [self.controller, self.plant], [*self._links, ("measured_angle", "command")]
        if name == "position":
            return wire(blocks, opened, ["command"], ["measured_angle"])
        return -wire(blocks, (opened if name == "velocity" else self._links)[1:], ["reference"], ["reference"])

    def _current_loop(self) -> System:
        plant = self.continuous
        into = np.zeros((len(plant.A), 1))
        into[plant.state_labels.index("motor_current")] = 1.0 / self.p.motor.inductance
        demand = self._voltage[None, :]
        return -ct.ss(plant.A - into @ demand, into, demand, [[0.0]], inputs=["voltage"], outputs=["demand"])

    @property
    def reference_name(self) -> str:
        """What the reference is called: a drive's, in V, or of another actuator, such as a valve's opening."""
        drive = any(v.name == "drive_reference" for v in self.actuator.outputs)
        return "the drive's reference" if drive else "the reference"

    @property
    def stable(self) -> bool:
        """Whether every mode of the closed loop decays."""
        return decays(self._whole) or decays(self.closed)  # hidden modes may not, and take time to be looked for

    def rational(self, order: int = 3) -> System:
        """Return a continuous rational approximation of `closed`, where a tool needs one.

        Padé of `order` for the transport delay and half a sample of hold; the controllers' states by the differential
        equations they are the Euler steps of, speed measured without lag. Nothing here is computed from it but the
        crosses in the root locus.
        """
        lagless = self
        if capabilities.ENCODER in self.actuator.provides:
            lagless = LinearActuator({**self.values, "encoder.enabled": False}, *self._at, self.model)
        c, period = lagless.controller, self.period
        law = ct.ss((c.A - np.eye(len(c.A))) / period, c.B / period, c.C, c.D,
                    inputs=c.input_labels, outputs=c.output_labels)
        transport = self.actuator.transport_delay
        delay = 0.5 * period + (transport(FLOATS, self.p) if transport else 0.0)
        late = ct.ss(ct.tf(*ct.pade(delay, order)), inputs=["sent"], outputs=["received"])
        links = [("reference", "sent"), ("received", "reference"), *self._links[1:]]
        return shown(wire([law, late, self.continuous], links, *_PORTS))[0][:1, :]
