"""The page's scripts compared with the package's Python functions."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu import motions
from emcas_fmu.bench import excitation as excitations
from emcas_fmu.bench import measure, metrics
from emcas_fmu.bench.excitation import Excitation, csv_file
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import Judged, judge
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.explore import page

from .browser import Browser, write_page

DEG = math.radians(1.0)
# Relative. Rounding in sums of 12 000 terms in another order, and sin and expm1 of another library.
ROUNDING = 1e-9
# Relative. Numerical derivatives have errors of 1e-7 of a Jacobian, splines between the bench's frequencies 1e-6 of a
# margin: together 1.5e-6 at most (ristanovic).
MARGINS = 1e-5


@pytest.fixture
def scripts(browser: Browser) -> Browser:
    """A page whose functions can be called."""
    browser.open_default()
    return browser


@pytest.fixture(scope="module")
def subject() -> ParameterSubject:
    """The default actuator."""
    return ParameterSubject(load_parameters())


def run_of(run: Run, names: Iterable[str] | None = None) -> str:
    """Return a run as an expression of JavaScript, with all outputs or the named ones."""
    names = run.columns.keys() - {"time"} if names is None else names
    columns = json.dumps({name: column.tolist() for name, column in run.excitation.columns.items()})
    outputs = json.dumps({name: column.tolist() for name, column in run.columns.items() if name in names})
    return ("(() => { const typed = columns => Object.fromEntries(Object.entries(columns).map(([name, column]) => "
            f"[name, Float64Array.from(column)])); return {{excitation: {{time: Float64Array.from("
            f"{json.dumps(run.excitation.time.tolist())}), begin: {run.excitation.begin}, columns: typed({columns})}}, "
            f"outputs: typed({outputs})}}; }})()")


def columns_of(browser: Browser, script: str) -> dict[str, np.ndarray[Any, Any]]:
    """Return time, begin and inputs of the excitation that a script returns."""
    excitation = browser.run(f"(e => ({{time: [...e.time], begin: e.begin, columns: Object.fromEntries("
                             f"Object.entries(e.columns).map(([n, c]) => [n, [...c]]))}}))({script})")
    return {"time": np.array(excitation["time"]), "begin": excitation["begin"],
            **{name: np.array(column) for name, column in excitation["columns"].items()}}


def test_page_that_cannot_run_its_actuator_has_a_message(browser: Browser, tmp_path: Path,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "compiled", lambda files: b"")
    browser.open(write_page(tmp_path, "nonlinear"))
    assert "cannot run the page's actuator" in browser.run("document.getElementById('problems').textContent")


def test_numbers_are_formatted_as_in_python(scripts: Browser) -> None:
    rng = np.random.default_rng(1)
    numbers = [0.0, 1.0, -1.0, 0.1, 123456.0, 1234567.0, 999999.5, 1e-4, 9.9999995e-5, 1e-300, 1e300, 20.0, 100000.0,
               *(rng.standard_normal(200) * 10.0 ** rng.integers(-12, 12, 200)).tolist()]
    for digits in (4, 6, 9):
        found = scripts.run(f"arguments[0].map(x => general(x, {digits}))", numbers)
        assert found == [f"{x:.{digits}g}" for x in numbers]
    text = scripts.run("formatted('%s = %.9g is 5 %% above %.6g', ['a.b', 0.1, 1e-7])")
    assert text == "a.b = 0.1 is 5 % above 1e-07"


EXCITATIONS: list[tuple[str, dict[str, float]]] = [
    ("step", {"amplitude": 10 * DEG, "torque": -50.0, "duration": 0.5}),
    ("step", {"amplitude": -3 * DEG, "torque": 0.0, "duration": 1.0}),
    ("slew", {"amplitude": 20 * DEG, "torque": -100.0, "settle": 0.4, "duration": 0.6}),
    ("load", {"amplitude": 0.0, "torque": 80.0, "duration": 0.5}),
    ("sine", {"amplitude": DEG, "frequency": 5.0, "torque": 30.0, "duration": 1.0}),
    ("sweep", {"amplitude": DEG, "low": 0.5, "high": 30.0, "torque": 0.0, "duration": 12.0})]


@pytest.mark.parametrize(("kind", "fields"), EXCITATIONS)
def test_excitations_equal_the_bench_s(scripts: Browser, kind: str, fields: dict[str, float]) -> None:
    expected = excitations.motion(kind, **fields)
    found = columns_of(scripts, f"excitationOf('{kind}', {json.dumps(fields)})")
    assert found.pop("begin") == expected.begin
    np.testing.assert_array_equal(found.pop("time"), expected.time)
    assert found.keys() == expected.columns.keys()
    for name, column in expected.columns.items():
        np.testing.assert_allclose(found[name], column, rtol=0, atol=ROUNDING * np.max(np.abs(column), initial=1e-300))


def test_excitations_above_contain_every_kind_of_the_page(scripts: Browser) -> None:
    assert {*scripts.run("Object.keys(SHARES)")} == {kind for kind, _ in EXCITATIONS}
    usual = [name for name, kind in motions.EXCITATIONS.items() if kind.usual]
    assert scripts.run("Object.keys(DATA.kinds)") == [*usual, "csv"]


def test_excitations_of_requirements_have_the_bench_s_bits(scripts: Browser, subject: ParameterSubject) -> None:
    """At another supply voltage than the page's."""
    changed = ParameterSubject(subject.parameters.with_values({"drive.supply_voltage": 31.7}))
    listed = load_requirements(None, changed.parameters).requirements
    tests = dict.fromkeys(r.test for r in listed if r.test)
    starts = {name: float(v.initial(changed.values)) for name, v in changed.inputs.items()}
    assert len(tests) == scripts.run("DATA.tests.length")
    for k, test in enumerate(tests):
        runs: Iterable[Excitation] = (
            () if test.kind in ("sine", "linear") else
            measure.histories(test, changed, starts) if test.kind == "repeat" else
            [measure.excitation(test, sign, changed) for sign in (1.0, -1.0)])
        for run, each in enumerate(runs):
            found = columns_of(
                scripts, f"testExcitation(DATA.tests[{k}].runs[{run}], new Setting({{supply_voltage: 31.7}}))")
            assert found.pop("begin") == each.begin
            np.testing.assert_array_equal(found.pop("time"), each.time)
            assert found.keys() == each.columns.keys()
            for name, column in each.columns.items():
                np.testing.assert_array_equal(found[name], column, err_msg=f"{test} {name}")


