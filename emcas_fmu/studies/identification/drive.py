"""Identify the current-mode drive from records of its reference and current (section 3.2.2).

The current loop, (2.46) with its PI controller, is linear while neither current nor voltage is limited. With the
reference u, the motor speed w and the controller's integral xi:

    L di/dt = K_p (i_ref - i) + xi - R i - K_e w        dxi/dt = K_i (i_ref - i)        i_ref = K_v u(t - T_d) + i_off

A row's reference is constant until the next row, as from a DAC, and arrives T_d later, in general between two rows. The
exact discretisation is split at that time (modified z-transform), which resolves the delay to a fraction of the sample
interval. Right after a step the gain is K_v K_p/(R + K_p), then it creeps towards K_v with the slow mode of the
integral: fast records determine delay and K_p, slow records K_v and K_i.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter
from scipy.stats import median_abs_deviation

from ...actuators.electromechanical import nonlinear
from ...ops.arrays import ARRAYS
from ...parameters import ParameterSet
from ...physics import drive
from ...plotting.plots import Drawing
from . import pictures
from .estimation import Fit, each, weighted_fit
from .records import Array, RecordFile, distinct, read_records, refuse_clipped, refuse_magnitude, require
from .result import Estimate, Identification, IdentificationExperiment, estimates, require_certain

EXPERIMENT = IdentificationExperiment(
    "drive", "Drive: current gain, offset, transport delay and current loop", ("drive_reference", "motor_current"),
    ("motor_speed",), ("motor.resistance", "motor.inductance", "motor.back_emf_constant"), "A")
NAMES = ("drive.current_gain", "drive.current_offset", "drive.transport_delay", "drive.kp", "drive.ki")
GAIN, OFFSET, DELAY, KP, KI = range(5)

FAST = 10.0  # smallest number of samples of the fastest record within the delay
LONGEST_SEARCHED = 0.1  # s, upper limit of drive.transport_delay
FEWEST_LEVELS = 3
_SLOWEST = 1e-3  # s, longest sample interval of a fast record: longer than a current loop's time constant
_LENGTH = 0.1  # smallest duration of the longest record, as a share of the integral's time constant
_SETTLED = 5e-3  # s after the arrival of a step that are left out of slow records, which cannot show the transient
_WORST = 0.25  # largest relative 1 sigma of gain, delay and K_p in a result
_STEP = 8.0  # smallest change of a reference that counts as a step, in standard deviations of its noise


class _Fitted(NamedTuple):
    """A record with its reference [V], its current [A] and the mask `used` of its fitted rows."""

    record: RecordFile
    reference: Array
    current: Array
    used: NDArray[np.bool_]
    integral_index: int  # of the record's initial integral [V] among the fitted values

    @property
    def fast(self) -> bool:
        return self.record.step <= _SLOWEST

    def modelled(self, x: Array, values: Mapping[str, Any]) -> Array:
        """Return the simulated current [A] at each row, for the fitted values `x`."""
        return response(x[:5], float(x[self.integral_index]), self.reference, self.record.columns.get("motor_speed"),
                        self.record.step, values)


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """Identify the drive; in records without motor_speed the rotor must be clamped. Raises RecordError."""
    records = read_records(paths, EXPERIMENT.required, EXPERIMENT.optional)
    values = base.values
    for record in records:
        _check(record, values)
    fast = [r for r in records if r.step <= _SLOWEST]
    require(fast, "the sample rate is too low for the transport delay and the current loop: the fastest record has a "
            f"sample every {min(r.step for r in records) * 1e3:.3g} ms; log at least one record with steps of the "
            f"reference, with a sample every {_rise(values) * 1e3:.2g} ms, L/(R + Kp), or less, and {FAST:g} samples "
            "in the delay")
    start = _delay(fast, values)
    _require_rate(start + 2.0 * _rise(values), min(r.step for r in fast))
    fitted = [_Fitted(record, record["drive_reference"], record["motor_current"], _used(record, start), 5 + k)
            for k, record in enumerate(records)]
    _require(fitted, start, values)
    fit = _fit(fitted, start, values)
    parameters = estimates(fit, base)
    _require_answer(parameters, fit, fitted, values)
    return Identification(EXPERIMENT, records, base, fit, parameters, [*_notes(fitted, fit, values)],
                          lambda: _drawings(fitted, fit, values))


def response(parameters: Any, initial: float, reference: Array, speed: Array | None, step: float,
             values: Mapping[str, Any]) -> Array:
    """Return the linear loop's current [A] at each row, for reference [V] and motor speed [rad/s] (None: clamped).

    `parameters` are K_v [A/V], i_off [A], T_d [s], K_p [V/A] and K_i [V/(A.s)]. The current starts at the steady state
    of the first reference and xi = `initial` [V]. Rows are `step` [s] apart. `values` has the motor's parameters.
    """
    gain, offset, delay, kp, ki = parameters
    p = nonlinear.ACTUATOR.namespace({**values, "drive.current_gain": gain, "drive.current_offset": offset})
    demanded = drive.current_reference_raw(p, reference)
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    a = np.array([[-(resistance + kp) / inductance, 1.0 / inductance], [-ki, 0.0]])
    b = np.array([kp / inductance, ki])
    e = np.array([-1.0 / inductance, 0.0])
    whole = int(np.floor(delay / step))
    fraction = delay / step - whole
    rest_of_interval, late = _discretised(a, b, step * (1.0 - fraction))  # after the arrival
    _, early = _discretised(a, b, step * fraction)
    phi, back = _discretised(a, e, step)
    # x_k+1 = phi x_k + (rest_of_interval early) u_k-whole-1 + late u_k-whole
    previous = np.concatenate([np.full(whole + 1, demanded[0]), demanded])[:len(demanded)]
    arrived = np.concatenate([np.full(whole, demanded[0]), demanded])[:len(demanded)]
    start = np.array([(kp * demanded[0] + initial) / (resistance + kp), initial])
    added = np.outer(previous, rest_of_interval @ early) + np.outer(arrived, late)
    if speed is not None:
        added = added + np.outer(drive.back_emf(p, speed), back)
    return _first_state(phi, start, added)


def _discretised(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """Return the transition matrix over `time` [s], and the effect of a constant unit input."""
    transition, effect, *_ = cont2discrete((a, b[:, None], np.eye(2), np.zeros((2, 1))), time)
    return transition, effect[:, 0]


def _first_state(phi: Array, start: Array, added: Array) -> Array:
    """Return the first component of x in x_k+1 = phi x_k + added_k, by its difference equation."""
    trace, determinant = float(np.trace(phi)), float(np.linalg.det(phi))
    # First row of (z^2 - trace z + det) x = adj(z - phi) added.
    total = np.concatenate([start[:1], added[:-1, 0]])
    before = np.concatenate([start[None], added[:-2]])
    total[1:] += phi[0, 1] * before[:, 1] - phi[1, 1] * before[:, 0]
    current: Array = lfilter([1.0], [1.0, -trace, determinant], total)
    return current


def _rise(values: Mapping[str, Any]) -> float:
    """Return the time constant [s] with which the current rises."""
    return float(values["motor.inductance"] / (values["motor.resistance"] + values["drive.kp"]))


def _check(record: RecordFile, values: Mapping[str, Any]) -> None:
    """Raise RecordError for a record that is clipped or saturated, or has an implausible magnitude or no step."""
    refuse_magnitude(record, "drive_reference", 1.1 * values["drive.reference_limit"],
                     "1.1 times drive.reference_limit")
    refuse_magnitude(record, "motor_current", 2.0 * values["drive.current_limit"], "2 times drive.current_limit")
    refuse_clipped(record, "motor_current")
    for name, limit, share in (("drive_reference", "drive.reference_limit", 0.999),
                               ("motor_current", "drive.current_limit", 0.98)):
        reached = np.abs(record[name]).max()
        record.require(reached <= share * values[limit], f"{name} is saturated: it reaches {reached:.3g} and {limit} = "
                       f"{values[limit]:g}; excite less")
    reference = record["drive_reference"]
    record.require(np.ptp(reference) >= 20.0 * _noise(reference), "drive_reference hardly moves "
                   f"({np.ptp(reference):.3g} V): there is no step for the current to follow; step it by at least a "
                   "few tenths of a volt")


def _noise(x: Array) -> float:
    """Return the standard deviation of a signal's noise, above 0, by a median of differences, which ignores steps."""
    return float(median_abs_deviation(np.diff(x), scale="normal") / 2.0**0.5) + 1e-9


