"""Every actuator with a sampled position loop: its linear analysis against its own kernel, and what is refused."""

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
from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator, sound
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

from .conftest import growth, without_friction

Values = Mapping[str, Any]
DIRECT_DRIVE = str(Path(__file__).parents[2] / "examples" / "own_actuator" / "direct_drive.py")
WARM = {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 40.0}
# With what scales the loop's gain. The nonlinear one has tests of its own.
GAINS = dict.fromkeys(("linear", "elastic", "habibi", "ozkan", "worm-gear", "worm-gear-elastic", "clutch",
                       "series-clutch", "electrohydrostatic", "elastic+heat"),
                      ("drive.current_gain",)) | {
    "ristanovic": ("pwm.gain",), "servo": ("controller.kp", "controller.kd"),
    "electrohydraulic": ("controller.position.kp", "controller.position.ki"),
    DIRECT_DRIVE: ("controller.kp", "controller.ki", "controller.kd")}
MODELS = tuple(GAINS)
# One of each kind of drive, lever and friction; of the nonlinear actuator test_against_simulation.py has the same.
QUICK = ("elastic+heat", "worm-gear", "ristanovic", "servo", "electrohydraulic", DIRECT_DRIVE)
EACH = others_slow(MODELS, lambda model: model in QUICK)
# Check valves would open at the pressure of a load of 0.5 N.m.
HYDRAULIC = {"transducer__resolution": 0.0, "cylinder__coulomb_friction": 0.0, "pump__coulomb_friction": 0.0,
             "pump__pressure_friction": 0.0, "check_valve__conductance": 0.0}
GRID = np.array([0.5, 2.0, 7.0, 12.0, 40.0])


