"""Table of docs/model/sensors.md: changes of the default actuator's behaviour due to errors of its sensors.

    python docs/figures/make_sensors.py           # writes the table between its markers
    python docs/figures/make_sensors.py --check   # exit code 1 if the table is stale
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from math import degrees, radians
from typing import Any

import numpy as np
from make_tables import main, markdown

from emcas_fmu.bench.excitation import step_to, sweep
from emcas_fmu.bench.measure import Test, columns, measure
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters

OFFSET, GAIN = "sensor.current.offset", "sensor.current.gain_error"
ONCE, TWICE, NOISE = (f"sensor.encoder.{name}" for name in ("once", "twice", "noise"))
CURRENT: Mapping[str, Mapping[str, float]] = {
    "offset 0.83 A": {OFFSET: 0.83}, "gain +2.35 %": {GAIN: 0.0235}, "gain −2.35 %": {GAIN: -0.0235}}
ON_MOTOR: Mapping[str, Mapping[str, float]] = {
    "once a turn 0.1°": {ONCE: radians(0.1)}, "twice a turn 0.1°": {TWICE: radians(0.1)},
    "noise 0.06°": {NOISE: radians(0.06)}}
ON_FIN: Mapping[str, Mapping[str, float]] = {
    "once a turn 0.1°": {ONCE: radians(0.1)}, "twice a turn 0.05°": {TWICE: radians(0.05)},
    "noise 0.03°": {NOISE: radians(0.03)}}
WITH_FIN_ENCODER = {"encoder.on_fin": True, "encoder.pulses": 131072}  # 64 times the pulses: the same angle in a count
CASES: Sequence[tuple[str, str | None, Mapping[str, Any], Mapping[str, Mapping[str, float]]]] = (
    ("shipped gains", None, {}, {**CURRENT, **ON_MOTOR}),
    ("`load-observer`", "load-observer", {}, {**CURRENT, **ON_MOTOR}),
    ("`two-degrees-of-freedom`", "two-degrees-of-freedom", {}, {**CURRENT, **ON_MOTOR}),
    ("encoder on the fin", None, WITH_FIN_ENCODER, ON_FIN))
HEADER = ("", "steps of 1, 5, 20°", "sweep of 3.5°", "held error at 20° / under 100 N·m", "rate / against 100 N·m",
          "−3 dB at 1° / 3.5°", "current at rest", "energy in 3 s of 100 N·m", "margins")


def _rows(subject: ParameterSubject, errors: Mapping[str, Mapping[str, float]]) -> list[list[str]]:
    """Return the rows of an actuator without errors, and with each of the errors."""
    changes = [{}, *errors.values()]

    def moved(excitation: Any) -> Any:
        angle = subject.run_all(excitation, columns(subject, changes), ("fin_angle",)).columns["fin_angle"]
        return np.degrees(np.max(np.abs(angle - angle[0]), axis=-1))

    def figures(test: Test, *names: str, sense: str = "maximum") -> Any:
        return measure(test, subject, changes, names, [sense] * len(names)).T

    steps = np.max([moved(step_to(radians(size), 1.5)) for size in (1.0, 5.0, 20.0)], axis=0)
    swept = moved(sweep(radians(3.5), 8.0, 0.5, 20.0))
    rates = [figures(Test("slew", radians(20.0), 1.0, load), "sustained_rate", sense="minimum")[0]
             for load in (0.0, -100.0)]
    bandwidths = [figures(Test("sine", radians(size)), "bandwidth_3db", sense="minimum")[0] for size in (1.0, 3.5)]
    held, current = figures(Test("step", radians(20.0), 3.0), "held_error", "current_ripple")
    loaded, energy = figures(Test("load", 0.0, 3.0, 100.0), "held_error", "energy_drawn")
    gain, phase = figures(Test("linear"), "gain_margin", "phase_margin")
    return [[name, *((f"{steps[k]:.2g}°", f"{swept[k]:.2g}°") if k else ("", "")),
             f"{degrees(held[k]):.2g}° / {degrees(loaded[k]):.2g}°",
             f"{degrees(rates[0][k]):.1f} / {degrees(rates[1][k]):.1f} deg/s",
             f"{bandwidths[0][k]:.1f} / {bandwidths[1][k]:.1f} Hz", f"{current[k]:.2f} A", f"{energy[k]:.0f} J",
             f"{gain[k]:.1f} dB, {degrees(phase[k]):.0f}°"] for k, name in enumerate(("none", *errors))]


def effects() -> str:
    """Return the table of the effects of each error; differences of fin angles are from the run without errors."""
    rows = []
    for title, file, changes, errors in CASES:
        parameters = load_parameters(model="nonlinear+sensors")
        parameters = (load_parameters(file, base=parameters) if file else parameters).with_values(changes)
        rows += [[f"**{title}**", *[""] * (len(HEADER) - 1)], *_rows(ParameterSubject(parameters), errors)]
    return markdown(HEADER, rows)


TABLES = {"model/sensors.md": {"effects": effects}}


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_sensors.py"))
