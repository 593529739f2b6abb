"""A test rig: the package's core with the instruments of a bench.

The plant, the drive with its transport delay, the encoder and the sampled controllers are those of the core, with all
events. Only its `sample` function is wrapped: the reference passes a DAC with `DAC_BITS` bits. The actuator's position
loop follows a ramp of the motor angle, as on a bench without a separate drive motor. The records therefore have the
jitter that encoder counts and stiction cause in a real loop. Friction compensation is off, since the friction is not
known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from emcas_fmu.actuators.electromechanical import nonlinear
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import kinematics, mechanics
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.core import Core
from emcas_fmu.studies.identification.records import Array

DAC_BITS, DAC_RANGE = 16, 10.0  # bits and range [+-V] of the analogue output
ADC_BITS, CURRENT_RANGE, REFERENCE_RANGE = 14, 100.0, 10.0  # bits and ranges [+-A, +-V] of the logger's inputs
CURRENT_NOISE, REFERENCE_NOISE = 0.06, 5e-4  # rms noise of a sample [A, V]
_RIG = {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0,
        "controller.position.velocity_feedforward": 0.0, "controller.velocity.ki": 0.0,
        "controller.load_observer": 0.0, "controller.speed_limit": 400.0, "compensation.gain": 0.0,
        "encoder.enabled": True, "encoder.on_fin": False}
# The rig's loops have their own gains. The velocity loop crosses over where the drive's delay and a sample cause a
# phase lag of `_LAG`, the position loop at a third of this frequency.
_LAG = 0.56  # rad
_FASTEST_LOOP = 120.0  # rad/s, largest crossover of the velocity loop
_SLEWS = 8.0  # shortest sweep over the travel in time constants of the position loop, for a part at constant speed
# Finer than the actuator's: with ticks of 0.5 ms the identified inertia has an error of half a sigma.
_TICK, _CLAMPED_TICK = 1e-4, 5e-4  # s
_CLAMP = 10.0  # N.m, Coulomb friction that clamps the rotor: more than the drive's largest torque
_NAMES = [v.name for v in nonlinear.ACTUATOR.outputs]


@dataclass(frozen=True)
class Log:
    """True values at the logger's times [s], SI; `mean_current` is the average over one interval about each time."""

    time: Array
    reference: Array
    columns: Mapping[str, Array]
    mean_current: Array


def quantised(values: Any, bits: int, reach: float) -> Array:
    """Return a converter's output: values rounded to its steps and limited to its range +-`reach`."""
    step = 2.0 * reach / 2**bits
    converted: Array = np.clip(np.round(np.asarray(values) / step), -2 ** (bits - 1), 2 ** (bits - 1) - 1) * step
    return converted


def position_bandwidth(values: Mapping[str, Any], sample_time: float = 1e-3) -> float:
    """Return the gain of the rig's position loop [1/s]."""
    return min(_LAG / (float(values["drive.transport_delay"]) + sample_time), _FASTEST_LOOP) / 3.0


def fastest_sweep(values: Mapping[str, Any], travel: float) -> float:
    """Return the largest motor speed [rad/s] that a sweep over `travel` [rad] reaches and holds."""
    return travel * position_bandwidth(values) / _SLEWS


def _loops(values: Mapping[str, Any], sample_time: float) -> dict[str, float]:
    p = nonlinear.ACTUATOR.namespace(values)
    inertia = float(mechanics.coefficients(FLOATS, p, kinematics.motor_angle(FLOATS, p, 0.0)).inertia)
    position = position_bandwidth(values, sample_time)
    return {"controller.position.kp": position,
            "controller.velocity.kp": 3.0 * position * inertia / (p.motor.torque_constant * p.drive.current_gain)}


def centred(fine: Array, every: int) -> Array:
    """Return the means about each `every`-th value over `every` intervals (1 or even), by the trapezoidal rule.

    Beyond its ends, `fine` continues with the values there.
    """
    half = every // 2
    weights = np.full(2 * half + 1, 1.0)
    weights[[0, -1]] = 0.5 if half else 1.0
    return np.convolve(np.pad(fine, half, mode="edge"), weights / weights.sum(), mode="valid")[::every]


def run(values: Mapping[str, Any], signal: Callable[[float], float], duration: float, interval: float, *,
        log_every: int = 1, sample_time: float = 1e-3, start: float = 0.0, open_loop: bool = False,
        clamped: bool = False) -> Log:
    """Simulate `duration` [s] and log every `log_every` steps of `interval` [s].

    `signal` maps time [s] to the motor angle to follow [rad], or with `open_loop` to the analogue reference [V].
    `start` is the initial fin angle [rad]. With `clamped` the rotor is clamped.
    """
    chosen = {**values, **_RIG, **_loops(values, sample_time), "controller.sample_time": sample_time,
              "fin.start_angle": start, "solver.max_tick": min(_CLAMPED_TICK if clamped else _TICK, sample_time)}
    if clamped:
        chosen |= {name: _CLAMP if name.endswith("[0]") else 0.0 for name in values
                   if name.startswith("friction.coulomb.")}
    schedule, locate, initial, sample, *rest = codegen.make()(chosen)

    def through_dac(*arguments: Any) -> tuple[Any, ...]:
        *states, command, supply, enable = arguments
        reference, *others = sample(*states, 0.0 if open_loop else command, supply, enable)
        return float(quantised(command if open_loop else reference, DAC_BITS, DAC_RANGE)), *others

    core = Core((schedule, locate, initial, through_dac, *rest), codegen.sizes(nonlinear.ACTUATOR))
    p = nonlinear.ACTUATOR.namespace(chosen)
    supply = chosen["drive.supply_voltage"]

    def command(time: float) -> float:
        if open_loop:
            return signal(time)
        return float(kinematics.fin_angle(FLOATS, p, kinematics.lever_tangent(FLOATS, p, signal(time))))

    at_rest = codegen.inputs_at_rest(command(0.0), 0.0, supply)
    rows = [core.outputs(at_rest)]
    current = _NAMES.index("motor_current")
    currents = [rows[0][current]]
    for k in range(1, round(duration / (interval * log_every)) + 1):
        for j in range(log_every):
            begin = ((k - 1) * log_every + j) * interval
            # The command of the instant `begin`, despite rounding.
            out = core.run(begin + interval, (command(begin + 1e-9), *at_rest[1:]))
            currents.append(out[current])
        rows.append(out)
    table = np.array(rows, dtype=float)
    columns = dict(zip(_NAMES, table.T, strict=True))
    # Outputs are those before the sample: the DAC's value from a logging instant on is in the next row.
    reference = np.append(columns["drive_reference"][1:], columns["drive_reference"][-1])
    time: Array = np.arange(float(len(rows))) * (interval * log_every)
    return Log(time, reference, columns, centred(np.array(currents, dtype=float), log_every))