def smooth(model: str, **more: Any) -> dict[str, Any]:
    """The default set without dry friction and that of a worm, gap and encoder, as far as the actuator has them."""
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
def test_gains_left_open_are_those_given(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equations traced once for all gains, against equations traced with these as numbers."""
    values = smooth(model)
    gains = [v.name for v in get(model).parameters if v.variability == "tunable" and v.name.startswith("controller.")]
    changed = {**values, **{name: 0.9 * values[name] for name in gains}}
    before, opened = response(values, model, 0.1), response(changed, model, 0.1)
    monkeypatch.setattr("emcas_fmu.bench.linear.actuator.gains_of", lambda *_: {})
    np.testing.assert_allclose(opened, response(changed, model, 0.1), rtol=1e-9)  # of exact Jacobians, rounding
    assert np.max(np.abs(opened / before - 1.0)) > 1e-3


def test_all_are_here() -> None:
    assert {name for name in NAMES if POSITION_LOOP in get(name).provides} == {*MODELS, "nonlinear"} - {
        "elastic+heat", DIRECT_DRIVE}


@pytest.mark.parametrize("model", EACH)
def test_bandwidth_is_that_of_small_sines(model: str) -> None:
    values, at = smooth(model), radians(8.0)
    linear = frequency.response(LinearActuator(values, at, model=model).command_to_angle)
    near = np.concatenate([width + np.arange(-1.0, 1.1, 0.5) for width in (linear.bandwidth, linear.phase_bandwidth)])
    (swept,) = sweep.sines(values, [(radians(0.02), at, np.unique(np.round(2.0 * near)) / 2.0)], model=model)
    measured = swept.response
    # 4e-4 at most are found: lines between frequencies 0.5 Hz apart, the lever's curvature, the kernel's ticks.
    assert linear.bandwidth == pytest.approx(measured.bandwidth, rel=1e-3)
    assert linear.phase_bandwidth == pytest.approx(measured.phase_bandwidth, rel=1e-3)


@pytest.mark.parametrize("model", EACH)
def test_gain_margin_is_where_oscillation_begins(model: str) -> None:
    values = smooth(model)
    margins = frequency.margins(LinearActuator(values, model=model).loop("reference"))

    def grows(share: float) -> bool:
        factor = 1.0 + (margins.gain - 1.0) * share
        scaled = {**values, **{name: factor * values[name] for name in GAINS[model]}}
        return growth(scaled, 0.0, margins.phase_crossover, partial(simulate, model=model)) > 1.0

    # 0.06 % of the margin are found, of the direct drive 0.7 %: its steps dampen what is fast beside their tick.
    around = 0.015 if model == DIRECT_DRIVE else 0.002
    assert [grows(share) for share in (1.0 - around, 1.0 + around)] == [False, True]


@pytest.mark.parametrize("model", EACH)
def test_small_load_step_is_the_linear_one(model: str) -> None:
    values = smooth(model, drive__current_offset=0.0)
    linear, torque = LinearActuator(values, model=model), 1.0
    time = np.arange(200) * linear.period
    expected = ct.forced_response(linear.load_to_angle, time, np.full(len(time), torque)).outputs
    found = simulate(values, float(time[-1]), linear.period, model=model, aero_torque=torque)["fin_angle"]
    # 1 % of the largest: the ratio's curvature over some 0.01 deg is far less, viscous friction's two directions not.
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.01 * np.max(np.abs(expected)))


@pytest.mark.parametrize("model", ["elastic", "habibi"])
def test_a_gap_is_linearised_as_closed_by_a_load(model: str) -> None:
    gap = 5e-5
    values = smooth(model) | {"drive_line.backlash": gap}
    linear = LinearActuator(values, radians(8.0), -60.0, model)
    step = compare(values, linear, 0.02, thesis=False)
    # 1 %: the flank stays pressed, by 60 N.m. Without its stiffness the elastic line would be off by more:
    assert step.difference < 1.0
    free, closed = (response(v, model) for v in (values | {"drive_line.backlash": 0.0}, values))
    assert np.max(np.abs(closed / free - 1.0)) > 1e-4


@pytest.mark.parametrize(("model", "at", "torque"), [("elastic", 0.0, 0.0), ("elastic", 9.0, -40.0),
                                                     ("nonlinear", 9.0, -40.0)])
def test_observer_and_velocity_integral_behind_the_encoder(model: str, at: float, torque: float) -> None:
    """The rest of these controllers has an equation in which no state acts, and a residual of rounding."""
    parameters = load_parameters(model=model)
    values = {**parameters.values, **parameters.having(without_friction(
        parameters.values, drive_line__backlash=0.0, controller__load_observer=250.0, controller__velocity__ki=0.4))}
    linear = LinearActuator(values, radians(at), torque, model)
    # 0.02 % are found with counts of 2e-6 deg at the fin: the ratio's curvature, the kernel's ticks.
    assert compare({**values, "encoder.pulses": 1_000_000}, linear, 0.1, thesis=False).difference < 0.1


def test_a_response_of_zero_has_no_phase() -> None:
    (swept,) = sweep.sines(load_parameters(model="elastic").values, [(radians(0.1), 0.0, np.array([5.0, 60.0]))],
                           model="elastic")
    measured = swept.response
    assert measured.gain[1] == 0.0
    assert np.isnan(measured.phase[1])
    assert -90.0 < np.degrees(measured.phase[0]) < 0.0


@pytest.mark.parametrize("on_fin", [False, True])
@pytest.mark.parametrize("encoder", [False, True])
def test_a_rigid_elastic_line_is_none(on_fin: bool, encoder: bool) -> None:
    rigid = {"drive_line.axial_compliance": 0.0, "drive_line.torsional_compliance": 0.0, "drive_line.backlash": 0.0,
             "encoder.on_fin": on_fin, "encoder.enabled": encoder, "loads.gravity": True}
    values = {**load_parameters(model="elastic").values, **rigid}
    plain = {name: values[name] for name in load_parameters().values}
    one, other = LinearActuator(values, 0.1, -20.0, "elastic"), LinearActuator(plain, 0.1, -20.0)
    assert one.closed.nstates == other.closed.nstates  # rotor and fin are one
    for channel in ("command_to_angle", "load_to_angle"):
        np.testing.assert_allclose(frequency.evaluate(getattr(one, channel), GRID),
                                   frequency.evaluate(getattr(other, channel), GRID), rtol=1e-9)
    for loop in other.loops:
        np.testing.assert_allclose(frequency.evaluate(one.loop(loop), GRID), frequency.evaluate(other.loop(loop), GRID),
                                   rtol=1e-9)


def test_a_stiff_line_is_nearly_a_rigid_one() -> None:
    values = smooth("ozkan")
    rigid, stiff = (response({**values, "drive_line.torsional_compliance": c}, "ozkan") for c in (0.0, 1e-7))
    np.testing.assert_allclose(stiff, rigid, rtol=1e-5)  # a mode of some 10^5 rad/s beside 40 Hz


@pytest.mark.parametrize("extensions", ["stribeck", "lugre", "efficiency", "stribeck+efficiency"])
def test_what_friction_and_the_screw_lose_is_not_smooth(extensions: str) -> None:
    model = f"nonlinear+{extensions}"
    np.testing.assert_array_equal(response(load_parameters(model=model).values, model, 0.1),
                                  response(load_parameters().values, "nonlinear", 0.1))


def test_heat_gives_the_motor_its_temperatures_at_the_start() -> None:
    model = "nonlinear+heat"
    values = {**load_parameters(model=model).values, **WARM}
    p, ambient = get(model).namespace(values), values["friction.temperature"]
    warm = {"motor.resistance": heat.resistance(FLOATS, p, ambient + 80.0)} | {
        f"motor.{name}": values[f"motor.{name}"] * heat.magnets(FLOATS, p, ambient + 40.0)
        for name in ("torque_constant", "back_emf_constant")}
    plain = {**load_parameters().values}
    # The controllers know nothing of it; there is nothing of the motor in them without compensation.
    np.testing.assert_allclose(response(values, model), response({**plain, **warm}, "nonlinear"), rtol=1e-12)
    assert np.max(np.abs(response(values, model) / response(plain, "nonlinear") - 1.0)) > 1e-3


def test_faults_and_homing_are_laid_aside() -> None:
    whole = load_parameters(model="elastic+heat+homing+faults").with_values({"fault.jam.active": True})
    aside = sound(whole)
    assert aside.model == "elastic+heat"
    assert dict(aside.values) == dict(load_parameters(model="elastic+heat").values)


def test_a_sampled_state_acts_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The direct drive's voltage as a state that samples set, instead of the reference: the same loop."""
    plain = get(DIRECT_DRIVE)
    base = plain.derivatives
    assert base is not None

    def sample(ops: Any, p: Any, x: Any, inputs: Any) -> dict[str, Any]:
        given = plain.sample(ops, p, x, inputs)
        return {**given, "held": given["reference"]}

    other = replace(plain, sampled_states=(State("held", "V"),), sample=sample,
                    derivatives=lambda ops, p, x, u: base(ops, p, x, u.replace(reference=u.held)))
    values = load_parameters(model=DIRECT_DRIVE).values
    expected = response(values, DIRECT_DRIVE)
    for module in ("actuator", "smooth"):
        monkeypatch.setattr(f"emcas_fmu.bench.linear.{module}.get", lambda name: other)
    # Two ways to the same matrices, one through the held input.
    np.testing.assert_allclose(response(values, "other"), expected, rtol=1e-9)


def test_what_has_no_position_loop_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"second-order has none; choose nonlinear, linear, "):
        analyse(load_parameters(model="second-order+faults"))


