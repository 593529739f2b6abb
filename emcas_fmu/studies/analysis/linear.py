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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees, nan
from typing import Any

import casadi as ca
import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, matrix_balance, null_space

from ...actuators import NONLINEAR, capabilities, get, parts, require
from ...actuators.declaration import identifier
from ...control import command as bus
from ...errors import EmcasError
from ...namespace import Record
from ...ops.base import Value
from ...ops.floats import FLOATS
from ...ops.symbols import SymbolOps, linearised
from ...parameters import ParameterSet
from ...physics import kinematics, loads
from ...runtime.schedule import schedule

Array = NDArray[Any]
System = Any
"""A control.StateSpace with named inputs and outputs."""
LOOPS = {"current": capabilities.CURRENT_LOOP, "velocity": capabilities.CASCADE, "position": capabilities.CASCADE,
         "reference": capabilities.POSITION_LOOP}
"""Loops by name, with what an actuator needs to have them."""
_ONE_DEGREE = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 0.0}
_LAID_ASIDE = ("homing", "faults")
_OUTPUTS = ("fin_angle", "motor_angle", "motor_current", "motor_voltage")
_PORTS = (("command", "aero_torque"), ("fin_angle", "reference"))
# The controllers' command is the one on the bus; its latency is a block of its own, in no loop.
_AT_ONCE = {"command.latency": 0.0, "command.resolution": 0.0, "command.update_time": 0.0}
_ITERATIONS = 30
_REST = 1e-6  # of what the reference does to the states: more is no rest
# Of 1, a sample: poles are off by 1e-14 at most, and a mode that decays more slowly takes 1e10 samples, months.
ROUNDING = 1e-10
# Of the balanced system: rounding leaves 1e-15 of a hidden mode, and the weakest mode of shipped actuators has 7e-6.
_HIDDEN = 1e-12
_FAST = 0.5  # a mode that is gone after some samples changes no figure, and is hard to tell from a hidden one


class _Fine(SymbolOps):
    """Symbols without quantisation and limits: counts are no whole numbers, and nothing that moves is clipped."""

    @staticmethod
    def floor(x: Value) -> Value:
        return x

    @staticmethod
    def clip(x: Value, low: Value, high: Value) -> Value:
        moves = isinstance(x, ca.SX) and not x.is_constant()
        return x if moves else SymbolOps.clip(x, low, high)