def test_figures_equal_the_bench_s(scripts: Browser, subject: ParameterSubject) -> None:
    for name in ("step_plus20", "step_minus1"):
        run = subject.run(excitations.reference_case(name, exact=False))
        whole = replace(run, excitation=replace(run.excitation, begin=0.0))  # as `emcas simulate` does
        expected = {**metrics.motion_figures(run, -1), **metrics.usage_figures(whole)}
        found = scripts.run(f"figures({run_of(run)})")
        assert found.keys() == expected.keys()
        # A steady error is a small difference of angles, whose rounding is 1e-12 rad.
        assert found == pytest.approx(expected, rel=ROUNDING, abs=1e-12)


def check_verdict(browser: Browser, expected: Sequence[Judged], values: Mapping[str, Any] | None = None) -> None:
    """Assert that the open page judges a setting as the bench does."""
    found = browser.run("(measured => DATA.requirements.map(r => r.left_out ? null : judged(r, measured)))("
                        "COMPUTATIONS.measured(window.page.actuator, new Setting(arguments[0])))", values or {})
    for j, one in zip(expected, found, strict=True):
        if one is None:
            assert j.skipped, j.name
            continue
        assert not j.skipped, j.name
        assert (one["passed"], bool(one["bound"])) == (j.passed, j.beyond), j.name
        if j.measured is None:
            assert one["value"] is None or not math.isfinite(one["value"]), j.name
        else:
            # As in test_figures_equal_the_bench_s; sines differ in their last bit, which does not affect bisections.
            limit = MARGINS if j.figure.endswith("_margin") else ROUNDING
            assert one["value"] == pytest.approx(j.measured, rel=limit, abs=1e-9), j.name
            assert j.case in ("", one["case"]), j.name
            # A margin is a difference of two values; a small one has a larger relative error.
            assert one["margin"] == pytest.approx(j.margin, rel=limit, abs=limit * max(1.0, abs(j.limit))), j.name
            assert one["percent"] == pytest.approx(j.margin_percent, rel=limit, abs=100.0 * limit), j.name


