"""The accuracy budget: terms against closed forms, sums, drawn samples, and terms that are left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import atan, cos, degrees, pi, radians, sin, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.runs import StoppedError
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.report import accuracy, budget
from emcas_fmu.studies.report.outcome import Outcome, Rig
from tests.marks import others_slow

from ..bench.subjects import Broken

pytestmark = pytest.mark.acceptance
TARGETS = np.radians([-20.0, -10.0, 0.0, 10.0, 20.0])
# Without dry friction the integral removes all other errors, and every term has a closed form.
SMOOTH = {**{f"friction.coulomb.{side}[{k}]": 0.0 for side in ("positive", "negative") for k in range(7)},
          "friction.fin_coulomb": 0.0, "compensation.gain": 0.0}
FEW = 8  # drawn samples instead of 200, which take half of the time
LEFT = 2e-4  # deg: rest of the slowest mode, with the integral's 0.24 s, after 2 s of a hold


def rig(model: str = "nonlinear", **changes: float) -> Rig:
    """Return an actuator with changed parameters; `a__b` in a keyword means `a.b`."""
    named = {name.replace("__", "."): value for name, value in changes.items()}
    return Rig(ParameterSubject(load_parameters(model=model).with_values(named)))


def measured(article: Rig, samples: int = budget.UNITS) -> Mapping[str, Mapping[str, Any]]:
    """Return the budget's figures with so many drawn samples; FEW for tests of the terms alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget, "UNITS", samples)
        return budget.measure(article).figures


@pytest.fixture(scope="module")
def smooth() -> Mapping[str, Mapping[str, Any]]:
    """The budget of the default actuator without dry friction and without drive offset."""
    return measured(Rig(ParameterSubject(load_parameters().with_values({**SMOOTH, "drive.current_offset": 0.0}))))


@pytest.fixture(scope="module")
def elastic() -> Mapping[str, Mapping[str, Any]]:
    """The budget of the elastic actuator without dry friction; only shaft and fork are compliant."""
    return measured(Rig(ParameterSubject(load_parameters(model="elastic").with_values({
        **SMOOTH, "drive_line.axial_compliance": 0.0, "drive_line.torsional_compliance": 0.0,
        "drive_line.shaft_stiffness": 20e3, "drive_line.fork_stiffness": 60e3, "drive_line.hinge_damping": 5.0,
        "friction.fin_viscous": 5.0}))), FEW)


def fin(values: Mapping[str, Any], command: float, arm: float = 0.0, assembly: float = 0.0, lead: float = 0.0) -> float:
    """Return the fin angle [rad] of a deviating lever and screw at the motor angle of the nominal ones, by (2.5)."""
    start, moment_arm = values["kinematics.initial_angle"], values["kinematics.moment_arm"]
    nut = moment_arm * (tan(command + start) - tan(start)) * (1.0 + lead)
    return float(atan(nut / (moment_arm * (1.0 + arm)) + tan(start + assembly)) - (start + assembly))


@pytest.mark.parametrize(("term", "change"), [
    ("kinematics_moment_arm", {"arm": 0.002}), ("kinematics_initial_angle", {"assembly": radians(0.25)}),
    ("screw_lead", {"lead": 1e-4})])
@pytest.mark.parametrize("load", ["unloaded_deg", "loaded_deg"])
def test_terms_of_geometry_and_lead_agree_with_the_closed_form(
        term: str, change: dict[str, float], load: str, values: Mapping[str, Any],
        smooth: Mapping[str, Mapping[str, Any]]) -> None:
    (name, size), = change.items()
    expected = max(abs(fin(values, command, **{name: sign * size}) - command)
                   for command in TARGETS for sign in (1.0, -1.0))
    assert smooth[term][load] == pytest.approx(degrees(expected), abs=LEFT)


def test_term_of_the_encoder_is_at_most_one_count(
        values: Mapping[str, Any], smooth: Mapping[str, Mapping[str, Any]]) -> None:
    turn = 2.0 * pi / (values["encoder.pulses"] * values["encoder.multiplier"])
    count = degrees(turn * values["screw.lead"] / values["kinematics.moment_arm"]) * max(
        cos(command + values["kinematics.initial_angle"]) ** 2 for command in TARGETS)
    for load in ("unloaded_deg", "loaded_deg"):
        # The integral ends at the border of two counts, anywhere within a count of the command.
        assert 0.3 * count < smooth["encoder"][load] < count + LEFT


