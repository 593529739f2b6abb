"""The whole actuator in time: sampled controllers, delayed DAC and zero-order-held inputs around the plant.

Between two discrete instants (a sample, the arrival of a delayed DAC value, an input row) the plant
is integrated by SciPy's DOP853 with terminal events; at each instant the discrete parts act.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .plant import Guard, Mode, Plant, Surroundings, Value, Vector, clip, whole_samples

Array = NDArray[np.floating[Any]]

# Interface inputs and their start values, SI; a parameter drive.supply_voltage replaces that of the supply.
_AT_REST = ("fin_command", "aero_torque", "acceleration.x", "acceleration.y", "acceleration.z",
            "attitude.roll", "attitude.pitch", "attitude.yaw", "angular_rate.x", "angular_rate.y", "angular_rate.z",
            "angular_acceleration.x", "angular_acceleration.y", "angular_acceleration.z")
INPUTS = {**dict.fromkeys(_AT_REST, 0.0), "supply_voltage": 39.0, "enable": 1.0}
OUTPUTS = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "drive_reference")
RTOL = 1e-11
# Absolute tolerance = rtol * scale: a hundredth of a radian, and one rad/s, one ampere, one volt; again for a further
# angle and speed.
SCALES = np.array([1e-2, 1.0, 1.0, 1.0])
# Events are looked for at the ends of a step, so a step must be too short to hide two zeros of a guard:
# it stays below the time constant of the current loop, L/(R + Kp) = 0.11 ms, the fastest thing there is.
MAX_STEP = 1e-4  # s
DIGITS = 12  # decimals of a second to which instants are rounded so that coinciding ones are one


class Bus:
    """Commands from the host to the controllers: taken at every so many samples, rounded, and late."""

    def __init__(self, p: Mapping[str, float]):
        self.late, self.every = (whole_samples(p, f"command.{name}") for name in ("latency", "update_time"))
        self.resolution = p["command.resolution"]
        self.taken = [p["fin.start_angle"]] * self.late  # rad, the last one at the present sample
        self.count = 0

    def arrived(self, command: float) -> float:
        """Return the command [rad] that the controllers have at the next sample, as the host sends `command` [rad]."""
        if self.count % max(self.every, 1) == 0:
            if self.resolution:
                command = self.resolution * math.floor(command / self.resolution + 0.5)
            self.taken.append(command)
        else:
            self.taken.append(self.taken[-1])
        self.count += 1
        return self.taken[-1 - self.late]


class Controllers:
    """Encoder, position PI and velocity PI with friction compensation (section 4.2).

    `plant` is the unit as built, which the sensors see; what the controllers compute with is the `nominal` one.
    """

    def __init__(self, plant: Plant, nominal: Plant, delta: float):
        self.plant, self.nominal, self.p = plant, nominal, nominal.parameters
        self.period = self.p["controller.sample_time"]
        self.count_size = 2.0 * math.pi / (self.p["encoder.pulses"] * self.p["encoder.multiplier"])
        self.on_fin = bool(self.p["encoder.on_fin"])
        self.turns = self._turns(delta)
        self.update_samples = max(1, whole_samples(self.p, "command.update_time"))
        self._reset(*self._measure(delta, 0.0), delta)

    def _reset(self, fin: float, motor: float, speed: float, command: float) -> None:
        """Put the loops at rest at measured angles [rad] of fin and motor, at a motor speed [rad/s] without load.

        The lagged target is that of the `command` [rad].
        """
        weight = self.p["controller.position.setpoint_weight"]
        self.integral = self.p["controller.position.kp"] * motor * (1.0 - weight)  # rad/s
        self.velocity_integral = 0.0  # V
        self.target = self._target(command)  # rad, of the motor, lagged
        self.momentum = self._inertia(fin) * speed  # N.m.s, of the load observer

    def _target(self, command: float) -> float:
        """Return the motor angle [rad] that a command [rad] asks for."""
        return self.nominal.motor_angle(clip(command, self.p["command.limit"]))

    def _inertia(self, fin: float) -> float:
        """Return inertia at the motor [kg.m2] as the controllers know it."""
        return self.nominal.motor_inertia + self.nominal.fin_inertia / self.nominal.ratio(fin) ** 2

    def _turns(self, delta: float) -> int:
        """Return counts of the motor's encoder at fin angle `delta` [rad]."""
        return math.floor(self.plant.motor_angle(delta) / self.count_size)

    def _measure(self, delta: float, omega: float) -> tuple[float, float, float]:
        """Return measured fin angle [rad], motor angle [rad] and motor speed [rad/s]."""
        previous, self.turns = self.turns, self._turns(delta)
        if not self.p["encoder.enabled"]:
            motor = (self.nominal if self.on_fin else self.plant).motor_angle(delta)
            return self.nominal.fin_angle(motor), motor, self.plant.ratio(delta) * omega
        speed = (self.turns - previous) * self.count_size / self.period
        if self.on_fin:
            angle = math.floor(delta / self.count_size) * self.count_size
            return angle, self.nominal.motor_angle(angle), speed
        angle = self.turns * self.count_size
        return self.nominal.fin_angle(angle), angle, speed

    def sample(self, delta: float, omega: float, command: float, enable: bool, current: float = 0.0) -> float:
        """Return one sample: the DAC value u_k [V] from the true state, the command [rad] and the motor current [A]."""
        p = self.p
        fin, motor, speed = self._measure(delta, omega)
        if not enable:
            self._reset(fin, motor, speed, command)
            return 0.0
        target = self._target(command)
        weighted = p["controller.position.setpoint_weight"] * target - motor
        feedback = p["controller.position.kp"] * weighted + self.integral
        # The command's rate, behind a lag of the time between its updates.
        ahead = target - self.target
        moving = p["controller.position.velocity_feedforward"] * ahead / (self.update_samples * self.period)
        self.target += ahead / self.update_samples
        reference = clip(feedback + moving, p["controller.speed_limit"])
        friction = self.nominal.motor_coulomb(fin, 1 if reference > 0.0 else -1)
        compensation = p["compensation.gain"] * friction * clip(reference / p["compensation.speed_band"], 1.0)
        compensation /= p["motor.torque_constant"] * p["drive.current_gain"]
        gain = p["controller.velocity.kp"]
        u = gain * (reference - speed) + self.velocity_integral + compensation
        torque_constant, bandwidth = p["motor.torque_constant"], p["controller.load_observer"]
        if bandwidth:
            load = bandwidth * (self._inertia(fin) * speed - self.momentum)
            u -= load / (torque_constant * p["drive.current_gain"])
            fed_forward = compensation * torque_constant * p["drive.current_gain"]
            self.momentum += self.period * (torque_constant * current + load - fed_forward)
        # What of it the drive can follow: the DAC and the current have limits.
        limited = clip(u, p["drive.reference_limit"])
        offset, slope = p["drive.current_offset"], p["drive.current_gain"]
        possible = (clip(slope * limited + offset, p["drive.current_limit"]) - offset) / slope
        excess = possible - u  # V
        tracking = p["controller.drive_antiwindup"]  # 1/s
        integral_gain, velocity_integral_gain = p["controller.position.ki"], p["controller.velocity.ki"]
        if integral_gain:  # without integral action there is nothing to unwind
            self.integral += self.period * (
                integral_gain * (target - motor)
                + p["controller.antiwindup"] * (clip(feedback, p["controller.speed_limit"]) - feedback)
                + tracking * (excess / gain if gain else excess))
        if velocity_integral_gain:
            # Its tracking time is not below its integral time.
            integral_time = (gain or 1.0) / velocity_integral_gain  # s
            tracking = 1.0 / max(1.0 / tracking, integral_time) if tracking else 0.0
            self.velocity_integral += self.period * (velocity_integral_gain * (reference - speed) + tracking * excess)
        return limited


