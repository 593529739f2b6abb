"""Stored numbers of the bench: excitations, figures of synthetic columns, and a verdict on every figure of every kind.

    python -m tests.bench.figures        # computes and writes the numbers

test_figures.py compares them. Like the table of trajectories they show that something changed, not that it is right.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.bench import excitation, measure, metrics
from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.frequency_response import Sines, frequency_response, held, swept
from emcas_fmu.bench.metrics import FIGURES
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import judge
from emcas_fmu.parameters import load_parameters
from tests.trajectories.runs import mark

FILE = Path(__file__).with_name("figures.json")

TESTS: Mapping[str, str] = {
    "step": 'amplitude = "18 deg", duration = "0.7 s", torque = "30 N*m", supply = 0.9',
    "slew": 'amplitude = "15 deg", duration = "0.5 s", torque = "-60 N*m", settle = "0.4 s"',
    "load": 'torque = "80 N*m", duration = "0.5 s"', "sine": 'amplitude = "1.5 deg"', "linear": "",
    "release": 'torque = "80 N*m", settle = "0.5 s", duration = "0.5 s"',
    "repeat": 'amplitude = "8 deg", torque = "90 N*m", duration = "0.4 s"'}
# Some of these limits are met and some are missed.
LIMITS: Mapping[str, str] = {"s": "60 ms", "rad": "0.9 deg", "rad/s": "150 deg/s", "A": "11 A", "W": "400 W",
                             "J": "12 J", "Hz": "15 Hz", "dB": "9 dB", "1": "7 %"}
# Actuators under test, and the parameters that the case `other` changes.
JUDGED: Mapping[str, str] = {
    "nonlinear": '"controller.position.kp" = "70 %"\n"command.limit" = "17 deg"',
    "second-order": '"second_order.rate_limit" = "60 %"'}


def specification(model: str) -> str:
    """Return the text of a file of requirements with every figure of every kind of test."""
    lines = ["[cases.nominal]\n[cases.other]\n" + JUDGED[model]]
    for kind, (_, names, _) in measure.TESTS.items():
        for name in names:
            sense = "minimum" if FIGURES[name].bad < 0.0 else "maximum"
            settings = ", ".join(filter(None, (f'kind = "{kind}"', TESTS[kind])))
            lines.append(f'[[requirements]]\nname = "{kind}.{name}"\ntest = {{ {settings} }}\nfigure = "{name}"\n'
                         f'{sense} = "{LIMITS[FIGURES[name].unit]}"\noptional = true')
    return "\n".join(lines)


def verdicts(model: str, folder: Path) -> dict[str, list[Any]]:
    """Return of each requirement the measured value, margin, margin in percent, whether it is met, and its text."""
    path, parameters = folder / "all.toml", load_parameters(model=model)
    path.write_text(specification(model), encoding="utf-8")
    return {j.name: [*numbers([j.measured, j.margin, j.margin_percent]), j.passed, str(j)]
            for j in judge(ParameterSubject(parameters), load_requirements(path, parameters))}


def numbers(value: Any) -> Iterator[Any]:
    """Yield the texts and numbers in a value; an array gives its mark."""
    if is_dataclass(value):
        yield from numbers([getattr(value, field.name) for field in fields(value)])
    elif isinstance(value, Mapping):
        yield from numbers([part for item in value.items() for part in item])
    elif isinstance(value, str) or value is None:
        yield value
    elif isinstance(value, (list, tuple)) or np.ndim(value) > 1:
        for part in value:
            yield from numbers(part)
    elif np.iscomplexobj(value):
        yield from numbers([np.real(value), np.imag(value)])
    else:
        finite = np.nan_to_num(np.atleast_1d(value), nan=-7.0, posinf=-11.0, neginf=-13.0)
        yield float(f"{mark(finite):.12g}")


def excitations(folder: Path) -> dict[str, list[Any]]:
    """Return the marks of one excitation of each kind."""
    path = folder / "inputs.csv"
    path.write_text("time,fin_command,aero_torque\n0.003,0.1,5\n0.01,-0.2,6\n0.01,0.3,6.5\n0.0241,0.1,-7\n0.03,0.2,1\n",
                    encoding="utf-8")
    by_kind: dict[str, Excitation] = {
        "step": excitation.step_to(0.2, 0.12, 30.0, 2e-3), "slew": excitation.slew_to(-0.3, 0.2, 60.0, 0.15),
        "sweep": excitation.sweep(0.02, 0.7, 0.8, 19.0), "sine": excitation.sine(0.03, 12.0),
        "sines": excitation.sine(0.03, np.array([3.0, 7.0, 11.0]), np.array([2.0, 4.0, 5.0]), (1.5, 0.2),
                                 "aero_torque"),
        "sine from rest": excitation.sine_from_rest(0.02, 9.0, 0.3), "ramp": excitation.load_ramp(70.0, 0.25),
        "staircase": excitation.staircase([0.1, -0.2, 0.05], [0.02, 0.05, 0.033]),
        "case": excitation.reference_case("sag", supply=30.0),
        "case with encoder": excitation.reference_case("chirp_1deg", False),
        "file": excitation.csv_file(path, 2e-3, 0.04)}
    return {name: list(numbers([e, e.time, e.stop, len(e.moves), e.moves[-3:], e.judged(e.time), e.of(1), e.of(-1)]))
            for name, e in by_kind.items()}


def synthetic_figures() -> dict[str, list[Any]]:
    """Return the marks of figures of synthetic columns, of one run and of several runs."""
    time = np.arange(1501) * 2e-3
    since = np.maximum(time - 0.2, 0.0)
    responses = np.array([level * (1.0 - np.exp(-rate * since) * np.cos(4.0 * rate * since))
                          for level, rate in ((0.2, 6.0), (0.19, 2.0), (-0.1, 9.0))])
    power = 30.0 * np.sin(7.0 * time) + 12.0
    sweep = excitation.sweep(0.02, 6.0)
    lagged = np.convolve(sweep.command, 0.05 * 0.95 ** np.arange(400))[:len(sweep.time)]
    response = frequency_response(sweep.time, sweep.command, lagged, 0.7, 22.0)
    several = np.array([[0.1, 0.13, 0.08], [-0.2, -0.25, -0.21], [0.4, np.nan, 0.3]])
    weights = metrics.leap_weights(60, 0.01, np.array([0.083, 0.2, 0.4449, 0.581]))
    results = {
        "errors": metrics.errors(responses[0], responses[1]),
        "steps": [metrics.step_metrics(time, each, 0.2, level)
                  for each in (responses, responses[0]) for level in (0.2, -0.1)],
        "rates": [metrics.sustained_rate(time, each, 0.2, 0.15) for each in responses],
        "leaps": [weights, metrics.power_figures(power[:60], weights)],
        "frequency response": [response, response.gain_db, *response.crossings, *response.stated, swept(response)],
        "fundamental": [Sines(np.array([2.0, 11.0 / 6.0]), (1.0, 0.6), (2.0, 0.9), 2e-3, drift).fit(
            responses[:2] + 0.3 * np.cos(11.0 * time)) for drift in (True, False)],
        "held": held(0.3 + 0.2j, 9.0, 4e-3), "breakaway": metrics.breakaway(power, responses[0]),
        "bidirectional": metrics.bidirectional(several, several[::-1] * 0.9),
        "units": [[metrics.unit_of(key), metrics.in_words(key)] for key in (
            "a_n_m_per_rad", "b_deg_per_s", "c_l_per_min", "d_percent", "e_n_m", "f_deg", "g_mpa", "h_hz", "i_db",
            "j_s", "k_v", "l_a", "m_w", "n_j", "o")],
        "displayed": metrics.displayed(dict.fromkeys(FIGURES, 1.7))}
    return {name: list(numbers(value)) for name, value in results.items()}


def write() -> None:
    """Write the numbers, one line per list."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        results = {"excitations": excitations(path), "figures": synthetic_figures(),
                   **{model: verdicts(model, path) for model in JUDGED}}
    sections = (f"{json.dumps(name)}: {{\n" + ",\n".join(
        f" {json.dumps(key)}: {json.dumps(values)}" for key, values in rows.items()) + "\n}"
        for name, rows in results.items())
    FILE.write_text("{" + ",\n".join(sections) + "}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write()
