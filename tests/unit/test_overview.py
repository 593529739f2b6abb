"""`emcas parameters` prints quantities derived from the parameters, and the shipped estimates that remain."""

from __future__ import annotations

import json
from math import degrees, inf, pi, radians, tan
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.overview import amounts_to, by_effect, by_group, remaining_estimates, stalled
from tests.commands import emcas, refusal

FILE = """
[kinematics]
moment_arm = "48 mm"
[motor]
torque_constant = "0.1 N*m/A"
resistance = { value = 250, unit = "mOhm", source = "estimate", note = "A guess of the user's own." }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(FILE, encoding="utf-8")
    return path


def test_values_of_a_file_are_not_shipped_estimates(file: Path) -> None:
    before, after = (remaining_estimates(p) for p in (load_parameters(), load_parameters(file)))
    names = [{name for estimate in estimates for name in estimate.names} for estimates in (before, after)]
    assert names[0] == set(load_parameters().estimates)
    # The back-EMF constant follows the torque constant; the user's own estimate is not a shipped one.
    assert names[0] - names[1] == {"kinematics.moment_arm", "motor.torque_constant", "motor.back_emf_constant",
                                   "motor.resistance"}


def test_estimates_are_labelled_by_group() -> None:
    groups = by_group(remaining_estimates(load_parameters()))
    assert groups["motor"] == ["torque_constant with motor.back_emf_constant", "resistance", "inductance", "pole_pairs"]
    assert groups["friction"].count("coulomb.positive") == 1


def test_estimates_are_ordered_by_the_effect_of_ten_per_cent(file: Path) -> None:
    """One effect is compared with a simulation."""
    chosen = load_parameters(file)
    estimates = by_effect(chosen, 50.0)
    effects = [e.effect for e in estimates if e.effect is not None]
    assert effects == sorted(effects, reverse=True)
    assert [e.effect for e in estimates[len(effects):]] == [None] * (len(estimates) - len(effects))
    assert {e.names for e in estimates} == {e.names for e in remaining_estimates(chosen)}
    by_label = {e.label: e.effect for e in estimates}
    assert by_label["encoder.on_fin"] is by_label["friction.temperature"] is by_label["mounting.station"] is None
    assert by_label["mass.shaft"] == 0.0  # acts through gravity and acceleration only
    responses = [simulate(values, 0.5, fin_command=radians(10.0), aero_torque=lambda t: -50.0 * min(t / 0.02, 1.0))
                 for values in (chosen.values, {**chosen.values, "controller.position.kp": 1.1 * 53.8})]
    difference = np.abs(responses[1]["fin_angle"] - responses[0]["fin_angle"]).max()
    assert by_label["controller.position.kp"] == pytest.approx(difference, rel=1e-9)
    assert degrees(difference) > 0.1


def test_parameter_at_its_limit_is_reduced_by_ten_per_cent() -> None:
    """For example a set-point weight of 2, of which 10 % more is refused."""
    base = load_parameters(model="second-order")
    assert all(e.effect is not None for e in by_effect(base) if e.label.startswith("second_order."))


def test_derived_quantities_agree_with_closed_forms() -> None:
    dry = {f"friction.coulomb.{side}": [0.0] * 7 for side in ("positive", "negative")}
    amounts = {label: float(text.split()[0]) for label, text in amounts_to(load_parameters().with_values(dry)).items()}
    arm, start, stop, limit = 0.05, radians(5.0), radians(25.0), radians(20.0)
    ratio = 2.0 * pi * arm / 0.005
    rel = 6e-4  # printed with four digits, a count with three
    assert amounts["no-load speed of the motor at the supply"] == pytest.approx(39.0 / 0.11 * 30.0 / pi, rel=rel)
    assert amounts["stroke of the nut from stop to stop"] == pytest.approx(
        1e3 * arm * (tan(stop + start) + tan(stop - start)), rel=rel)
    assert amounts["motor turns per turn of the fin"] == pytest.approx(ratio, rel=rel)
    assert amounts["one count of the motor's encoder"] == pytest.approx(360.0 / 8192.0 / ratio, rel=6e-3)
    # The lever is square to the screw at -5 deg, which is one of the range's 101 points.
    assert amounts["smallest hinge moment that stalls it"] == pytest.approx(0.11 * 60.0 * ratio, rel=rel)
    assert amounts["smallest fin rate without load"] == pytest.approx(
        degrees(300.0 / ratio * np.cos(limit + start)**2), rel=rel)


def test_stalling_hinge_moment_is_reported() -> None:
    """Without friction the smallest is 6.6 N.m times 62.8, with the lever square to the screw."""
    dry = load_parameters().with_values({f"friction.coulomb.{side}": [0.0] * 7 for side in ("positive", "negative")})
    assert [*stalled(dry, 414.0)] == []
    (message,) = stalled(dry, 415.0)
    assert "415 N.m stalls the actuator" in message
    assert "414.7 N.m" in message
    assert [*stalled(load_parameters(model="second-order"), 1e6)] == []


@pytest.mark.parametrize("model", ["second-order", "clutch", "electrohydraulic", "worm-gear"])
def test_actuators_without_lever_and_screw_have_no_derived_quantities(model: str) -> None:
    assert amounts_to(load_parameters(model=model)) == {}


def test_command_prints_quantities_and_estimates(file: Path) -> None:
    printed = emcas("parameters", "-p", file).output
    assert "smallest hinge moment that stalls it" in printed
    assert "  motor: inductance, pole_pairs\n" in printed
    assert "Still shipped estimates: " in printed
    assert "Still shipped estimates" not in emcas("parameters").output
    assert "still an estimate" in emcas("parameters", "-p", file, "--sensitivity", "0").output
    records = {r["name"]: r for r in json.loads(emcas("parameters", "-p", file, "--json", "--sensitivity", "0").output)}
    assert not records["motor.resistance"]["shipped_estimate"]
    assert records["motor.resistance"]["effect_deg"] is None
    assert records["motor.inductance"]["effect_deg"] > 0.0
    plain = json.loads(emcas("parameters", "-p", file, "--json").output)
    assert "effect_deg" not in plain[0]
    assert sum(r["shipped_estimate"] for r in plain) == sum(r["shipped_estimate"] for r in records.values())


def test_infinite_hinge_moment_is_refused() -> None:
    assert "--sensitivity inf: give a finite hinge moment in N.m" in refusal("parameters", "--sensitivity", inf)