COLD = {"friction.temperature": -40.0, "supply_voltage": 25.0, "controller.position.kp": 80.0}


@pytest.mark.parametrize("changes", [{}, COLD], ids=["default", "cold"])
def test_verdicts_equal_the_bench_s(scripts: Browser, subject: ParameterSubject, changes: Mapping[str, Any]) -> None:
    renamed = {"drive.supply_voltage" if name == "supply_voltage" else name: x for name, x in changes.items()}
    changed = ParameterSubject(subject.parameters.with_values(renamed))
    expected = judge(changed, load_requirements(None, changed.parameters))
    assert changes or all(j.passed for j in expected)
    check_verdict(scripts, expected, changes)


TESTS = {"step": ('{ kind = "step", amplitude = "5 deg", torque = "-60 N*m" }',), "sine": (
            '{ kind = "sine", amplitude = "1 deg" }', '{ kind = "sine", amplitude = "0.05 deg" }'),
         "slew": ('{ kind = "slew", amplitude = "90 %", duration = "0.4 s", supply = "60 %" }',),
         "load": ('{ kind = "load", torque = "-390 N*m", duration = "0.5 s" }',),
         "release": ('{ kind = "release", torque = "-200 N*m", settle = "0.4 s" }',),
         "repeat": ('{ kind = "repeat", amplitude = "10 deg", torque = "300 N*m" }',),
         "linear": ('{ kind = "linear" }',)}


@pytest.fixture
def every_figure(tmp_path: Path) -> Path:
    """A file with requirements for every figure of every test, in two cases."""
    entries = [f"[[requirements]]\nname = '{kind}_{k}_{figure}'\ntest = {test}\nfigure = '{figure}'\n{sense} = "
               f"'1 {metrics.FIGURES[figure].unit}'\n".replace("1 1", "1").replace("1 Hz", "10 Hz")
               for kind, tests in TESTS.items() for k, test in enumerate(tests)
               for figure in measure.TESTS[kind].figures
               for sense in (["maximum"] if metrics.FIGURES[figure].bad > 0.0 else ["minimum"])]
    path = tmp_path / "mine.toml"
    path.write_text("[cases]\nweak = { 'motor.torque_constant' = '90 %' }\ncold = { 'friction.temperature' = "
                    "'-40 degC' }\n" + "".join(entries), encoding="utf-8")
    return path


def test_every_figure_equals_the_bench_s_in_the_worst_case(
        browser: Browser, subject: ParameterSubject, every_figure: Path, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch) -> None:
    browser.open_default()
    unit = browser.run("document.getElementById('actuator').textContent")
    monkeypatch.setattr(page, "compiled", lambda files: zlib.decompress(base64.b64decode(unit), -zlib.MAX_WBITS))
    expected = judge(subject, load_requirements(every_figure, subject.parameters))
    assert {j.case for j in expected} == {"weak", "cold"}
    assert {j.name[:4] for j in expected if j.measured is None} >= {"load", "sine"}
    browser.open(write_page(tmp_path, "nonlinear", every_figure))
    check_verdict(browser, expected)
    browser.run_and_finish("window.page.refresh()")
    assert browser.complaints == []
    assert browser.run("document.querySelectorAll('#requirements tbody tr').length") == len(expected)