FINE = _Fine()


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
        self._late = int(bus.late(FLOATS, actuator.namespace(values)))
        self.values = {**values, "compensation.gain": 0.0, **_AT_ONCE}
        self.p = p = actuator.namespace(self.values)
        self.period = float(p.controller.sample_time)
        self.loops = tuple(name for name, need in LOOPS.items() if need in actuator.provides)
        self._at, self.model = (fin_angle, aero_torque), model
        self._start = {name: float(value) for name, value in actuator.start(FINE, p, fin_angle).items()}
        self._states = [s.name for s in actuator.states]
        self._sampled = [s.name for s in actuator.sampled_states]
        self.continuous = self._linear_plant()
        self.controller = self._linear_controllers()
        plan = schedule(FLOATS, p, actuator)
        self.plant = sampled(self.continuous, self.period, int(plan.delay_samples), plan.arrival)

    def _acting(self, reference: Value, aero_torque: Value, sampled_states: Sequence[Value]) -> Record:
        """Return what acts on the plant; inputs that are not named are at their start values."""
        p, actuator, at = self.p, self.actuator, self._at[0]
        return Record(
            reference=reference, **vars(loads.level(FLOATS, p, aero_torque)), supply=self._supply, enabled=True,
            rated_current_limit=None, command=at, sampled_reference=reference, measured_fin_angle=at, limited=0.0,
            **{identifier(v.name): self._started(v) for v in actuator.acting_inputs},
            **dict(zip(self._sampled, sampled_states, strict=True)))

    def _started(self, variable: Any) -> Any:
        return self.values[variable.key] if variable.key else variable.start or 0.0

    @property
    def _supply(self) -> Any:
        return self._started(self.actuator.supply.input) if self.actuator.supply else 0.0

    def _linear_plant(self) -> System:
        """Return the plant at the rest, which is solved for on the way."""
        p, actuator, states = self.p, self.actuator, self._states
        fin_angle, aero_torque = self._at
        count = len(states)

        def function(*arguments: Value) -> list[Value]:
            x = Record(**dict(zip(states, arguments, strict=False)))
            u = self._acting(arguments[count], arguments[count + 1], arguments[count + 2:])
            outputs = actuator.output_values(FINE, p, x, u)
            return [*actuator.rates(FINE, p, x, u).values(), *(outputs.get(name, nan) for name in _OUTPUTS)]

        held = [self._start[name] for name in self._sampled]
        at = linearised(function, count + 2 + len(held))
        begin = np.array([self._start[name] for name in states])
        # States that stand still, such as an integral without a gain, are no modes; those that move alike are one.
        rows = [tuple(row) for row in at([*begin, 0.0, aero_torque, *held])[1][:count]]
        groups = {row: [i for i, other in enumerate(rows) if other == row] for row in rows if any(row)}
        spread = np.array([[float(i in group) for group in groups.values()] for i in range(count)])
        used = [group[0] for group in groups.values()]
        size, fin = len(used), count + _OUTPUTS.index("fin_angle")

        def balance(unknown: Array) -> tuple[Array, Array]:
            values, slopes = at([*(begin + spread @ unknown[:size]), unknown[size], aero_torque, *held])
            rows = [*used, fin]
            return (values[rows] - np.append(np.zeros(size), fin_angle),
                    np.column_stack([slopes[rows, :count] @ spread, slopes[rows, count]]))

        solution = _solve(balance, np.zeros(size + 1))
        reference = float(solution[size])
        self.rest = begin + spread @ solution[:size]
        residual, slopes = balance(solution)
        scale = np.max(np.abs(slopes[:size, size])) * max(abs(reference), 1.0)
        values, slopes = at([*self.rest, reference, aero_torque, *held])
        self.point = self._resting(reference, *values[count + 1:])
        x = Record(**dict(zip(states, map(float, self.rest), strict=True)))
        limited = actuator.rates(FLOATS, p, x, self._acting(reference, aero_torque, held)).values()
        if not max(np.max(np.abs(residual)), *map(abs, limited)) <= _REST * scale:
            raise EmcasError(f"{self._where} no reference within the drive's limits holds it; give a smaller torque")
        self._voltage = slopes[count + _OUTPUTS.index("motor_voltage"), :count] @ spread
        inputs = ["reference", "aero_torque", *self._sampled]
        c = np.vstack([spread, slopes[fin, :count] @ spread])
        return ct.ss(slopes[used, :count] @ spread, slopes[used, count:], c, np.zeros((count + 1, len(inputs))),
                     inputs=inputs, outputs=[*map(_measured, states), "fin_angle"], states=[states[i] for i in used])

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
            built = self.actuator.plant(self.values)
            tangent = kinematics.lever_tangent(FLOATS, built, kinematics.motor_angle(FLOATS, built, fin_angle))
            ratio = float(kinematics.reduction_ratio(FLOATS, built, tangent))
        return OperatingPoint(fin_angle, aero_torque, reference, motor, ratio, current, voltage)

    def _linear_controllers(self) -> System:
        """Return the sampled controllers from the plant's states and the command to the reference."""
        p, actuator = self.p, self.actuator
        names = [*(s.name for s in actuator.controller_states), *self._sampled]
        count = len(names)
        held = {"supply": self._supply, "enable": True, "encoder_offset": None,
                **{identifier(v.name): self._started(v) for v in actuator.further_inputs}}

        def function(*arguments: Value) -> list[Value]:
            *values, command = arguments
            state = Record(**dict(zip((*names, *self._states), values, strict=True)))
            inputs = Record(command=command, position=actuator.position(FINE, p, state), **held)
            after = actuator.commanded(FINE, p, state, inputs)
            return [after[name] for name in (*names, "reference", "measured_fin_angle", *self._sampled)]

        at = linearised(function, count + len(self._states) + 1)
        still = np.append(np.eye(count), np.zeros((1, count)), axis=0)

        start = [self._start[name] for name in names]
        # The command that the controllers take for the fin's angle: what they know of the plant may be wrong.
        x = Record(**dict(zip((*names, *self._states), (*start, *map(float, self.rest)), strict=True)))
        at_rest = Record(command=self._at[0], position=actuator.position(FINE, p, x), **held)
        command = float(actuator.sampled(FINE, p, x, at_rest)["measured_fin_angle"])

        def balance(state: Array) -> tuple[Array, Array]:
            values, slopes = at([*state, *self.rest, command])
            return (values[:count + 1] - np.append(state, self.point.reference), slopes[:count + 1, :count] - still)

        _, slopes = at([*_solve(balance, np.array(start)), *self.rest, command])
        a, b, c, d = slopes[:count, :count], slopes[:count, count:], slopes[count:, :count], slopes[count:, count:]
        return moving(a, b, c, d, self.period, [*map(_measured, self._states), "command"],
                      ["reference", "measured_angle", *self._sampled])

    @cached_property
    def _links(self) -> list[tuple[str, str]]:
        return [(name, name) for name in ("reference", *self._sampled, *map(_measured, self._states))]

    @cached_property
    def _shown(self) -> tuple[System, Array]:
        blocks, links, (inputs, outputs) = [self.controller, self.plant], self._links, _PORTS
        if self._late:
            blocks, links = [waiting(self._late, self.period), *blocks], [("arrived", "command"), *links]
            inputs = ("sent", "aero_torque")
        return shown(wire(blocks, links, inputs, outputs))

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
        if any(self.values.get(parameter, value) != value for parameter, value in _ONE_DEGREE.items()):
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
        return decays(self.closed)

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


