"""The linear analysis of every actuator with a position loop agrees with its simulation."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from html import unescape
from math import radians
from pathlib import Path
from typing import Any

import control as ct
import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.capabilities import POSITION_LOOP
from emcas_fmu.actuators.declaration import State
from emcas_fmu.bench.frequency_response import of_ratio
from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator, sound
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import heat
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis import sweep
from emcas_fmu.studies.analysis.analyse import _left_out, analyse
from emcas_fmu.studies.analysis.steps import compare
from tests.marks import others_slow
from tests.own_actuator.example import changed

from .conftest import growth, subject, without_friction

Values = Mapping[str, Any]
DIRECT_DRIVE = str(Path(__file__).parents[2] / "examples" / "own_actuator" / "direct_drive.py")
WARM = {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 40.0}
# Models, and the parameters that scale the loop's gain. The default actuator is in test_against_simulation.py.
GAINS = dict.fromkeys(("linear", "elastic", "habibi", "ozkan", "worm-gear", "worm-gear-elastic", "clutch",
                       "series-clutch", "electrohydrostatic", "elastic+heat"),
                      ("drive.current_gain",)) | {
    "ristanovic": ("pwm.gain",), "servo": ("controller.kp", "controller.kd"),
    "electrohydraulic": ("controller.position.kp", "controller.position.ki"),
    DIRECT_DRIVE: ("controller.kp", "controller.ki", "controller.kd")}
MODELS = tuple(GAINS)
# One for each kind of drive, lever and friction.
QUICK = ("elastic+heat", "worm-gear", "ristanovic", "servo", "electrohydraulic", DIRECT_DRIVE)
EACH = others_slow(MODELS, lambda model: model in QUICK)
# Without these effects the hydraulic actuators are smooth; check valves would open at a load of 0.5 N.m.
HYDRAULIC = {"transducer__resolution": 0.0, "cylinder__coulomb_friction": 0.0, "pump__coulomb_friction": 0.0,
             "pump__pressure_friction": 0.0, "check_valve__conductance": 0.0}
GRID = np.array([0.5, 2.0, 7.0, 12.0, 40.0])


def smooth(model: str, **more: Any) -> dict[str, Any]:
    """Return the default set without dry friction, backlash and encoder, as far as the actuator has them."""
    parameters = load_parameters(model=model)
    changes = without_friction(parameters.values, encoder__enabled=False, drive_line__backlash=0.0,
                               load__torsion_bar=30.0, friction__fin_viscous=2.0, worm__friction=0.0,
                               efficiency__forward=1.0, efficiency__backward=1.0,
                               motor__coulomb_friction=0.0, gear__backlash=0.0, friction__gear=0.0,
                               friction__gear_load=0.0, friction__gear_load_rise=0.0, **HYDRAULIC, **more) | WARM
    return {**parameters.values, **parameters.having(changes)}


def response(values: Values, model: str, at: float = 0.0) -> Any:
    return frequency.evaluate(LinearActuator(values, at, model=model).command_to_angle, GRID)


@pytest.mark.parametrize("model", [*MODELS, "nonlinear"])
def test_analysis_with_symbolic_gains_equals_analysis_with_numbers(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations are traced once for all gains; here they are also traced for these gains."""
    values = smooth(model)
    gains = [v.name for v in get(model).parameters if v.variability == "tunable" and v.name.startswith("controller.")]
    changed = {**values, **{name: 0.9 * values[name] for name in gains}}
    before, opened = response(values, model, 0.1), response(changed, model, 0.1)
    monkeypatch.setattr("emcas_fmu.bench.linear.actuator.gains_of", lambda *_: {})
    np.testing.assert_allclose(opened, response(changed, model, 0.1), rtol=1e-9)  # exact Jacobians: rounding
    assert np.max(np.abs(opened / before - 1.0)) > 1e-3


def test_every_actuator_with_a_position_loop_is_tested() -> None:
    assert {name for name in NAMES if POSITION_LOOP in get(name).provides} == {*MODELS, "nonlinear"} - {
        "elastic+heat", DIRECT_DRIVE}