def _changes(reference: Array) -> Any:
    """Return the rows at which the reference changes level."""
    return np.flatnonzero(np.abs(np.diff(reference)) > max(_STEP * _noise(reference), 1e-3)) + 1


def _used(record: RecordFile, delay: float) -> NDArray[np.bool_]:
    """Return the mask of fitted rows: all rows of a fast record, and the rows of a slow one outside transients."""
    used = np.ones(len(record), dtype=bool)
    if record.step > _SLOWEST:
        after = int(np.ceil((delay + _SETTLED) / record.step)) + 1
        for change in _changes(record["drive_reference"]):
            used[change - 1:change + after] = False
    return used


def _delay(fast: Sequence[RecordFile], values: Mapping[str, Any]) -> float:
    """Return an initial delay [s]: the shift at which the reference explains the current best, minus the rise time."""
    step = min(r.step for r in fast)
    shifts = np.arange(0.0, min(LONGEST_SEARCHED, 0.5 * min(len(r) * r.step for r in fast)), step)
    unexplained = np.zeros(len(shifts))
    for r in fast:
        current = r["motor_current"]
        for k, shift in enumerate(shifts):
            line = np.column_stack([r.late(r["drive_reference"], shift), np.ones(len(r))])
            residuals = current - line @ np.linalg.lstsq(line, current, rcond=None)[0]
            unexplained[k] += float(np.sum(residuals**2) / np.var(current))
    best = int(np.argmin(unexplained))
    share = 1.0 - unexplained[best] / sum(len(r) for r in fast)
    fast[0].require(share >= 0.5, "motor_current does not follow drive_reference: at the best delay it explains "
                    f"{share:.0%} of the current; check that the columns belong together, that the drive was enabled, "
                    "and the units in the header")
    return max(float(shifts[best]) - _rise(values), 0.0)