def test_term_of_compliance_is_load_over_stiffness(elastic: Mapping[str, Mapping[str, Any]]) -> None:
    expected = degrees(100.0 * (1.0 / 20e3 + 1.0 / 60e3))
    # The lever's ratio is that of the undeflected fin: tan(20 deg) times 0.0067 rad, a quarter of a percent.
    assert elastic["compliance"]["loaded_deg"] == pytest.approx(expected, rel=0.004)
    assert elastic["compliance"]["unloaded_deg"] < LEFT


def test_term_of_backlash_is_half_the_gap_under_load(elastic: Mapping[str, Mapping[str, Any]]) -> None:
    values = load_parameters(model="elastic").values
    arm, start = values["kinematics.moment_arm"], values["kinematics.initial_angle"]
    ratio = max(cos(command + start) ** 2 / arm for command in TARGETS)  # rad of fin per m of nut
    force = 100.0 * ratio
    expected = degrees(ratio * (0.5 * values["drive_line.backlash"] + force / values["drive_line.contact_stiffness"]))
    assert elastic["backlash"]["loaded_deg"] == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_stiff_gear_of_a_small_servo_is_stepped_accurately() -> None:
    """The fin of 2e-5 kg.m2 is still resolved by the tick without compliance; without load the gear hardly winds up."""
    figures = measured(Rig(ParameterSubject(load_parameters("xl330", model="servo"))), FEW)
    assert figures["compliance"]["unloaded_deg"] < 0.01  # 0.005; a stiffness of 1e6 N.m/rad: 0.05, of 1e7: 20
    assert figures["loop"]["unloaded_deg"] < 0.05  # 0.034


def test_term_of_an_eccentric_encoder_on_the_fin_is_its_error() -> None:
    """The command equals x + e (sin(x + p) - sin p) at the fin angle x; one count is 0.0007 deg."""
    e, phase = radians(0.1), 0.6
    found = measured(rig("nonlinear+sensors", **SMOOTH, encoder__on_fin=True, encoder__pulses=131072,
                         sensor__encoder__once=e, sensor__encoder__once_phase=phase, drive__current_offset=0.0), FEW)
    # The errors at command and angle differ by e^2: 2e-5 deg of 0.03 deg.
    expected = degrees(max(abs(e * (sin(command + phase) - sin(phase))) for command in TARGETS))
    for load in ("unloaded_deg", "loaded_deg"):
        assert found["eccentricity_of_the_encoder"][load] == pytest.approx(expected, abs=2.0 * LEFT)
    assert "current_sensor" not in found


def test_sums_contain_all_terms(smooth: Mapping[str, Mapping[str, Any]]) -> None:
    sums = ("worst_case", "root_of_squares", "monte_carlo_95", "monte_carlo_99", "as_set", "required")
    for load in ("unloaded_deg", "loaded_deg"):
        terms = [figures[load] for name, figures in smooth.items() if name not in sums]
        assert min(terms) >= 0.0
        assert smooth["worst_case"][load] == pytest.approx(sum(terms), rel=1e-12)
        assert smooth["root_of_squares"][load] == pytest.approx(sum(term**2 for term in terms)**0.5, rel=1e-12)


def test_errors_of_drawn_samples_are_below_the_worst_case(smooth: Mapping[str, Mapping[str, Any]]) -> None:
    for load in ("unloaded_deg", "loaded_deg"):
        assert smooth["root_of_squares"][load] < smooth["worst_case"][load]
        # Each term is largest at another command, and a sample has less than the largest deviation of each.
        assert 0.2 * smooth["worst_case"][load] < smooth["monte_carlo_95"][load] < smooth["worst_case"][load]
        assert smooth["monte_carlo_95"][load] <= smooth["monte_carlo_99"][load]


def test_limits_of_shipped_tolerances() -> None:
    article = rig()
    found = budget.limits(article)
    assert found["deviation.kinematics.initial_angle"] == (-radians(0.25), radians(0.25))
    assert found["friction.temperature"] == (-6.0, 24.0)
    assert "deviation.mass.fin" not in found
    assert [term.label for term in budget.toleranced(article)][:2] == [
        "moment arm, ±0.2 %", "lever's assembly angle, ±0.25 deg"]
    # A limit equal to the nominal value is left out.
    cold = rig(friction__temperature=-6.0)
    assert [len(term.values) for term in budget.toleranced(cold) if term.name == "friction_temperature"] == [1]
    worm = budget.limits(rig("worm-gear"))
    assert worm["deviation.worm.friction"] == (-0.3, 0.2)
    assert not {"deviation.screw.lead", "deviation.kinematics.moment_arm"} & worm.keys()


