"""The electrohydrostatic actuator integrated by SciPy with located events: sampled loop, delay and held inputs.

It takes nothing of the package but the tools of the other reference; the plant is in
:mod:`emcas_fmu.reference.electrohydrostatic_plant`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .electrohydrostatic_plant import FIN, INTEGRAL, SPEED, Mode, Plant
from .piston import PistonLoop
from .plant import Value, clip
from .simulate import Array, Bus, columns_of, electric_starts, schedule

OUTPUTS = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "motor_speed", "motor_current", "motor_voltage",
           "drive_reference")
RTOL = 1e-10
SCALES = np.array([1e-2, 1.0, 1e5, 1e5, 1.0, 1.0, 1.0])  # of the absolute tolerances
MAX_STEP = 5e-5  # s; two zeros of a guard closer than that are missed, and the fastest mode has 0.11 ms
_MOST_STALLS = 20


class Loop(PistonLoop):
    """PI on the piston that the fin's transducer stands for, P on the motor's speed, Coulomb friction fed forward."""

    def friction(self, piston: float) -> float:
        """Return the Coulomb friction [N.m] that moving fin, piston and pump without load take of the motor."""
        p = self.p
        arm = p["kinematics.moment_arm"]
        tangent = piston / arm + math.tan(p["kinematics.initial_angle"])
        force = p["cylinder.coulomb_friction"] + p["friction.fin_coulomb"] / (arm * (1.0 + tangent * tangent))
        drop = force / p["cylinder.area"]
        return p["pump.coulomb_friction"] + (p["pump.displacement"] + p["pump.pressure_friction"]) * drop

    def sample(self, angle: float, speed: float, command: float, enable: bool) -> float:
        """Return the drive's reference [V] of one sample."""
        p, read = self.p, self.read(angle)
        if not enable:
            self.reset(read)
            return 0.0
        target = self.piston(clip(command, p["command.limit"]))
        turns = p["cylinder.area"] / p["pump.displacement"]  # of the motor, for the piston's travel
        fastest = p["controller.speed_limit"] / turns
        asked = (p["controller.position.kp"] * (p["controller.position.setpoint_weight"] * target - read)
                 + self.integral)
        gain, offset = p["drive.current_gain"], p["drive.current_offset"]
        wanted = turns * clip(asked, fastest)
        torque = p["compensation.gain"] * self.friction(read) * clip(wanted / p["compensation.speed_band"], 1.0)
        raw = p["controller.velocity.kp"] * (wanted - speed) + torque / (p["motor.torque_constant"] * gain)
        sent = clip(raw, p["drive.reference_limit"])
        possible = (clip(gain * sent + offset, p["drive.current_limit"]) - offset) / gain
        change = p["controller.sample_time"] * p["controller.position.ki"] * (target - read)
        beyond_speed = abs(asked) > fastest and asked * change > 0.0
        beyond_drive = abs(raw - possible) > 1e-9 and (raw - possible) * change > 0.0
        if beyond_speed or beyond_drive:
            self.hold(read)
        else:
            self.integral += change
        self.before = read
        return sent


def as_built(p: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of the plant, which differ from those the loop knows."""
    off = {name.removeprefix("deviation."): value for name, value in p.items() if name.startswith("deviation.")}
    shares = {"kinematics.moment_arm": "kinematics.moment_arm", "mass.fin": "mass.fin", "inertia.fin": "mass.fin",
              "motor.torque_constant": "motor.torque_constant", "motor.back_emf_constant": "motor.torque_constant",
              "friction.fin_coulomb": "friction.coulomb", "cylinder.coulomb_friction": "friction.coulomb",
              "pump.coulomb_friction": "friction.coulomb", "pump.pressure_friction": "friction.coulomb",
              "friction.fin_viscous": "friction.viscous", "cylinder.viscous_friction": "friction.viscous",
              "pump.viscous_friction": "friction.viscous"}
    built = {name: p[name] * (1.0 + off[share]) for name, share in shares.items()}
    return {**p, **built, "kinematics.initial_angle": p["kinematics.initial_angle"] + off["kinematics.initial_angle"]}


def advance(plant: Plant, y: list[float], mode: Mode, start: float, end: float) -> tuple[list[float], Mode]:
    """Return state and mode at `end` [s] from those at `start`. Raises ArithmeticError where modes chatter."""
    from scipy.integrate import solve_ivp

    time, stalls = start, 0
    while time < end:
        guards = plant.guards(mode)
        run = solve_ivp(lambda _t, x, mode=mode: plant.slope(x.tolist(), mode), (time, end), y, method="DOP853",
                        events=guards, rtol=RTOL, atol=RTOL * SCALES, max_step=MAX_STEP)
        if run.status < 0:
            raise ArithmeticError(f"integration failed after {time} s in {mode}: {run.message}")
        y, reached = [float(x) for x in run.y[:, -1]], float(run.t[-1])
        if run.status == 1:
            for guard, times in zip(guards, run.t_events, strict=True):
                if times.size:
                    mode = guard.then(y, mode)
        stalls = 0 if reached > time else stalls + 1
        if stalls > _MOST_STALLS:
            raise ArithmeticError(f"modes chatter at {time} s in {mode}")
        time = reached
    return y, mode


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Return `time` and the `OUTPUTS` at the rows, SI units, from rest; a row of `inputs` holds until the next.

    Outputs are left limits. Raises ValueError for an unknown input and for no supply.
    """
    p: dict[str, Any] = {name: float(value) for name, value in parameters.items()}
    columns = columns_of(inputs, electric_starts(p))
    if min(columns["supply_voltage"]) <= 0.0:
        raise ValueError("supply_voltage must be above 0: the modes of the drive are distinguished by its limits")
    times, row_at, sample_at, arrival_at = schedule(inputs["time"], p)

    filled = max(p["reservoir.pressure"], p["oil.cavitation_pressure"])
    y = [p["fin.start_angle"], 0.0, filled, filled, 0.0, 0.0, 0.0]
    loop, bus = Loop(p, y[FIN]), Bus(p)
    row = {name: column[0] for name, column in columns.items()}
    sent: list[float] = []
    active, mode, built = 0.0, None, as_built(p)
    plant = Plant(built, row, active)
    records = []
    for t, following in zip(times, [*times[1:], None], strict=True):
        if t in row_at:
            records.append((t, *y[:INTEGRAL], plant.voltage(y), sent[-1] if sent else 0.0))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            sent.append(loop.sample(y[FIN], y[SPEED], bus.arrived(row["fin_command"]), bool(row["enable"])))
        if t in arrival_at:
            active = sent[arrival_at[t]]
        plant = Plant(built, row, active)
        mode = plant.admit(y, mode)
        y, mode = advance(plant, y, mode, t, following)
    return dict(zip(("time", *OUTPUTS), np.array(records).T, strict=True))