def _require(fitted: Sequence[_Fitted], delay: float, values: Mapping[str, Any]) -> None:
    """Raise RecordError for too few levels, too short records, or slopes far from the base set's gain."""
    levels = distinct(np.concatenate([r.reference[r.used] for r in fitted]), 0.05)
    require(len(levels) >= FEWEST_LEVELS and min(levels) < 0.0 < max(levels),
            f"the reference has {len(levels)} level(s) ({min(levels):.3g} to {max(levels):.3g} V): gain and offset "
            f"need at least {FEWEST_LEVELS} levels, of both signs")
    late = [r.record.late(r.reference, delay + _rise(values)) for r in fitted]
    slopes = [float(np.polyfit(x[r.used], r.current[r.used], 1)[0]) for x, r in zip(late, fitted, strict=True)]
    for r, slope in zip(fitted, slopes, strict=True):
        rises = f"motor_current rises by {slope:.4g} A per volt of drive_reference"
        r.record.require(slope > 0.0, f"motor_current falls with drive_reference ({slope:.3g} A/V): one of them has "
                           "the wrong sign; change it in the file")
        r.record.require(0.1 < slope / values["drive.current_gain"] < 10.0,
                           f"{rises}, {slope / values['drive.current_gain']:.3g} times the gain in the base set: "
                           "check the units of both columns in the header")
        r.record.require(0.6 < slope / slopes[0] < 1.7, f"{rises}, but by {slopes[0]:.4g} in {fitted[0].record.name}: "
                           "check the units in both files' headers, and that both records are from one drive")
    if values["drive.ki"] <= 0.0:
        return
    # A record much shorter than the integral's time constant shows the proportional action only.
    slow = (values["motor.resistance"] + values["drive.kp"]) / values["drive.ki"]
    longest = max(len(r.record) * r.record.step for r in fitted)
    require(longest >= _LENGTH * slow, f"the longest record lasts {longest:.3g} s, but by the base parameters the "
            f"drive's integral has the time constant (R + Kp)/Ki = {slow:.3g} s: gain and Ki cannot be distinguished. "
            f"Add a slow staircase of {_LENGTH * slow:.3g} s or more, or give base parameters with a better drive.ki "
            "(0: no integral)")