STEP_ALONE = """
from dataclasses import replace
from emcas_fmu.actuators import get
ACTUATOR = replace(get("linear"), name="mine", derivatives=None)
"""


def test_derivatives_are_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STEP_ALONE, encoding="utf-8")
    file.with_suffix(".toml").write_text("", encoding="utf-8")
    with pytest.raises(EmcasError, match="mine declares a step only"):
        LinearActuator(load_parameters(model="linear").values, model=str(file))


@pytest.mark.parametrize(("at", "torque", "says"), [(25.0, 0.0, "command.limit"),
                                                    (0.0, 400.0, "within the drive's limits")])
def test_points_out_of_reach_of_a_users_actuator(at: float, torque: float, says: str) -> None:
    with pytest.raises(EmcasError, match=says):  # 39 V hold 312 N.m
        LinearActuator(load_parameters(model=DIRECT_DRIVE).values, radians(at), torque, DIRECT_DRIVE)
    LinearActuator(load_parameters(model=DIRECT_DRIVE).values, 0.0, 300.0, DIRECT_DRIVE)


def test_an_unstable_loop_of_a_users_actuator() -> None:
    values = load_parameters(model=DIRECT_DRIVE).with_values({"controller.kp": 4e4})
    with pytest.raises(EmcasError, match="lower the gains of its controller"):
        analyse(values)