@pytest.mark.parametrize("model", EACH)
def test_bandwidth_agrees_with_simulated_small_sines(model: str) -> None:
    values, at = smooth(model), radians(8.0)
    linear = frequency.response(LinearActuator(values, at, model=model).command_to_angle)
    near = np.concatenate([width + np.arange(-1.0, 1.1, 0.5) for width in (linear.bandwidth, linear.phase_bandwidth)])
    near = np.unique(np.round(2.0 * near)) / 2.0
    ratio = sweep.sines(subject(values, model), np.full(len(near), radians(0.02)), near, at)[:, 0]
    measured = of_ratio(near, ratio)
    # Measured 5e-4 at most: interpolation over 0.5 Hz, the lever's curvature, and the kernel's ticks.
    assert linear.bandwidth == pytest.approx(measured.bandwidth, rel=1e-3)
    assert linear.phase_bandwidth == pytest.approx(measured.phase_bandwidth, rel=1e-3)


@pytest.mark.parametrize("model", EACH)
def test_oscillations_begin_at_the_gain_margin(model: str) -> None:
    values = smooth(model)
    margins = frequency.margins(LinearActuator(values, model=model).loop("reference"))

    def grows(share: float) -> bool:
        factor = 1.0 + (margins.gain - 1.0) * share
        scaled = {**values, **{name: factor * values[name] for name in GAINS[model]}}
        return growth(scaled, 0.0, margins.phase_crossover, partial(simulate, model=model)) > 1.0

    # Measured 0.06 % of the margin at most: the kernel's ticks.
    assert [grows(share) for share in (0.998, 1.002)] == [False, True]


@pytest.mark.parametrize("model", EACH)
def test_small_load_step_agrees_with_the_linear_model(model: str) -> None:
    values = smooth(model, drive__current_offset=0.0)
    linear, torque = LinearActuator(values, model=model), 1.0
    time = np.arange(200) * linear.period
    expected = ct.forced_response(linear.load_to_angle, time, np.full(len(time), torque)).outputs
    found = simulate(values, float(time[-1]), linear.period, model=model, aero_torque=torque)["fin_angle"]
    # 1 % of the largest value, for the viscous friction, whose coefficients depend on the direction.
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.01 * np.max(np.abs(expected)))


@pytest.mark.parametrize("model", ["elastic", "habibi"])
def test_backlash_under_load_is_linearised_as_closed(model: str) -> None:
    gap = 5e-5
    values = smooth(model) | {"drive_line.backlash": gap}
    linear = LinearActuator(values, radians(8.0), -60.0, model)
    step = compare(values, linear, 0.02, thesis=False)
    # The load of 60 N.m keeps the flank in contact. The contact's stiffness changes the response:
    assert step.difference < 1.0
    free, closed = (response(v, model) for v in (values | {"drive_line.backlash": 0.0}, values))
    assert np.max(np.abs(closed / free - 1.0)) > 1e-4


@pytest.mark.parametrize(("model", "at", "torque"), [("elastic", 0.0, 0.0), ("elastic", 9.0, -40.0),
                                                     ("nonlinear", 9.0, -40.0)])
def test_load_observer_and_velocity_integral_are_linearised(model: str, at: float, torque: float) -> None:
    """The equilibrium of these controllers has an equation without a state, whose residual is rounding."""
    parameters = load_parameters(model=model)
    values = {**parameters.values, **parameters.having(without_friction(
        parameters.values, drive_line__backlash=0.0, controller__load_observer=250.0, controller__velocity__ki=0.4))}
    linear = LinearActuator(values, radians(at), torque, model)
    # Measured 0.02 % with counts of 2e-6 deg at the fin: the ratio's curvature and the kernel's ticks.
    assert compare({**values, "encoder.pulses": 1_000_000}, linear, 0.1, thesis=False).difference < 0.1


def test_zero_response_has_no_phase() -> None:
    frequencies = np.array([5.0, 60.0])
    ratio = sweep.sines(ParameterSubject(load_parameters(model="elastic")), np.full(2, radians(0.1)), frequencies)[:, 0]
    measured = of_ratio(frequencies, ratio)
    assert measured.gain[1] == 0.0
    assert np.isnan(measured.phase[1])
    assert -90.0 < np.degrees(measured.phase[0]) < 0.0


