"""A test rig: the kernel's core with the instruments of a bench.

The plant, the drive with its transport delay, the encoder and the sampled controllers are those of the kernel, event by
event; only its `sample` function is wrapped, so that the reference passes a DAC of `DAC_BITS`. The actuator's position
loop holds the speeds by following a ramp of the motor angle, as a user without a separate drive motor would do. The
record then has the jitter that encoder counts and stiction cause in a real loop; a prescribed speed would be smoother
than on any bench. Friction compensation is off: it would need the unknown friction.
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

DAC_BITS, DAC_RANGE = 16, 10.0  # of the analogue output, +-V
ADC_BITS, CURRENT_RANGE, REFERENCE_RANGE = 14, 100.0, 10.0  # of the logger's inputs, +-A and +-V
CURRENT_NOISE, REFERENCE_NOISE = 0.06, 5e-4  # A and V, rms of a sample
_RIG = {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0,
        "controller.position.velocity_feedforward": 0.0, "controller.velocity.ki": 0.0,
        "controller.load_observer": 0.0, "controller.speed_limit": 400.0, "compensation.gain": 0.0,
        "encoder.enabled": True, "encoder.on_fin": False}
# The rig's loops, independent of the actuator's, tuned as on a bench, by observing oscillations. The velocity loop
# crosses where the drive's delay and a sample cause a phase lag of `_LAG`, the position loop at a third of that.
_LAG = 0.56  # rad
_FASTEST_LOOP = 120.0  # rad/s
_SLEWS = 8.0  # duration of a sweep over the travel, in time constants of the position loop, for a steady part
# Finer than the actuator's: a bench does not integrate, and with 0.5 ms the inertia is wrong by half a sigma.
_TICK, _CLAMPED_TICK = 1e-4, 5e-4  # s
_CLAMP = 10.0  # N.m at the motor: a clamped rotor, above what any current of the drive makes
_NAMES = [v.name for v in nonlinear.ACTUATOR.outputs]


@dataclass(frozen=True)
class Log:
    """True values at the logger's instants; `mean_current` is the average over one interval about each instant.

    An averaging logger delays; a good one corrects its time stamps.
    """

    time: Array
    reference: Array
    columns: Mapping[str, Array]
    mean_current: Array


def quantised(values: Any, bits: int, reach: float) -> Array:
    """Return a converter's output: rounded to its steps, held at its ends."""
    step = 2.0 * reach / 2**bits
    converted: Array = np.clip(np.round(np.asarray(values) / step), -2 ** (bits - 1), 2 ** (bits - 1) - 1) * step
    return converted


def position_bandwidth(values: Mapping[str, Any], sample_time: float = 1e-3) -> float:
    """Gain of the rig's position loop [1/s]."""
    return min(_LAG / (float(values["drive.transport_delay"]) + sample_time), _FASTEST_LOOP) / 3.0


def fastest_sweep(values: Mapping[str, Any], travel: float) -> float:
    """Motor speed [rad/s] that a sweep over `travel` [rad] still reaches and holds."""
    return travel * position_bandwidth(values) / _SLEWS


def _loops(values: Mapping[str, Any], sample_time: float) -> dict[str, float]:
    p = nonlinear.ACTUATOR.namespace(values)
    inertia = float(mechanics.coefficients(FLOATS, p, kinematics.motor_angle(FLOATS, p, 0.0)).inertia)
    position = position_bandwidth(values, sample_time)
    return {"controller.position.kp": position,
            "controller.velocity.kp": 3.0 * position * inertia / (p.motor.torque_constant * p.drive.current_gain)}


def centred(fine: Array, every: int) -> Array:
    """Return means over `every` intervals, an even number or one, about each `every`-th value, by trapezia.

    The values at the ends continue beyond.
    """
    half = every // 2
    weights = np.full(2 * half + 1, 1.0)
    weights[[0, -1]] = 0.5 if half else 1.0
    return np.convolve(np.pad(fine, half, mode="edge"), weights / weights.sum(), mode="valid")[::every]


def run(values: Mapping[str, Any], signal: Callable[[float], float], duration: float, interval: float, *,
        log_every: int = 1, sample_time: float = 1e-3, start: float = 0.0, open_loop: bool = False,
        clamped: bool = False) -> Log:
    """Simulate `duration` [s] and log every `log_every` steps of `interval` [s].

    `signal` is the motor angle to follow [rad] over time, or with `open_loop` the analogue
    reference [V]. `start` is the fin angle [rad]. `clamped` holds the rotor.
    """
    chosen = {**values, **_RIG, **_loops(values, sample_time), "controller.sample_time": sample_time,
              "fin.start_angle": start, "solver.max_tick": min(_CLAMPED_TICK if clamped else _TICK, sample_time)}
    if clamped:
        chosen |= {name: _CLAMP if name.endswith("[0]") else 0.0 for name in values
                   if name.startswith("friction.coulomb.")}
    schedule, locate, initial, sample, *rest = codegen.make()(chosen)

    def through_dac(*given: Any) -> tuple[Any, ...]:
        *states, asked, supply, enable = given
        reference, *others = sample(*states, 0.0 if open_loop else asked, supply, enable)
        return float(quantised(asked if open_loop else reference, DAC_BITS, DAC_RANGE)), *others

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
    # A command acts from the sample at which it begins: half an interval guards against rounding.
    inputs = at_rest
    for k in range(1, round(duration / (interval * log_every)) + 1):
        for j in range(log_every):
            begin = ((k - 1) * log_every + j) * interval
            inputs = (command(begin + 1e-9), *at_rest[1:])
            out = core.run(begin + interval, inputs)
            currents.append(out[current])
        rows.append(out)
    table = np.array(rows, dtype=float)
    columns = dict(zip(_NAMES, table.T, strict=True))
    # The DAC's value from a sample that falls on a logging instant on is the one held from there, which the
    # outputs at that instant, before the sample, do not show yet.
    held = np.append(columns["drive_reference"][1:], columns["drive_reference"][-1])
    time: Array = np.arange(float(len(rows))) * (interval * log_every)
    return Log(time, held, columns, centred(np.array(currents, dtype=float), log_every))