def _fit(fitted: Sequence[_Fitted], start: float, values: Mapping[str, Any]) -> Fit:
    """Fit the drive's parameters and each record's initial integral [V]."""
    slow = [r for r in fitted if not r.fast] or list(fitted)
    slope, offset = np.polyfit(np.concatenate([r.reference[r.used] for r in slow]),
                               np.concatenate([r.current[r.used] for r in slow]), 1)
    initial = np.zeros(len(fitted))
    lowest = np.array([-np.inf, -np.inf, 0.0, 1e-3 * values["drive.kp"], -np.inf, *(initial - np.inf)])
    scale = np.array([slope, 0.1, 1e-3, values["drive.kp"], max(values["drive.ki"], 1e-2), *(initial + 0.1)])

    def residuals(x: Array) -> list[Array]:
        x = np.maximum(x, lowest)
        return [(r.current - r.modelled(x, values))[r.used] for r in fitted]

    # Far from the true delay the sum of squares is flat: the fit begins at the best of a few delays and values of kp.
    starts = [np.array([slope * (1.0 + values["motor.resistance"] / kp), offset, delay, kp, values["drive.ki"],
                        *initial])
              for delay in start + np.array([0.0, 0.5, 1.0, 1.5]) * _rise(values)
              for kp in np.array([0.3, 1.0, 3.0]) * values["drive.kp"]]
    begin = min(starts, key=lambda x: sum(float(r @ r) / len(r) for r in residuals(x)))
    return weighted_fit(NAMES, each(residuals), begin, scale, range(len(fitted)))


def _require_rate(delay: float, step: float) -> None:
    require(delay >= FAST * step, f"the sample rate is too low for the delay: {delay * 1e3:.3g} ms is "
            f"{delay / step:.2g} samples of the fastest record; log at {FAST / max(delay, 1e-4):.3g} Hz or more")


def _require_answer(parameters: Sequence[Estimate], fit: Fit, fitted: Sequence[_Fitted],
                    values: Mapping[str, Any]) -> None:
    """Raise RecordError for estimates that are too uncertain or implausible, or depend on a limited voltage."""
    gain, _, delay, kp, ki = parameters
    identified = {**values, **{e.name: e.value for e in parameters}}
    step, rise = min(r.record.step for r in fitted), _rise(identified)
    _require_rate(delay.value, step)
    require(rise >= 0.7 * step, "the sample rate is too low for the current loop: the current rises within "
            f"{rise * 1e3:.2g} ms, between two samples {step * 1e3:.2g} ms apart, and delay and Kp cannot be "
            f"distinguished; log at {1.0 / rise:.3g} Hz or more")
    require_certain((gain, delay, kp), _WORST, "record more and larger steps at a high sample rate")
    require(ki.value >= -2.0 * ki.sigma, f"drive.ki is estimated as {ki.value:.3g} V/(A.s), below 0: the "
            "current creeps away from its reference; check that the winding did not heat up, and motor.resistance")
    p, x = nonlinear.ACTUATOR.namespace(identified), fit.values
    supply = float(values["drive.supply_voltage"])
    for r in [r for r in fitted if r.fast]:
        i_ref = drive.current_reference(ARRAYS, p, r.record.late(r.reference, delay.value))
        demand = np.abs(drive.voltage_demand(p, i_ref, r.modelled(x, values), x[r.integral_index]))
        r.record.require(demand.max() <= supply, "the drive's voltage is saturated: the steps demand "
                           f"{demand.max():.3g} V from a supply of {supply:g} V, and their rise depends on the "
                           f"supply instead of Kp; use steps below {0.9 * supply / (kp.value * gain.value):.2g} V")