@pytest.mark.parametrize("on_fin", [False, True])
@pytest.mark.parametrize("encoder", [False, True])
def test_elastic_actuator_without_compliance_is_the_rigid_actuator(on_fin: bool, encoder: bool) -> None:
    rigid = {"drive_line.axial_compliance": 0.0, "drive_line.torsional_compliance": 0.0, "drive_line.backlash": 0.0,
             "encoder.on_fin": on_fin, "encoder.enabled": encoder, "loads.gravity": True}
    values = {**load_parameters(model="elastic").values, **rigid}
    plain = {name: values[name] for name in load_parameters().values}
    elastic, expected = LinearActuator(values, 0.1, -20.0, "elastic"), LinearActuator(plain, 0.1, -20.0)
    assert elastic.closed.nstates == expected.closed.nstates
    channels = ("command_to_angle", "load_to_angle")
    for system, other in [*((getattr(elastic, name), getattr(expected, name)) for name in channels),
                          *((elastic.loop(name), expected.loop(name)) for name in expected.loops)]:
        np.testing.assert_allclose(frequency.evaluate(system, GRID), frequency.evaluate(other, GRID), rtol=1e-9)


def test_stiff_drive_line_is_nearly_rigid() -> None:
    values = smooth("ozkan")
    rigid, stiff = (response({**values, "drive_line.torsional_compliance": c}, "ozkan") for c in (0.0, 1e-7))
    np.testing.assert_allclose(stiff, rigid, rtol=1e-5)  # the additional mode is near 1e5 rad/s


@pytest.mark.parametrize("extensions", ["stribeck", "lugre", "efficiency", "stribeck+efficiency"])
def test_friction_and_screw_losses_are_not_in_the_linear_model(extensions: str) -> None:
    model = f"nonlinear+{extensions}"
    np.testing.assert_array_equal(response(load_parameters(model=model).values, model, 0.1),
                                  response(load_parameters().values, "nonlinear", 0.1))


def test_heat_changes_resistance_and_magnets_by_the_start_temperatures() -> None:
    model = "nonlinear+heat"
    values = {**load_parameters(model=model).values, **WARM}
    p, ambient = get(model).namespace(values), values["friction.temperature"]
    warm = {"motor.resistance": heat.resistance(FLOATS, p, ambient + 80.0)} | {
        f"motor.{name}": values[f"motor.{name}"] * heat.magnets(FLOATS, p, ambient + 40.0)
        for name in ("torque_constant", "back_emf_constant")}
    plain = {**load_parameters().values}
    np.testing.assert_allclose(response(values, model), response({**plain, **warm}, "nonlinear"), rtol=1e-12)
    assert np.max(np.abs(response(values, model) / response(plain, "nonlinear") - 1.0)) > 1e-3


def test_faults_and_homing_are_left_out_of_the_linear_model() -> None:
    parameters = sound(load_parameters(model="elastic+heat+homing+faults").with_values({"fault.jam.active": True}))
    assert parameters.model == "elastic+heat"
    assert dict(parameters.values) == dict(load_parameters(model="elastic+heat").values)


def test_sampled_state_acts_without_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    """The direct drive's voltage as a sampled state instead of the reference gives the same loop."""
    plain = get(DIRECT_DRIVE)
    base = plain.derivatives
    assert base is not None

    def sample(ops: Any, p: Any, x: Any, inputs: Any) -> dict[str, Any]:
        computed = plain.sample(ops, p, x, inputs)
        return {**computed, "voltage": computed["reference"]}

    other = replace(plain, sampled_states=(State("voltage", "V"),), sample=sample,
                    derivatives=lambda ops, p, x, u: base(ops, p, x, u.replace(reference=u.voltage)))
    values = load_parameters(model=DIRECT_DRIVE).values
    expected = response(values, DIRECT_DRIVE)
    for module in ("actuator", "smooth"):
        monkeypatch.setattr(f"emcas_fmu.bench.linear.{module}.get", lambda name: other)
    # Two ways to the same matrices: rounding.
    np.testing.assert_allclose(response(values, "other"), expected, rtol=1e-9)


def test_actuator_without_position_loop_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"second-order has none; choose nonlinear, linear, "):
        analyse(load_parameters(model="second-order+faults"))