class Modes(Protocol):
    """What moves in modes: d/dt of its state in one of them, and the guards that end it."""

    def slope(self, state: Vector, mode: Any, around: Surroundings) -> Sequence[float]:
        """Return the time derivative of the state."""

    def guards(self, mode: Any, around: Surroundings) -> list[Guard]:
        """Return the events that end a mode."""


def advance(plant: Modes, state: list[float], mode: Any, around: Surroundings, start: float, end: float,
            how: Mapping[str, Any] | None = None) -> tuple[list[float], Any]:
    """Integrate from `start` to `end` [s] through every change of mode; return the state and mode at `end`.

    `how` gives rtol, atol and max_step of another state than the thesis's actuator has.
    """
    from scipy.integrate import solve_ivp  # would be a third of the start of every command

    how = how or {"rtol": RTOL, "atol": RTOL * np.resize(SCALES, len(state)), "max_step": MAX_STEP}
    time, events_without_progress = start, 0
    while time < end:
        guards = plant.guards(mode, around)
        run = solve_ivp(lambda _t, y, mode=mode: plant.slope(y.tolist(), mode, around), (time, end), state,
                        method="DOP853", events=guards, **how)
        if run.status < 0:
            raise ArithmeticError(f"integration failed after {time} s in {mode}: {run.message}")
        state = [float(x) for x in run.y[:, -1]]
        reached = float(run.t[-1])
        if run.status == 1:  # all guards are terminal, so exactly one has fired: the first
            fired = next(guard for guard, times in zip(guards, run.t_events, strict=True) if times.size)
            mode = fired.successor(state)
        events_without_progress = 0 if reached > time else events_without_progress + 1
        if events_without_progress > 10:
            raise ArithmeticError(f"modes chatter at {time} s in {mode}")
        time = reached
    return state, mode


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array], kind: type[Plant] = Plant
             ) -> dict[str, Array]:
    """Simulate one actuator from rest and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` holds the uniform row times `time` [s], from zero, and the columns that are used, named as in the
    interface; a row holds until the next.  Outputs are left limits, so a sample that falls on a row shows after it.
    `kind` is what moves the fin.
    """
    columns = columns_of(inputs, electric_starts(parameters))
    if round(float(inputs["time"][0]), DIGITS) != 0.0:
        raise ValueError("row times must start at 0")
    if min(columns["supply_voltage"]) <= 0.0:
        raise ValueError("supply_voltage must be above 0: the modes of the drive are distinguished by its limits")

    nominal = kind(parameters)
    plant, p = nominal.as_built(), nominal.parameters
    instants, row_at, sample_at, arrival_at = schedule(inputs["time"], p)
    state = plant.start(p["fin.start_angle"])
    controllers, bus = Controllers(plant, nominal, state[0]), Bus(p)
    row = {name: column[0] for name, column in columns.items()}
    dac: list[float] = []
    active = 0.0  # V, the DAC value that has reached the drive
    around, mode = plant.surroundings(row, active), Mode(0, 0)
    records = []
    for t, following in zip(instants, [*instants[1:], None], strict=True):
        if t in row_at:
            records.append((t, *plant.fin(state), state[2], plant.voltage(state, around), dac[-1] if dac else 0.0))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            command = bus.arrived(row["fin_command"])
            dac.append(controllers.sample(state[0], state[1], command, bool(row["enable"]), state[2]))
        if t in arrival_at:
            active = dac[arrival_at[t]]
        around = plant.surroundings(row, active)
        mode = plant.admit(state, mode, around)
        state, mode = advance(plant, state, mode, around, t, following)
    return dict(zip(("time", *OUTPUTS), np.array(records).T, strict=True))