def test_tolerances_of_the_requirements_replace_the_shipped_ones(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('[cases.nominal]\n[cases.arm]\n"deviation.kinematics.moment_arm" = 0.01\n[[requirements]]\n'
                    'name = "a"\ntest = { kind = "step", amplitude = "10 deg" }\nfigure = "held_error"\n'
                    'maximum = "0.5 deg"\ncases = ["nominal"]\n', encoding="utf-8")
    article = Rig(ParameterSubject(load_parameters()), specification=load_requirements(path, load_parameters()))
    assert budget.limits(article) == {
        "deviation.kinematics.moment_arm": (0.0, 0.01), "friction.temperature": (-6.0, 24.0)}
    outcome = budget.measure(article)
    assert outcome.figures["required"] == pytest.approx({"unloaded_deg": 0.5, "loaded_deg": 0.5})
    assert "as mine.toml has no tolerance of" in text(outcome)
    assert not outcome.estimate  # only the shipped tolerances are known to be estimates
    static = accuracy.static(article)
    assert "by the tolerances in mine.toml" in static.method
    assert static.groups["arm"].label == "arm (tolerances)"
    assert "(a" in outcome.notes[0]


def test_load_of_the_budget_is_that_of_the_requirements(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "UNITS", FEW)
    outcome = budget.measure(rig("servo"))
    assert "with 5 N.m in either direction" in outcome.method
    assert "No tolerance is known" in text(outcome)
    assert not outcome.estimate


def text(outcome: Outcome) -> str:
    return "\n".join(outcome.notes)


def test_notes_name_missing_terms_and_tolerances(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "UNITS", FEW)
    rigid, compliant = budget.measure(rig()), budget.measure(rig("elastic"))
    assert "as this article has none: compliance, backlash." in text(rigid)
    assert "has no tolerance of deviation.mass.fin." in text(rigid)
    offset = budget.measure(rig("clutch", drive__current_offset=0.01))
    assert offset.figures["drive_offset"]["unloaded_deg"] > 0.01
    assert "as this article has none: compliance, backlash." in text(offset)
    # The folder has tolerances of other actuators.
    assert "as models/tuning/electrohydrostatic.toml has no tolerance of" in text(
        budget.measure(rig("electrohydrostatic")))
    assert "this article has none" not in text(compliant)
    assert "Estimate: backlash, from engineering estimates of drive_line.backlash." in text(compliant)
    assert {"compliance", "backlash"} <= compliant.figures.keys() - rigid.figures.keys()


@pytest.mark.slow
def test_encoder_on_the_fin_removes_compliance_and_backlash() -> None:
    base = load_parameters(["models/sets/hinge-stiffness.toml"], model="elastic")
    on_motor, on_fin = (measured(Rig(ParameterSubject(base.with_values({"encoder.on_fin": value}))), FEW)
                        for value in (False, True))
    assert on_motor["compliance"]["loaded_deg"] > 0.4
    count = degrees(2.0 * pi / (base.values["encoder.pulses"] * base.values["encoder.multiplier"]))
    for term in ("compliance", "backlash"):
        assert on_fin[term]["loaded_deg"] < count


def test_error_if_a_run_ends_early_or_a_tolerance_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoppedError, match="the bridge is open"):
        budget.measure(Rig(Broken()))
    article = rig()
    case = replace(load_requirements(None, article.subject.parameters).cases[0],
                   values={"deviation.kinematics.initial_angle": radians(11.0)})
    too_far = replace(article, specification=replace(article.requirements, cases=(case,)))
    with pytest.raises(StoppedError, match="a sample within the tolerances is refused: "):
        budget.measure(too_far)


def test_imperfection_of_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"imperfections\['play'\]: there is no parameter drive_line\.backlsh; did"):
        replace(get("elastic"), imperfections={"play": {"drive_line.backlsh": 0.0}})


@pytest.mark.parametrize("model", others_slow(NAMES, lambda name: name == "second-order"))
def test_budget_of_every_actuator_is_finite_and_at_least_its_error(model: str) -> None:
    article = rig(model)
    for name, without in article.subject.actuator.imperfections.items():
        assert article.subject.parameters.with_values(dict(without)), name  # valid without the imperfection
        assert without.keys() <= article.subject.values.keys()
    figures = measured(article)
    assert all(np.isfinite(list(group.values())).all() for group in figures.values())
    for load in ("unloaded_deg", "loaded_deg"):
        # Terms that compensate each other can have a smaller sum than the whole, such as those of loop and backlash.
        assert figures["as_set"][load] < 1.1 * figures["worst_case"][load] + 1e-3