# Two chambers' pressures, in Pa: their mean takes all that flows in and pushes nothing, a leak keeps their difference.
CHAMBERS = (('em.State("current", "A")', 'em.State("current", "A"), em.State("one", "Pa"), em.State("other", "Pa")'),
            ('"current": rise / p.motor.inductance}', '"current": rise / p.motor.inductance, '
             '"one": 7e6 * x.current - 30.0 * (x.one - x.other) - 1e6 * x.fin_rate, '
             '"other": -3e6 * x.current + 30.0 * (x.one - x.other) + 1e6 * x.fin_rate}'),
            ("p.motor.torque_constant * x.current + load", "p.motor.torque_constant * x.current + load "
             "+ 1e-7 * (x.one - x.other)"))


def test_thesis_model_that_has_no_such_bus_is_left_out_and_told() -> None:
    values = load_parameters().with_values({"command.resolution": radians(0.1)}).values
    assert _left_out("nonlinear", values) == {
        "thesis_linear": "the thesis's linear model left out: command.resolution = 0.00174533 rad: the linear model "
        "has no such effect; set it to 0"}


def test_a_mode_that_nothing_shows_is_left_out_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = str(changed(tmp_path, *CHAMBERS))
    parameters = load_parameters(model=model)
    steady = changed(tmp_path, *CHAMBERS, ("7e6 * x", "5e6 * x"), ("-3e6 * x", "-5e6 * x"), name="steady.py")
    for kp in np.geomspace(0.1, 1.0, 4) * parameters.values["controller.kp"]:  # rounding falls either way
        values = {**parameters.values, "controller.kp": float(kp)}
        linear = LinearActuator(values, model=model)
        # 1e-12 are found, of what the mode does over a sample.
        assert linear.hidden == pytest.approx([1.0], abs=1e-9)
        assert linear.stable
        assert linear.closed.dcgain()[0, 0] == pytest.approx(1.0, abs=1e-9)  # an integral controller
        # Their mean, which the angle does not show, may as well stand still.
        np.testing.assert_allclose(response(values, model), response(values, str(steady)), rtol=1e-9)
    monkeypatch.setattr(sweep, "sweeps", lambda *_, **__: [])  # which need most of the time
    found = analyse(parameters)
    assert found.left_out["hidden_modes"].startswith("1 mode left out of stability, final values and root locus")
    assert found.left_out["hidden_modes"].endswith("growth per sample 0 %")
    assert found.final_values["as_set"]["slowest_time_constant_s"] < 10.0
    assert found.locus.stable_range[0] == found.locus.values[0]
    assert all(np.all(np.abs(poles) > 1e-3) for poles in found.locus.poles)


def test_a_mode_at_one_that_shows_is_no_stable_one(tmp_path: Path) -> None:
    """Only the command and the rate act on the fin, which nothing brings back."""
    model = str(changed(tmp_path, ("c.setpoint_weight * command - x.fin_angle", "command")))
    parameters = load_parameters(model=model).with_values({"controller.ki": 0.0, "spring.stiffness": 0.0})
    with pytest.raises(EmcasError, match=r"unstable \(a mode neither decays nor grows\)"):
        analyse(parameters)