STEP_ALONE = """
from dataclasses import replace
from emcas_fmu.actuators import get
ACTUATOR = replace(get("linear"), name="mine", derivatives=None)
"""


def test_actuator_without_derivatives_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STEP_ALONE, encoding="utf-8")
    file.with_suffix(".toml").write_text("", encoding="utf-8")
    with pytest.raises(EmcasError, match="mine declares a step only"):
        LinearActuator(load_parameters(model="linear").values, model=str(file))


@pytest.mark.parametrize(("at", "torque", "message"), [(25.0, 0.0, "command.limit"),
                                                       (0.0, 400.0, "within the drive's limits")])
def test_unreachable_operating_point_of_a_users_actuator_is_refused(at: float, torque: float, message: str) -> None:
    with pytest.raises(EmcasError, match=message):  # 39 V hold 312 N.m
        LinearActuator(load_parameters(model=DIRECT_DRIVE).values, radians(at), torque, DIRECT_DRIVE)
    LinearActuator(load_parameters(model=DIRECT_DRIVE).values, 0.0, 300.0, DIRECT_DRIVE)


def test_unstable_loop_of_a_users_actuator_is_refused() -> None:
    values = load_parameters(model=DIRECT_DRIVE).with_values({"controller.kp": 4e4})
    with pytest.raises(EmcasError, match="lower the gains of its controller"):
        analyse(values)


# Two chambers' pressures [Pa]: a leak limits their difference, which acts on the fin; their mean integrates the flow.
CHAMBERS = (('em.State("current", "A")', 'em.State("current", "A"), em.State("one", "Pa"), em.State("other", "Pa")'),
            ('"current": rise / p.motor.inductance}', '"current": rise / p.motor.inductance, '
             '"one": 7e6 * x.current - 30.0 * (x.one - x.other) - 1e6 * x.fin_rate, '
             '"other": -3e6 * x.current + 30.0 * (x.one - x.other) + 1e6 * x.fin_rate}'),
            ("p.motor.torque_constant * x.current + load", "p.motor.torque_constant * x.current + load "
             "+ 1e-7 * (x.one - x.other)"))


def test_analysis_says_that_the_thesis_model_lacks_command_resolution() -> None:
    values = load_parameters().with_values({"command.resolution": radians(0.1)}).values
    assert _left_out("nonlinear", values) == {
        "thesis_linear": "the thesis's linear model left out: command.resolution = 0.00174533 rad: the linear model "
        "has no such effect; set it to 0"}


def test_hidden_mode_is_left_out_and_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = str(changed(tmp_path, *CHAMBERS))
    parameters = load_parameters(model=model)
    steady = changed(tmp_path, *CHAMBERS, ("7e6 * x", "5e6 * x"), ("-3e6 * x", "-5e6 * x"), name="steady.py")
    for kp in np.geomspace(0.1, 1.0, 4) * parameters.values["controller.kp"]:  # rounding differs
        values = {**parameters.values, "controller.kp": float(kp)}
        linear = LinearActuator(values, model=model)
        # Measured 1e-12.
        assert linear.hidden == pytest.approx([1.0], abs=1e-9)
        assert linear.stable
        assert linear.closed.dcgain()[0, 0] == pytest.approx(1.0, abs=1e-9)  # an integral controller
        # The response is the same if the mean pressure is constant.
        np.testing.assert_allclose(response(values, model), response(values, str(steady)), rtol=1e-9)
    monkeypatch.setattr(sweep, "sweeps", lambda *_, **__: [])  # saves time
    found = analyse(parameters)
    assert found.left_out["hidden_modes"].startswith("1 mode left out of stability, final values and root locus")
    assert found.left_out["hidden_modes"].endswith("growth per sample 0 %")
    assert found.final_values["as_set"]["slowest_time_constant_s"] < 10.0
    assert found.locus.stable_range[0] == found.locus.values[0]
    assert all(np.all(np.abs(poles) > 1e-3) for poles in found.locus.poles)