@pytest.mark.slow  # zig makes its C library for a browser: a minute, once
@pytest.mark.parametrize("model", ["electrohydraulic", "elastic+homing"])
def test_verdicts_on_other_actuators_equal_the_bench_s(browser: Browser, model: str, tmp_path: Path) -> None:
    parameters = load_parameters(model=model)
    expected = judge(ParameterSubject(parameters), load_requirements(None, parameters))
    browser.open(write_page(tmp_path, model))
    check_verdict(browser, expected)
    browser.run_and_finish("window.page.refresh()")
    assert browser.complaints == []


@pytest.mark.parametrize("amplitude", [DEG, 10.0 * DEG], ids=["sines", "no sines above 18 Hz"])
def test_frequency_response_equals_the_bench_s(scripts: Browser, subject: ParameterSubject, amplitude: float) -> None:
    found = scripts.run("frequencyResponse(arguments[0], 0, responding(window.page.actuator, new Setting(), {}))",
                        amplitude)
    grid = np.array(measure.GRID)
    expected = measure.describing_function(subject, [{}] * len(grid), amplitude, measure.GRID)
    pure = np.isfinite(expected)
    assert pure.all() == (amplitude == DEG)
    at = [found["frequency"].index(f) for f in grid[pure].tolist()]
    assert not {*found["frequency"]} & {*grid[~pure].tolist()}
    response = 10.0 ** (np.array(found["gain"])[at] / 20.0) * np.exp(1j * np.radians(found["phase"])[at])
    np.testing.assert_allclose(response, expected[pure], rtol=0, atol=ROUNDING)
    assert np.all(np.abs(np.diff(found["phase"])) < 180.0)


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
def test_csv_file_is_read_as_by_simulate(scripts: Browser, text: str, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(text, encoding="utf-8")
    expected = csv_file(path)
    found = columns_of(scripts, f"({{begin: 0, ...fromCsv({json.dumps(text)}, 'inputs.csv')}})")
    np.testing.assert_array_equal(found["time"], expected.time)
    for name, column in expected.columns.items():
        np.testing.assert_array_equal(found[name], column)


@pytest.mark.parametrize("text", NO_CSV.values(), ids=NO_CSV)
def test_wrong_csv_file_is_refused_as_by_simulate(scripts: Browser, text: str, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(EmcasError):
        csv_file(path)
    message = scripts.run(f"(() => {{ try {{ fromCsv({json.dumps(text)}, 'inputs.csv'); }} "
                       "catch (error) { return error.message; } })()")
    assert message.startswith("inputs.csv: ")


def test_text_of_a_setting_restores_it(scripts: Browser) -> None:
    values = {"excitation.kind": "slew", "excitation.amplitude": 0.2, "controller.position.kp": 71.5,
              "encoder.enabled": False, "friction.temperature": -6.0}
    text = scripts.run("new Setting(arguments[0]).toString()", values)
    found = scripts.run("(([setting, unknown]) => [setting.values, unknown])(Setting.parse(arguments[0]))",
                        text + "&no.such=1&motor.resistance=abc")
    assert found == [values, ["no.such", "motor.resistance"]]


def test_parameter_file_has_the_changed_values(scripts: Browser, tmp_path: Path) -> None:
    changed = {"controller.position.kp": 71.5, "friction.coulomb.positive[1]": 0.1 * 0.1, "encoder.enabled": False,
               "encoder.pulses": 1024, "motor.torque_constant": 0.12}
    path = tmp_path / "parameters.toml"
    path.write_text(scripts.run("parameterFile(new Setting(arguments[0]))", {**changed, "supply_voltage": 28.0}),
                    encoding="utf-8")
    # A file with the torque constant alone would change the back-EMF constant, too.
    expected = {**load_parameters().values, **changed, "drive.supply_voltage": 28.0}
    assert load_parameters(path).values == expected
    assert path.read_text(encoding="utf-8").count("\n") == 2 + len(changed) + 2