class Schedule(NamedTuple):
    """The instants [s] of a run; by their times the numbers of rows, of samples, and of samples that arrive."""

    instants: list[float]
    rows: dict[float, int]
    samples: dict[float, int]
    arrivals: dict[float, int]


def schedule(time: Any, p: Mapping[str, Any]) -> Schedule:
    """Return what happens when, of a run with rows at `time` [s]; instants that coincide are one."""
    period, rows = p["controller.sample_time"], np.round(np.asarray(time, dtype=float), DIGITS)
    samples = np.arange(math.floor(rows[-1] / period) + 1) * period
    each = [rows, *(np.round(samples + late, DIGITS) for late in (0.0, p["drive.transport_delay"]))]
    instants = np.unique(np.concatenate(each))
    return Schedule(instants[instants <= rows[-1]].tolist(),
                    *({t: k for k, t in enumerate(times.tolist())} for times in each))


def electric_starts(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Return the start values of the inputs of an actuator on a bus."""
    return {**INPUTS, "supply_voltage": float(parameters.get("drive.supply_voltage", INPUTS["supply_voltage"]))}


def columns_of(inputs: Mapping[str, Any], starts: Mapping[str, float]) -> dict[str, list[float]]:
    """Return every input at the rows, its start value where it is not given. Raises ValueError for one there is not."""
    if unknown := sorted(set(inputs) - set(starts) - {"time"}):
        raise ValueError(f"unknown inputs {unknown}")
    shape = np.shape(inputs["time"])
    return {name: np.broadcast_to(inputs.get(name, start), shape).tolist() for name, start in starts.items()}
