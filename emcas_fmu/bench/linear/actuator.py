"""An actuator with a sampled position loop, linearised at an operating point, as python-control systems.

Two blocks are exact Jacobians of the actuator's declaration: the plant, from `derivatives` and the fin angle among
`output_values`, and the sampled controllers with their encoder, from `sample`. Matrix exponentials solve the plant
within a sample, before and after the delayed reference reaches the drive; the delayed references are states. Sampling
and transport delay are therefore exact, without a rational approximation (Astroem & Wittenmark, "Computer-Controlled
Systems", 3rd ed., chapter 2).

In the linear model, a limit acts if it does at the operating point, and gaps are closed; quantisation, dry friction and
its compensation are left out. The command is read at every sample. The model includes the command's latency and, with
the encoder enabled, the speed from the difference of two samples. The extension heat sets the motor's temperatures at
the start; faults and homing are left out; those of dry friction and of the screw's losses have no effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees, nan
from typing import Any

import control as ct
import numpy as np

from ...actuators import NONLINEAR, capabilities, get, get_extension, parts, require
from ...control import command_bus
from ...errors import EmcasError
from ...namespace import with_values
from ...ops.floats import FLOATS
from ...ops.symbols import Linearised
from ...parameters import ParameterSet
from ...physics import kinematics
from ...runtime.schedule import schedule
from .equations import LEFT_OUT, plain
from .plant import LinearPlant, UnsmoothError, linear_plant, solve
from .smooth import gains_of, traced
from .systems import Array, System, cleared, decays, delay_line, measured, moving, reaches, shown, wire

LOOPS = {"current": (capabilities.CURRENT_LOOP, capabilities.DRIVE_STEP), "velocity": (capabilities.CASCADE,),
         "position": (capabilities.CASCADE,), "reference": (capabilities.POSITION_LOOP,)}
"""Loops by name, with the capabilities that each needs."""
# One degree of freedom: the cascade depends only on the difference of command and measured angle.
_ONE_DEGREE = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 0.0}
_PORTS = (("command", "aero_torque"), ("fin_angle", "reference"))
_MOST_GROWTH = 100.0  # natural logarithm of the largest growth of a mode within a sample
_CONTROLLERS = ("the controllers do not react to a small deviation at rest (a dead band, switch or gain of 0 in "
                "`sample`)")
_PLANT = "the fin does not react to a small reference at rest (a dead band, switch or reached limit in `derivatives`)"


class NotLinearError(EmcasError):
    """An actuator has no linear model at rest."""


@dataclass(frozen=True)
class OperatingPoint:
    """An equilibrium of the actuator.

    The fields are fin angle [rad], hinge moment [N.m], reference [V for a drive], motor angle [rad], reduction ratio
    R [1], current [A] and voltage [V]. The last four are nan for an actuator without them.
    """

    fin_angle: float
    aero_torque: float
    reference: float
    motor_angle: float
    ratio: float
    current: float
    voltage: float


def sound(parameters: ParameterSet) -> ParameterSet:
    """Return the parameters of the actuator without the extensions homing and faults.

    Raises EmcasError for an actuator without a sampled position loop.
    """
    model = plain(parameters.model)
    require(parameters.model, "emcas analyse", capabilities.POSITION_LOOP, actuator=get(model))
    names = {v.name for v in get(model).file_entries}
    return ParameterSet(tuple(e for e in parameters.entries if e.variable.name in names), model)


def obstacle(parameters: ParameterSet) -> str:
    """Return the reason why an actuator with a sampled position loop has no margins at 0; otherwise empty."""
    plain_set = sound(parameters)
    try:
        return LinearActuator(plain_set.values, model=plain_set.model).idle
    except NotLinearError as error:
        return str(error)
    except (EmcasError, ArithmeticError):  # its margins have no value
        return ""


class LinearActuator:
    """The actuator linearised at rest at `fin_angle` [rad] under `aero_torque` [N.m].

    `values` are the flat parameters. ``continuous`` is the plant, ``plant`` the plant at the samples with the delay,
    ``controller`` the sampled controllers. ``rest`` are the plant's states at rest, ``loops`` the names of its LOOPS.
    Sampled states keep their start values while the states at rest are computed. Raises EmcasError if the actuator
    cannot rest there, or if it has no linear model.
    """

    def __init__(self, values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR) -> None:
        self.actuator = actuator = get(model)
        if actuator.derivatives is None:
            raise NotLinearError(f"model {model}: linear analysis needs derivatives; {actuator.name} declares "
                                 "a step only; declare derivatives as well")
        limit = values["command.limit"]
        if not abs(fin_angle) <= limit * (1.0 + 1e-9):
            raise EmcasError(f"operating point {degrees(fin_angle):g} deg: no command reaches it; use an angle within "
                             f"±{degrees(limit):g} deg (command.limit)")
        p = actuator.namespace(values)
        self._latency = int(command_bus.latency(FLOATS, p))
        self.values, self.p = {**values, **LEFT_OUT}, with_values(p, LEFT_OUT)
        self.period = float(p.controller.sample_time)
        self.loops = tuple(name for name, needs in LOOPS.items() if actuator.provides.issuperset(needs))
        self._at, self.model = (fin_angle, aero_torque), model
        gains = gains_of(actuator, self.values)
        fixed = tuple((name, value) for name, value in self.values.items() if name not in gains)
        self._traced, self._gains = traced(model, fixed, tuple(gains), fin_angle), tuple(gains.values())
        self._linearise_plant()
        self.controller = self._linear_controllers()

    def _linearise_plant(self) -> None:
        """Compute the states at rest and linearise the plant there.

        Actuators that differ only in gains without effect on the plant share the result.
        """
        start, count = self._traced.start(self._gains).tolist(), len(self._traced.states)
        self._kept = start[count:]
        plant = self._plant_at_rest((*start[:count], 0.0))
        self.rest, self.continuous, self._voltage = plant.states, plant.continuous, plant.voltage
        self.point = self._operating_point(plant)
        plan = schedule(FLOATS, self.p, self.actuator)
        if np.max(plant.continuous.poles().real, initial=0.0) * self.period > _MOST_GROWTH:
            raise EmcasError(f"{self._where} a mode of the plant grows beyond all numbers within a sample; check the "
                             "signs in `derivatives`")
        self.plant = plant.sampled(self.period, int(plan.delay_samples), float(plan.arrival))

    def _plant_at_rest(self, begin: tuple[float, ...]) -> LinearPlant:
        """Return the plant at rest; the search begins at the states and reference `begin`.

        Raises EmcasError if it cannot rest.
        """
        plant = self._rest(self._traced.plant, begin)
        if plant and not plant.moves and not self._exceeded(plant):
            return plant
        # Without limits, the plant rests beyond a limit, which the message names, or near its rest within the limits.
        free = self._rest(self._traced.unlimited, begin)
        if free and not free.moves:
            if exceeded := self._exceeded(free):
                raise EmcasError(f"{self._where} holding it needs {exceeded}; use a smaller torque")
            plant = self._rest(self._traced.plant, (*free.states, free.reference))
            if plant and not plant.moves:
                return plant
        elif free and not self._moves(free.continuous):
            raise NotLinearError(self._not_reacting(_PLANT))
        moves = f" ({plant.moves} does not become 0)" if plant else ""
        raise EmcasError(f"{self._where} no reference within the drive's limits holds it{moves}; use a smaller torque")

    def _rest(self, equations: Linearised, begin: tuple[float, ...]) -> LinearPlant | None:
        """Return the plant at rest; None if values are not finite in the search, which starts at `begin`.

        Raises EmcasError for equations without a finite value or slope.
        """
        held = tuple(self._kept[len(self._kept) - len(self._traced.sampled):])
        gains = self._gains if self._traced.plant_varies else (1.0,) * len(self._gains)
        try:
            return linear_plant(equations, self._traced.states, self._traced.sampled, begin, held, gains, *self._at)
        except UnsmoothError as error:
            raise EmcasError(f"{self._where} {error}; make `derivatives` smooth there") from error
        except ArithmeticError:
            return None

    @property
    def _where(self) -> str:
        return f"operating point {degrees(self._at[0]):g} deg under {self._at[1]:g} N.m:"

    def _exceeded(self, plant: LinearPlant) -> str:
        """Return in words the limit that the plant at rest reaches; empty if it reaches none."""
        needs = {"drive.current_limit": (capabilities.CURRENT_LIMIT, plant.outputs[2], "A"),
                 "drive.supply_voltage": (capabilities.VOLTAGE_LIMIT, plant.outputs[3], "V"),
                 "drive.reference_limit": (capabilities.REFERENCE_LIMIT, plant.reference, "V")}
        return next((f"{abs(needed):.4g} {unit}, {name} is {self.values[name]:g} {unit}"
                     for name, (capability, needed, unit) in needs.items()
                     if capability in self.actuator.provides and abs(needed) >= self.values[name]), "")

    def _operating_point(self, plant: LinearPlant) -> OperatingPoint:
        """Return the operating point; values within rounding of 0 are 0."""
        (fin_angle, aero_torque), provides = self._at, self.actuator.provides
        reference, motor, current, voltage = (
            cleared(float(x), 1e-12) for x in (plant.reference, *plant.outputs[1:]))
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
            values, slopes = self._traced.controllers([*kept, *rest, command], self._gains)
            if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
                raise EmcasError(f"{self._where} the controllers have no finite value or slope, as a root of 0 has "
                                 "none; make `sample` smooth there")
            return values, slopes

        start = np.array(self._kept)
        # The command that holds the fin angle; it differs from this angle if the plant's parameters deviate.
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
        if self._latency:
            blocks, links = [delay_line(self._latency, self.period), *blocks], [("arrived", "command"), *links]
            inputs = ("sent", "aero_torque")
        return wire(blocks, links, inputs, outputs)

    @cached_property
    def _shown(self) -> tuple[System, Array]:
        return shown(self._whole)

    @property
    def closed(self) -> System:
        """Closed loop at the sample times: from command [rad] and ``aero_torque`` [N.m] to ``fin_angle`` [rad].

        The command is the input ``command``, or ``sent`` with a latency. A load is held between samples like a host's
        input over a communication step. Modes in `hidden` are left out.
        """
        return self._shown[0][:1, :]

    @property
    def hidden(self) -> Array:
        """Poles z of the modes that command and load do not control, or that angle and reference do not show."""
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
        """Return the loop transfer function L (closed by 1 + L) of one of `loops`.

        ``current`` is opened at the drive's voltage, in continuous time, with the outer loops open; ``velocity`` at the
        measured speed, with the position loop open; ``position`` at the measured angle, with the velocity loop closed;
        ``reference`` at the drive's reference u, where gain and delay of the hardware act on all feedback. The
        command's latency is in no loop.

        The cascade is evaluated with setpoint weight 1, without feedforward and trajectory generator, which changes no
        loop. It then depends on the difference of command and measured angle only: a command equal to the measured
        angle opens the position loop.
        """
        if name == "current":
            return self._current_loop()
        switches = (get_extension(extension).command_switch for extension in parts(self.model)[1])
        others = {parameter: value for parameter, value in {**_ONE_DEGREE, **dict.fromkeys(switches, 0.0)}.items()
                  if self.values.get(parameter, value) != value}
        if others and name != "reference":
            return LinearActuator({**self.values, **others}, *self._at, self.model).loop(name)
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
        """The name of the reference in sentences; for an actuator without a drive it may be a valve's opening."""
        drive = any(v.name == "drive_reference" for v in self.actuator.outputs)
        return "the drive's reference" if drive else "the reference"

    @property
    def idle(self) -> str:
        """The reason why the fin does not react to a small change of the command; empty if it does."""
        if not reaches(self.controller, ["command"], self._acting):
            return self._not_reacting(_CONTROLLERS)
        return "" if self._moves(self.continuous) else self._not_reacting(_PLANT)

    @property
    def _acting(self) -> list[str]:
        return ["reference", *self._traced.sampled]

    def _moves(self, plant: System) -> bool:
        return reaches(plant, self._acting, ["fin_angle"])

    def _not_reacting(self, what: str) -> str:
        return (f"{self._where} {what}: linear figures are not available; see its responses (emcas report), or set the "
                "dead band to 0")

    @property
    def stable(self) -> bool:
        """Whether every mode of the closed loop that is not in `hidden` decays."""
        return decays(self._whole) or decays(self.closed)  # hidden modes need not decay; finding them is slow

    def rational(self, order: int = 3) -> System:
        """Return a continuous rational approximation of `closed`, for tools that need one.

        A Padé approximation of `order` replaces the transport delay and half a sample of hold. The controllers become
        the differential equations that they solve by Euler steps, with the speed measured without lag.
        """
        lagless = self
        if capabilities.ENCODER in self.actuator.provides:
            lagless = LinearActuator({**self.values, "encoder.enabled": False}, *self._at, self.model)
        c, period = lagless.controller, self.period
        law = ct.ss((c.A - np.eye(len(c.A))) / period, c.B / period, c.C, c.D,
                    inputs=c.input_labels, outputs=c.output_labels)
        transport = self.actuator.transport_delay
        delay = 0.5 * period + (transport(FLOATS, self.p) if transport else 0.0)
        hardware = ct.ss(ct.tf(*ct.pade(delay, order)), inputs=["sent"], outputs=["received"])
        links = [("reference", "sent"), ("received", "reference"), *self._links[1:]]
        return shown(wire([law, hardware, self.continuous], links, *_PORTS))[0][:1, :]