def waiting(samples: int, period: float) -> System:
    """Return a delay of whole samples, from ``sent`` to ``arrived``."""
    return ct.ss(np.eye(samples, k=-1), np.eye(samples, 1), np.eye(1, samples, k=samples - 1), 0.0, period,
                 inputs=["sent"], outputs=["arrived"])


def _measured(state: str) -> str:
    """Return the label of a state at the samples; an output may have the same name as a state."""
    return f"x_{state}"


def _solve(equations: Callable[[Array], tuple[Array, Array]], guess: Array) -> Array:
    """Return what solves equations, given with their Jacobian, by Newton's method; least squares where they are not
    independent. One in which no unknown acts is left as it is: it may have a residual of rounding."""
    for _ in range(_ITERATIONS):
        values, slopes = equations(guess)
        rows = np.max(np.abs(slopes), axis=1, initial=0.0)
        rows[rows == 0.0] = 1.0
        change = np.linalg.lstsq(slopes / rows[:, None], -values / rows, rcond=None)[0]
        guess = guess + change
        if np.all(np.abs(change) <= 1e-13 * (1.0 + np.abs(guess))):
            break
    return guess


def wire(blocks: Sequence[System], links: Sequence[tuple[str, str]], inputs: Sequence[str],
         outputs: Sequence[str]) -> System:
    """Connect blocks of one time base from output to input by name; return the system from `inputs` to `outputs`."""
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


def moving(a: Array, b: Array, c: Array, d: Array, period: float, inputs: Sequence[str],
           outputs: Sequence[str]) -> System:
    """Return a sampled system without the states that never change, such as an integral without a gain."""
    moves = np.any(a != np.eye(len(a)), axis=1) | np.any(b != 0.0, axis=1)
    return ct.ss(a[np.ix_(moves, moves)], b[moves], c[:, moves], d, period, inputs=inputs, outputs=outputs)


