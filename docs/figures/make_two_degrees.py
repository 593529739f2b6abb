"""Compare shipped gains with two degrees of freedom for every kind of actuator: table in docs/model/control.md.

The script also plots two_degrees_front.png: trade-offs of the default actuator.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np
from make_control import GAINS, LINEAR, LOAD, lag, recovery, step
from make_tables import main, markdown, save

from emcas_fmu.actuators import NAMES, capabilities, get
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.plotting import plots

SET = "two-degrees-of-freedom"
KINDS = [name for name in NAMES if get(name).feed_forward is not None and (
    capabilities.POSITION_LOOP in get(name).provides)]
BANDWIDTHS = (0.0, 50.0, 100.0, 150.0, 250.0)  # 1/s, of the load observer
FACTORS = np.linspace(0.8, 1.3, 11)  # of the loops' speed: kp and velocity.kp in proportion, ki with the square
LIMITS = {"phase_margin": 45.0, "gain_margin": 8.0, "peak_angle": 0.35, "bandwidth_3db": 18.0}


def figure(
        parameters: ParameterSet, test: Test, name: str, variants: Any = ({},), sense: str = "maximum") -> list[float]:
    """Return a figure of a set for each of its variants; angles in degrees."""
    values = measure(test, ParameterSubject(parameters), list(variants), (name,), (sense,))[:, 0]
    return [float(v) for v in (np.degrees(values) if name in ("phase_margin", "peak_angle") else values)]


def figures(parameters: ParameterSet, torque: float) -> dict[str, float]:
    """Return the figures of a set for the table of kinds; the load is `torque` [N.m]."""
    load = Test("load", duration=1.0, torque=torque)
    return {
        "phase margin / °": figure(parameters, LINEAR, "phase_margin", sense="minimum")[0],
        "gain margin / dB": figure(parameters, LINEAR, "gain_margin", sense="minimum")[0],
        "−3 dB at 1° / Hz": figure(parameters, Test("sine", float(np.radians(1.0))), "bandwidth_3db",
                                       sense="minimum")[0],
        "lag at 5 Hz / °": lag(parameters),
        "settling of 1° / ms": 1e3 * figure(parameters, step(1.0), "settling_time")[0],
        "largest overshoot of 1, 5, 10° / %": 100.0 * max(
            figure(parameters, step(size), "overshoot")[0] for size in (1.0, 5.0, 10.0)),
        "20° within 0.2° after / ms": 1e3 * figure(parameters, step(20.0), "time_to_accuracy")[0],
        "deviation under a load step / °": figure(parameters, load, "peak_angle")[0],
        "within 0.05° after a load step / ms": recovery(parameters, torque)}


def table() -> str:
    """Return the table of kinds: shipped gains → two degrees of freedom."""
    def text(value: float) -> str:
        return f"{value:.{0 if value >= 1000.0 else 3}{'f' if value >= 1000.0 else 'g'}}" if isfinite(value) else "–"

    rows: dict[str, Mapping[str, str]] = {}
    for kind in KINDS:
        sets = load_parameters(model=kind), load_parameters(SET, model=kind)
        torque = load_requirements(None, sets[0]).rated_load
        shipped, two = (figures(each, torque) for each in sets)
        rows[kind] = {name: f"{text(shipped[name])} → {text(two[name])}" for name in shipped}
    return markdown(("", *next(iter(rows.values()))), ((f"`{kind}`", *row.values()) for kind, row in rows.items()))


def front() -> None:
    """Plot deviation under a load and bandwidth against the margins, for gains and bandwidths of the load observer."""
    base = load_parameters(SET)
    panels = (("phase_margin", "peak_angle", "phase margin [deg]", "deviation under 100 N·m [deg]"),
              ("gain_margin", "peak_angle", "gain margin [dB]", "deviation under 100 N·m [deg]"),
              ("phase_margin", "bandwidth_3db", "phase margin [deg]", "−3 dB at 1 deg [Hz]"))
    tests = {"phase_margin": LINEAR, "gain_margin": LINEAR, "peak_angle": LOAD,
             "bandwidth_3db": Test("sine", float(np.radians(1.0)))}
    senses = {"peak_angle": "maximum"}

    def figures_of(variants: list[dict[str, float]]) -> dict[str, list[float]]:
        return {name: figure(base, test, name, variants, senses.get(name, "minimum")) for name, test in tests.items()}

    def scaled(factor: float, observer: float) -> dict[str, float]:
        powers = {"controller.position.ki": 2.0}
        return {**{name: float(base.values[name]) * factor ** powers.get(name, 1.0) for name in GAINS},
                "controller.load_observer": observer}

    curves = {bandwidth: figures_of([scaled(float(f), bandwidth) for f in FACTORS]) for bandwidth in BANDWIDTHS}
    chosen = figures_of([{}])
    with plots.style():
        picture, (row,) = plots.figure(1, len(panels), height=2.9, width=9.5)
        shades = np.linspace(0.85, 0.2, len(BANDWIDTHS))
        for axes, (x, y, across, up) in zip(row, panels, strict=True):
            for (bandwidth, curve), shade in zip(curves.items(), shades, strict=True):
                axes.plot(curve[x], curve[y], color=(1.0 - 0.9 * (1 - shade), 0.75 * shade, 0.25 + 0.5 * shade),
                          label=f"observer {bandwidth:g} 1/s" if bandwidth else "no observer")
            axes.plot(chosen[x], chosen[y], "o", color="#222222", label="the set")
            axes.axvline(LIMITS[x], color="#888888", linestyle="--", linewidth=0.8)
            axes.axhline(LIMITS[y], color="#888888", linestyle="--", linewidth=0.8)
            axes.set(xlabel=across, ylabel=up)
        plots.legend_above(picture)
    save(picture, "two_degrees_front", 150)


TABLES = {"model/control.md": {"kinds": table}}


if __name__ == "__main__":
    front()
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_two_degrees.py"))