Analysed = Callable[..., tuple[dict[str, Any], str, str]]


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Analysed:
    """JSON, page and output of the command."""
    def run(*arguments: str) -> tuple[dict[str, Any], str, str]:
        folder = tmp_path_factory.mktemp("analysis")
        parameters = folder / "small.toml"
        parameters.write_text('[command]\nlimit = "4 deg"\n', encoding="utf-8")
        done = CliRunner().invoke(app, ["analyse", *arguments, "-p", str(parameters), "--json", str(folder / "a.json"),
                                        "--report", str(folder / "a.html")])
        assert done.exit_code == 0, done.output
        page = unescape((folder / "a.html").read_text(encoding="utf-8"))
        return json.loads((folder / "a.json").read_text(encoding="utf-8")), page, " ".join(done.output.split())

    return run


@pytest.mark.slow
def test_the_command_on_an_elastic_line_with_heat(analysed: Analysed) -> None:
    found, page, said = analysed("--model", "elastic+heat", "--at", "2", "--torque", "-20")
    assert found["model"] == "elastic+heat"
    assert set(found["left_out"]) == {"thesis_linear", "limits", "capability"}
    assert all(f"{why}." in said and f"{why}." in page for why in found["left_out"].values())
    assert [found[key] for key in ("thesis_linear", "envelope", "capability")] == [None] * 3
    assert set(found["linear"]["loops"]) == {"current", "velocity", "position", "reference"}
    assert found["locus"]["parameter"] == "controller.position.kp"
    assert found["modes"]["axial_hz"] > 0.0
    # The line's own mode is among the linear ones: the fin on shaft and screw with the rotor held, or freer.
    assert any(m["frequency_hz"] > 200.0 for m in found["linear"]["modes"])
    assert page.count("<svg") == 5
    assert len(re.findall(r"<h2[^>]*>Natural frequencies", page)) == 1
    assert [s["limit_onset_hz"] for s in found["sweep"]] == [{}] * len(found["sweep"])


@pytest.mark.drawn
def test_the_command_on_a_users_actuator(analysed: Analysed) -> None:
    found, page, said = analysed("--model", DIRECT_DRIVE, "--at", "2", "--torque", "-20")
    assert found["model"] == "direct-drive"
    assert set(found["left_out"]) == {"thesis_linear", "modes", "limits", "capability"}
    assert all(f"{why}." in said for why in found["left_out"].values())
    assert set(found["linear"]["loops"]) == {"reference"}
    assert found["locus"]["parameter"] == "controller.kp"
    # Integral action leaves no error; rounding does.
    assert [found["final_values"]["as_set"][key] for key in ("command_error_deg", "load_error_deg")] == pytest.approx(
        [0.0, 0.0], abs=1e-9)
    assert found["operating_point"]["ratio"] is None
    # At rest u = R i, i = (k delta - T)/K_t.
    p = load_parameters(model=DIRECT_DRIVE).values
    current = (p["spring.stiffness"] * radians(2.0) + 20.0) / p["motor.torque_constant"]
    assert found["operating_point"]["current_a"] == pytest.approx(current, rel=1e-9)
    assert found["operating_point"]["reference"] == pytest.approx(p["motor.resistance"] * current, rel=1e-9)
    assert "Natural frequencies" not in page
    # Neither page nor terminal tells of the thesis's drive, friction and encoder, which it has not.
    text = " ".join(re.sub("<[^>]*>", " ", re.sub("(?s)<(svg|style).*?</(svg|style)>", "", unescape(page))).split())
    for words in ("drive reference", "the drive's reference", "Yerlikaya", "encoder", "compensation", "ratio"):
        assert words not in text
        assert words not in said
    assert f"current {current:.4g} A, reference" in text
    assert "Large steps differ if a limit acts." in text
    assert "Large amplitudes lose bandwidth if a limit acts." in text
    assert page.count("<svg") == 5