def cleared(value: float, rounding: float) -> float:
    """Return the value, 0 where it is no larger than rounding."""
    return 0.0 if abs(value) <= rounding else value


def largest_pole(system: System) -> float:
    """Return the largest magnitude of a sampled system's poles."""
    return float(np.max(np.abs(system.poles()), initial=0.0))


def decays(system: System) -> bool:
    """Return whether every mode of a sampled system decays, by more than rounding makes of a pole at 1."""
    return largest_pole(system) < 1.0 - ROUNDING


def shown(system: System) -> tuple[System, Array]:
    """Return a system, with as many inputs as outputs, without its hidden modes, and their poles.

    Hidden is a mode that no input reaches or no output shows, by the Popov-Belevitch-Hautus test on the system scaled
    (Kailath, "Linear Systems", section 2.4). Sampled ones that are fast stay, and a system without others is returned
    as it is.
    """
    count, sampled = len(system.A), bool(system.dt)
    joined = np.block([[system.A, system.B], [system.C, np.eye(system.noutputs)]])
    balanced, (scale, _) = matrix_balance(joined, permute=False, separate=True)
    a, b, c = balanced[:count, :count], _even(balanced[:count, count:].T).T, _even(balanced[count:, :count])
    least, basis, hidden = _HIDDEN * np.linalg.norm(a, 2), np.eye(count), []
    poles = list(np.linalg.eigvals(a))
    while poles:
        pole = poles.pop()
        if pole.imag < 0.0 or (sampled and abs(pole) < _FAST):
            continue
        shifted = a - pole * np.eye(len(a))
        for pencil in (np.vstack([shifted, c]), np.vstack([shifted.T, b.T])):
            _, sizes, modes = np.linalg.svd(pencil)
            if sizes[-1] <= least:
                mode = modes[-1].conj()
                others = null_space(np.vstack([mode.real, mode.imag]), rcond=1e-6)
                hidden += [pole, pole.conjugate()][:len(a) - others.shape[1]]
                a, b, c, basis = others.T @ a @ others, others.T @ b, c @ others, basis @ others
                poles = list(np.linalg.eigvals(a))
                break
    if not hidden:
        return system, np.array([])
    into = scale[:count, None] * basis
    back = basis.T / scale[:count]
    return ct.ss(a, back @ system.B, system.C @ into, system.D, system.dt,
                 inputs=system.input_labels, outputs=system.output_labels), np.array(hidden)


def _even(rows: Array) -> Array:
    """Return rows of length 1, or of zeros."""
    lengths: Array = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.maximum(lengths, 1e-300)


def sampled(plant: System, period: float, whole: int, rest: float) -> System:
    """Return the plant at the sample times, its first input delayed by `whole` periods and `rest` [s], the others held.

    The state is the plant's, then the values on their way, the newest first.
    """
    n, ins, waiting = len(plant.A), plant.ninputs, whole + (rest > 0.0)
    joined = np.block([[plant.A, plant.B], [np.zeros((ins, n + ins))]])
    before, after = expm(joined * rest), expm(joined * (period - rest))
    free = after[:n, :n] @ before[:n, :n]
    held = after[:n, :n] @ before[:n, n:] + after[:n, n:]
    line = np.zeros((n, whole + 2))  # how values of the first input act, by the samples since
    line[:, whole], line[:, whole + 1] = after[:n, n], after[:n, :n] @ before[:n, n]
    a = np.block([[free, line[:, 1:1 + waiting]], [np.zeros((waiting, n)), np.eye(waiting, k=-1)]])
    b = np.block([[line[:, :1], held[:, 1:]], [np.eye(waiting, 1), np.zeros((waiting, ins - 1))]])
    c = np.hstack([plant.C, np.zeros((len(plant.C), waiting))])
    return ct.ss(a, b, c, plant.D, period, inputs=plant.input_labels, outputs=plant.output_labels)