def test_visible_mode_at_one_is_unstable(tmp_path: Path) -> None:
    """The controllers feed back only the rate: the fin angle integrates."""
    model = str(changed(tmp_path, ("c.setpoint_weight * command - x.fin_angle", "command")))
    parameters = load_parameters(model=model).with_values({"controller.ki": 0.0, "spring.stiffness": 0.0})
    with pytest.raises(EmcasError, match=r"unstable \(a mode neither decays nor grows\)"):
        analyse(parameters)


Analysed = Callable[..., tuple[dict[str, Any], str, str]]


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Analysed:
    """Function that runs `emcas analyse` and returns JSON, page and terminal output."""
    def run(*arguments: str) -> tuple[dict[str, Any], str, str]:
        folder = tmp_path_factory.mktemp("analysis")
        parameters = folder / "small.toml"
        parameters.write_text('[command]\nlimit = "4 deg"\n', encoding="utf-8")
        files = ["-p", str(parameters), "--json", str(folder / "a.json"), "--report", str(folder / "a.html")]
        result = CliRunner().invoke(app, ["analyse", *arguments, *files])
        assert result.exit_code == 0, result.output
        page = unescape((folder / "a.html").read_text(encoding="utf-8"))
        return json.loads((folder / "a.json").read_text(encoding="utf-8")), page, " ".join(result.output.split())

    return run


@pytest.mark.slow
def test_command_analyses_the_elastic_actuator_with_heat(analysed: Analysed) -> None:
    found, page, output = analysed("--model", "elastic+heat", "--at", "2", "--torque", "-20")
    assert found["model"] == "elastic+heat"
    assert set(found["left_out"]) == {"thesis_linear", "limits", "capability"}
    assert all(f"{why}." in output and f"{why}." in page for why in found["left_out"].values())
    assert [found[key] for key in ("thesis_linear", "envelope", "capability")] == [None] * 3
    assert set(found["linear"]["loops"]) == {"current", "velocity", "position", "reference"}
    assert found["locus"]["parameter"] == "controller.position.kp"
    assert found["modes"]["axial_hz"] > 0.0
    # The mode of the elastic drive line is among the linear modes.
    assert any(m["frequency_hz"] > 200.0 for m in found["linear"]["modes"])
    assert page.count("<svg") == 5
    assert len(re.findall(r"<h2[^>]*>Natural frequencies", page)) == 1
    assert [s["limit_onset_hz"] for s in found["sweep"]] == [{}] * len(found["sweep"])


@pytest.mark.drawn
def test_command_analyses_a_users_actuator(analysed: Analysed) -> None:
    found, page, output = analysed("--model", DIRECT_DRIVE, "--at", "2", "--torque", "-20")
    assert found["model"] == "direct-drive"
    assert set(found["left_out"]) == {"thesis_linear", "modes", "limits", "capability"}
    assert all(f"{why}." in output for why in found["left_out"].values())
    assert set(found["linear"]["loops"]) == {"reference"}
    assert found["locus"]["parameter"] == "controller.kp"
    # Integral action leaves no error except rounding.
    assert [found["final_values"]["as_set"][key] for key in ("command_error_deg", "load_error_deg")] == pytest.approx(
        [0.0, 0.0], abs=1e-9)
    assert found["operating_point"]["ratio"] is None
    # At rest u = R i, i = (k delta - T)/K_t.
    p = load_parameters(model=DIRECT_DRIVE).values
    current = (p["spring.stiffness"] * radians(2.0) + 20.0) / p["motor.torque_constant"]
    assert found["operating_point"]["current_a"] == pytest.approx(current, rel=1e-9)
    assert found["operating_point"]["reference"] == pytest.approx(p["motor.resistance"] * current, rel=1e-9)
    assert "Natural frequencies" not in page
    # Page and terminal do not mention the thesis's drive, friction and encoder, which this actuator lacks.
    text = " ".join(re.sub("<[^>]*>", " ", re.sub("(?s)<(svg|style).*?</(svg|style)>", "", unescape(page))).split())
    for words in ("drive reference", "the drive's reference", "Yerlikaya", "encoder", "compensation", "ratio"):
        assert words not in text
        assert words not in output
    assert f"current {current:.4g} A, reference" in text
    assert "Steps differ if a limit acts." in text
    assert "Amplitudes lose bandwidth if a limit acts." in text
    assert page.count("<svg") == 5