def _notes(fitted: Sequence[_Fitted], fit: Fit, values: Mapping[str, Any]) -> Iterator[str]:
    _, _, delay, kp, ki = fit.values[:5]
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    slow = f"then {(resistance + kp) / ki:.3g} s for the integral" if ki > 0.0 else "without an integral"
    yield (f"The delay is {delay / min(r.record.step for r in fitted):.2f} samples of the fastest record; it includes "
           "any delay between the two channels of the logger, and begins at the first row of a new reference.")
    yield (f"Current loop: {inductance / (resistance + kp) * 1e3:.3g} ms, {slow}; right after a step "
           f"{kp / (resistance + kp):.1%} of the demanded current flows.")
    yield "Kp scales with motor.inductance and motor.resistance, whose uncertainty is not included."
    if fit.sigmas[KI] > 0.3 * abs(ki):
        yield "drive.ki is uncertain: add a slow record with the reference constant for much of this time constant."
    if not any("motor_speed" in r.record.columns for r in fitted):
        yield "No record has motor_speed: the rotor was assumed clamped."


def _drawings(fitted: Sequence[_Fitted], fit: Fit, values: Mapping[str, Any]) -> Iterator[Drawing]:
    x = fit.values
    parts, lines = [], []
    for r in fitted:
        time = r.record["time"] - r.record["time"][0]
        stop = np.searchsorted(time, 0.03) if r.fast else len(time)
        parts.append((r.record.name, [pictures.Series("model", time[:stop], r.current[:stop], time[:stop],
                                                      r.modelled(x, values)[:stop])]))
        if not r.fast:
            order = np.argsort(r.reference[r.used])
            u, i = r.reference[r.used][order], r.current[r.used][order]
            lines.append(pictures.Series(r.record.name, u, i, u, x[GAIN] * u + x[OFFSET]))
    yield pictures.panels(
        "Current against time", parts, "time [s]", "motor current [A]",
        "Measured current and the fitted current loop; of fast records the first 30 ms.", sharey=False)
    steps = [(r.record.name, [series]) for r in fitted if r.fast and (series := _steps(r, x, values)) is not None]
    yield pictures.panels(
        "Steps of the reference", steps or [("no single steps", [])], "time since the step of the reference [ms]",
        "share of the step",
        "The larger steps of the fast records, scaled and plotted together: the rise begins after the delay; its "
        "time constant is L/(R + Kp).")
    yield pictures.panels(
        "Steady current against reference", [("", lines)], "reference [V]", "motor current [A]",
        "Slow records without transients; the line has the identified gain and offset. The distance of a point from "
        "the line is the error that the integral has not yet corrected.")
    # Records of a tenth of a second and of a minute share one axis.
    yield pictures.residuals([(r.record.name, (t := r.record["time"][r.used]) / t[-1]) for r in fitted], fit,
                             "share of the record's time", "residual current [A]")


def _steps(r: _Fitted, x: Array, values: Mapping[str, Any]) -> pictures.Series | None:
    """Return the larger steps of a fast record as shares of the step over time [ms]; None if there is none."""
    model, h, delay = r.modelled(x, values), r.record.step, x[DELAY] * 1e3
    before, after = int(0.3e-3 / h) + 1, int(1.2e-3 / h) + 1
    lag = int(x[DELAY] / h)
    at = lag + _changes(r.reference)
    at = at[(at >= before) & (at + after <= len(model)), None]
    size = model[at + after - 1] - model[at - 1]
    large = np.abs(size[:, 0]) >= 0.3 * np.ptp(r.current) / 2.0
    if not large.any():
        return None
    at, size, around = at[large], size[large], np.arange(-before, after)
    t = np.tile((lag + around) * h * 1e3, len(at))
    shares = ((r.current[at + around] - model[at - 1]) / size).ravel()
    grid = np.linspace(t.min(), t.max(), 300)
    rise = values["motor.inductance"] / (values["motor.resistance"] + x[KP]) * 1e3
    curve = np.where(grid > delay, 1.0 - np.exp(-np.maximum(grid - delay, 0.0) / rise), 0.0)
    return pictures.Series("model", t, shares, grid, curve)
