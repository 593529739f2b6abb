"""The page's scripts beside what they are ports of."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench import excitation as excitations
from emcas_fmu.bench import metrics
from emcas_fmu.bench.excitation import Excitation, csv_file
from emcas_fmu.bench.subject import ParameterSubject, Run
from emcas_fmu.bench.verdict import REQUIREMENTS, judge_table2, table2_excitations
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.explore import page

from .browser import Browser, written

DEG = math.radians(1.0)
# Sums are taken in another order, and sin and expm1 are another library's: last digits of 12 000 terms.
ROUNDING = 1e-9


@pytest.fixture
def scripts(browser: Browser) -> Browser:
    """Any page, of which the functions alone are called."""
    browser.keep_open()
    return browser


@pytest.fixture(scope="module")
def runs() -> Mapping[str, Run]:
    """The runs of Table 2."""
    subject = ParameterSubject(load_parameters())
    return {name: subject.run(each) for name, each in table2_excitations().items()}


def run_of(run: Run, names: Iterable[str] | None = None) -> str:
    """A run as the scripts have it, as JavaScript; with all outputs, or those named."""
    names = run.columns.keys() - {"time"} if names is None else names
    columns = json.dumps({name: column.tolist() for name, column in run.excitation.columns.items()})
    outputs = json.dumps({name: column.tolist() for name, column in run.columns.items() if name in names})
    return ("(() => { const typed = columns => Object.fromEntries(Object.entries(columns).map(([name, column]) => "
            f"[name, Float64Array.from(column)])); return {{excitation: {{time: Float64Array.from("
            f"{json.dumps(run.excitation.time.tolist())}), begin: {run.excitation.begin}, columns: typed({columns})}}, "
            f"outputs: typed({outputs})}}; }})()")


def columns_of(browser: Browser, script: str) -> dict[str, np.ndarray[Any, Any]]:
    made = browser.run(f"(e => ({{time: [...e.time], begin: e.begin, columns: Object.fromEntries("
                       f"Object.entries(e.columns).map(([n, c]) => [n, [...c]]))}}))({script})")
    return {"time": np.array(made["time"]), "begin": made["begin"],
            **{name: np.array(column) for name, column in made["columns"].items()}}


def test_a_page_whose_unit_does_not_run_says_so(browser: Browser, tmp_path: Path,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "compiled", lambda files: b"")
    browser.open(written(tmp_path, "nonlinear"))
    assert "does not run the page's unit" in browser.run("document.getElementById('problems').textContent")


def test_messages_have_their_numbers_as_in_python(scripts: Browser) -> None:
    rng = np.random.default_rng(1)
    numbers = [0.0, 1.0, -1.0, 0.1, 123456.0, 1234567.0, 999999.5, 1e-4, 9.9999995e-5, 1e-300, 1e300, 20.0, 100000.0,
               *(rng.standard_normal(200) * 10.0 ** rng.integers(-12, 12, 200)).tolist()]
    for digits in (4, 6, 9):
        found = scripts.run(f"arguments[0].map(x => general(x, {digits}))", numbers)
        assert found == [f"{x:.{digits}g}" for x in numbers]
    said = scripts.run("formatted('%s = %.9g is 5 %% above %.6g', ['a.b', 0.1, 1e-7])")
    assert said == "a.b = 0.1 is 5 % above 1e-07"


@pytest.mark.parametrize(("shape", "fields", "made"), [
    ("step", {"amplitude": 10 * DEG, "load": -50.0, "duration": 0.5}, excitations.step_to(10 * DEG, 0.5, -50.0)),
    ("step", {"amplitude": -3 * DEG, "load": 0.0, "duration": 1.0}, excitations.step_to(-3 * DEG, 1.0)),
    ("slew", {"amplitude": 20 * DEG, "load": -100.0, "duration": 0.6}, excitations.slew_to(20 * DEG, 0.6, -100.0)),
    ("load", {"load": 80.0, "duration": 0.5}, excitations.step_to(0.0, 0.5, 80.0)),
    ("sine", {"amplitude": DEG, "frequency": 5.0, "load": 0.0, "duration": 1.0},
     excitations.sine_from_rest(DEG, 5.0, 1.0)),
    ("chirp", {"amplitude": DEG, "low": 0.5, "high": 30.0, "load": 0.0, "duration": 12.0},
     excitations.sweep(DEG, 12.0)),
], ids=["step under load", "step", "slew", "load", "sine", "chirp"])
def test_excitations_are_the_bench_s(scripts: Browser, shape: str, fields: dict[str, float], made: Excitation) -> None:
    found = columns_of(scripts, f"SHAPES.{shape}.build({json.dumps(fields)})")
    assert found.pop("begin") == made.begin
    np.testing.assert_array_equal(found.pop("time"), made.time)
    assert found.keys() == made.columns.keys()
    for name, column in made.columns.items():
        np.testing.assert_allclose(found[name], column, rtol=0, atol=ROUNDING * np.max(np.abs(column), initial=1e-300))


def test_runs_of_table_2_are_the_bench_s(scripts: Browser, runs: Mapping[str, Run]) -> None:
    for name, run in runs.items():
        found = columns_of(scripts, f"ofTable2(DATA.runs.{name})")
        assert found.pop("begin") == run.excitation.begin
        np.testing.assert_array_equal(found.pop("time"), run.excitation.time)
        for column, values in run.excitation.columns.items():
            # A sweep is rounded to nine digits, of which the last may go the other way.
            atol = 1e-8 * np.max(np.abs(values)) if "chirp" in name else 0.0
            np.testing.assert_allclose(found[column], values, rtol=0, atol=atol, err_msg=f"{name} {column}")


def test_figures_are_the_bench_s(scripts: Browser, runs: Mapping[str, Run]) -> None:
    for name in ("step_plus20", "hold_minus1"):
        run = runs[name]
        whole = replace(run, excitation=replace(run.excitation, begin=0.0))  # as emcas simulate has it
        expected = {**metrics.motion(run, -1), **metrics.usage(whole)}
        found = scripts.run(f"figures({run_of(run)})")
        assert found.keys() == expected.keys()
        # A steady error is a small difference of angles: 1e-12 rad is the rounding of those.
        assert found == pytest.approx(expected, rel=ROUNDING, abs=1e-12)


def test_requirements_are_judged_as_by_the_bench(scripts: Browser, runs: Mapping[str, Run]) -> None:
    given = ", ".join(f"{name}: (run => ({{...run, frequency: DATA.runs.{name}.sweep && frequencyResponse(run)}}))"
                      f"({run_of(run, ('fin_angle', 'fin_rate'))})" for name, run in runs.items())
    found = scripts.run(f"(runs => DATA.requirements.map(r => judged(r, runs)))({{{given}}})")
    for requirement, j, one in zip(REQUIREMENTS, judge_table2(runs), found, strict=True):
        assert j.measured is not None
        assert one["value"] == pytest.approx(j.measured, rel=ROUNDING, abs=1e-12), requirement.name
        assert (one["passed"], bool(one["beyond"])) == (j.passed, j.beyond)


def test_frequency_response_is_the_bench_s(scripts: Browser, runs: Mapping[str, Run]) -> None:
    run = runs["chirp_1deg"]
    expected = metrics.sweep_response(run)
    found = scripts.run(f"frequencyResponse({run_of(run, ['fin_angle'])})")
    np.testing.assert_allclose(found["frequency"], expected.frequency, rtol=ROUNDING)
    np.testing.assert_allclose(found["gain"], expected.gain_db, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found["phase"], expected.phase, rtol=0, atol=ROUNDING)
    assert found["phase_bandwidth"] == pytest.approx(expected.phase_bandwidth, rel=ROUNDING)


CSV = {
    "plain": "time,fin_command\n0,0\n0.05,0\n0.05,0.1\n0.3,0.1\n",
    "quoted, with a load": '\ufeff"time", "fin_command", "aero_torque"\n0.01,0,1\n0.1,0.2,2\n0.2,0.1,-3\n\n',
}
NO_CSV = {
    "no time": "t,fin_command\n0,0\n1,0\n", "no input": "time,angle\n0,0\n1,0\n", "time alone": "time\n0\n1\n",
    "backwards": "time,fin_command\n0,0\n0.2,0\n0.1,0\n", "negative": "time,fin_command\n-1,0\n0.1,0\n",
    "text": "time,fin_command\n0,0\n1,x\n", "an empty cell": "time,fin_command\n0,0\n1,\n", "nothing": "",
    "twice": "time,fin_command,fin_command\n0,0,0\n1,0,0\n", "short": "time,fin_command\n0,0\n0.0001,0\n",
    "between rows": "time,fin_command\n0,0\n0.1003,0\n",
}


@pytest.mark.parametrize("text", CSV.values(), ids=CSV)
def test_a_csv_file_is_read_as_by_simulate(scripts: Browser, text: str, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(text, encoding="utf-8")
    made = csv_file(path)
    found = columns_of(scripts, f"({{begin: 0, ...fromCsv({json.dumps(text)}, 'inputs.csv')}})")
    np.testing.assert_array_equal(found["time"], made.time)
    for name, column in made.columns.items():
        np.testing.assert_array_equal(found[name], column)


@pytest.mark.parametrize("text", NO_CSV.values(), ids=NO_CSV)
def test_what_is_no_csv_file_is_refused_as_by_simulate(scripts: Browser, text: str, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(EmcasError):
        csv_file(path)
    said = scripts.run(f"(() => {{ try {{ fromCsv({json.dumps(text)}, 'inputs.csv'); }} "
                       "catch (error) { return error.message; } })()")
    assert said.startswith("inputs.csv: ")


def test_a_link_holds_a_setting(scripts: Browser) -> None:
    values = {"excitation.shape": "slew", "excitation.amplitude": 0.2, "controller.position.kp": 71.5,
              "encoder.enabled": False, "friction.temperature": -6.0}
    text = scripts.run("new Setting(arguments[0]).toString()", values)
    found = scripts.run("(([setting, unknown]) => [setting.values, unknown])(Setting.parse(arguments[0]))",
                        text + "&no.such=1&motor.resistance=abc")
    assert found == [values, ["no.such", "motor.resistance"]]


def test_a_parameter_file_has_what_differs(scripts: Browser, tmp_path: Path) -> None:
    changed = {"controller.position.kp": 71.5, "friction.coulomb.positive[1]": 0.1 * 0.1, "encoder.enabled": False,
               "encoder.pulses": 1024, "motor.torque_constant": 0.12}
    path = tmp_path / "parameters.toml"
    path.write_text(scripts.run("parameterFile(new Setting(arguments[0]))", {**changed, "supply_voltage": 28.0}),
                    encoding="utf-8")
    # Alone in a file, the torque constant would move the back-EMF constant.
    expected = {**load_parameters().values, **changed, "drive.supply_voltage": 28.0}
    assert load_parameters(path).values == expected
    assert path.read_text(encoding="utf-8").count("\n") == 2 + len(changed) + 2
