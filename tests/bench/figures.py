"""What the bench gives, as numbers that are kept: excitations, figures, and every figure of every kind of test judged.

    python -m tests.bench.figures        # writes them anew

As with the table of trajectories, a test compares, and the numbers show that something moved, not that it is right.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.bench import excitation, metrics
from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.frequency_response import frequency_response, fundamental, held, swept
from emcas_fmu.bench.measure import KINDS
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
# Some of the limits are kept and some are not.
LIMITS: Mapping[str, str] = {"s": "60 ms", "rad": "0.9 deg", "rad/s": "150 deg/s", "A": "11 A", "W": "400 W",
                             "J": "12 J", "Hz": "15 Hz", "dB": "9 dB", "1": "7 %"}
# Actuators whose bench is judged, by a parameter that a case of it changes.
JUDGED: Mapping[str, str] = {
    "nonlinear": '"controller.position.kp" = "70 %"\n"command.limit" = "17 deg"',
    "second-order": '"second_order.rate_limit" = "60 %"'}


def specification(model: str) -> str:
    """Return a file of requirements with every figure of every kind of test."""
    lines = ["[cases.nominal]\n[cases.other]\n" + JUDGED[model]]
    for kind, figures in KINDS.items():
        for name in figures:
            sense = "minimum" if FIGURES[name].bad < 0.0 else "maximum"
            settings = ", ".join(filter(None, (f'kind = "{kind}"', TESTS[kind])))
            lines.append(f'[[requirements]]\nname = "{kind}.{name}"\ntest = {{ {settings} }}\nfigure = "{name}"\n'
                         f'{sense} = "{LIMITS[FIGURES[name].unit]}"\noptional = true')
    return "\n".join(lines)


def judged(model: str, folder: Path) -> dict[str, list[Any]]:
    """Return what is judged of a model: measured, margin and its share, whether it is kept, and all in words."""
    path, p = folder / "all.toml", load_parameters(model=model)
    path.write_text(specification(model), encoding="utf-8")
    return {j.name: [*numbers([j.measured, j.margin, j.margin_percent]), j.passed, str(j)]
            for j in judge(ParameterSubject(p), load_requirements(path, p))}


def numbers(value: Any) -> Iterator[Any]:
    """Give what a value is made of, texts and numbers: of an array its mark."""
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
        yield _short(mark(np.nan_to_num(np.atleast_1d(value), nan=-7.0, posinf=-11.0, neginf=-13.0)))


def excited(folder: Path) -> dict[str, list[Any]]:
    """Return the marks of an excitation of each kind."""
    path = folder / "inputs.csv"
    path.write_text("time,fin_command,aero_torque\n0.003,0.1,5\n0.01,-0.2,6\n0.01,0.3,6.5\n0.0241,0.1,-7\n0.03,0.2,1\n",
                    encoding="utf-8")
    made: dict[str, Excitation] = {
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
            for name, e in made.items()}


def measured() -> dict[str, list[Any]]:
    """Return the marks of figures of made-up columns, of one run and of several."""
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
    found = {
        "errors": metrics.errors(responses[0], responses[1]),
        "steps": [metrics.step_metrics(time, each, 0.2, level)
                  for each in (responses, responses[0]) for level in (0.2, -0.1)],
        "rates": [metrics.sustained_rate(time, each, 0.2, 0.15) for each in responses],
        "energies": metrics.energies(time, power), "leaps": [weights, metrics.leaping_power(power[:60], weights)],
        "frequency response": [response, response.gain_db, *response.crossings, *response.stated, swept(response)],
        "fundamental": [fundamental(time, responses[0] + 0.3 * np.cos(11.0 * time), 11.0 / 6.0, drift)
                        for drift in (True, False)],
        "held": held(0.3 + 0.2j, 9.0, 4e-3), "breakaway": metrics.breakaway(power, responses[0]),
        "bidirectional": metrics.bidirectional(several, several[::-1] * 0.9),
        "units": [[metrics.unit_of(key), metrics.in_words(key)] for key in (
            "a_n_m_per_rad", "b_deg_per_s", "c_l_per_min", "d_percent", "e_n_m", "f_deg", "g_mpa", "h_hz", "i_db",
            "j_s", "k_v", "l_a", "m_w", "n_j", "o")],
        "displayed": metrics.displayed(dict.fromkeys(FIGURES, 1.7))}
    return {name: list(numbers(value)) for name, value in found.items()}


def _short(value: float) -> float:
    return float(f"{value:.12g}")


def figures() -> dict[str, dict[str, list[Any]]]:
    """Return all that is kept."""
    with tempfile.TemporaryDirectory() as folder:
        return {"excitations": excited(Path(folder)), "figures": measured(),
                **{model: judged(model, Path(folder)) for model in JUDGED}}


def write() -> None:
    """Write the numbers, a line for each list."""
    sections = (f"{json.dumps(name)}: {{\n" + ",\n".join(
        f" {json.dumps(key)}: {json.dumps(values)}" for key, values in rows.items()) + "\n}"
        for name, rows in figures().items())
    FILE.write_text("{" + ",\n".join(sections) + "}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write()
