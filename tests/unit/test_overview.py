"""`emcas parameters` of a file: what it amounts to, and what is still an estimate."""

from __future__ import annotations

import json
from math import degrees, inf, pi, radians, tan
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.overview import amounts_to, by_effect, by_group, remaining_estimates, stalled

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


def test_what_a_file_gives_is_no_shipped_estimate(file: Path) -> None:
    before, after = (remaining_estimates(p) for p in (load_parameters(), load_parameters(file)))
    names = [{name for estimate in left for name in estimate.names} for left in (before, after)]
    assert names[0] == set(load_parameters().estimates)
    # The back-EMF constant followed; the user's own estimate is none of the shipped ones.
    assert names[0] - names[1] == {"kinematics.moment_arm", "motor.torque_constant", "motor.back_emf_constant",
                                   "motor.resistance"}


def test_labels() -> None:
    groups = by_group(remaining_estimates(load_parameters()))
    assert groups["motor"] == ["torque_constant with motor.back_emf_constant", "resistance", "inductance", "pole_pairs"]
    assert groups["friction"].count("coulomb.positive") == 1


def test_the_order_is_by_what_ten_per_cent_do(file: Path) -> None:
    """Against a simulation of one of them done here."""
    chosen = load_parameters(file)
    found = by_effect(chosen, 50.0)
    effects = [e.effect for e in found if e.effect is not None]
    assert effects == sorted(effects, reverse=True)
    assert [e.effect for e in found[len(effects):]] == [None] * (len(found) - len(effects))
    assert {e.names for e in found} == {e.names for e in remaining_estimates(chosen)}
    by_label = {e.label: e.effect for e in found}
    assert by_label["encoder.on_fin"] is by_label["friction.temperature"] is by_label["mounting.station"] is None
    assert by_label["mass.shaft"] == 0.0  # acts through gravity and acceleration only
    responses = [simulate(values, 0.5, fin_command=radians(10.0), aero_torque=lambda t: -50.0 * min(t / 0.02, 1.0))
                 for values in (chosen.values, {**chosen.values, "controller.position.kp": 1.1 * 53.8})]
    apart = np.abs(responses[1]["fin_angle"] - responses[0]["fin_angle"]).max()
    assert by_label["controller.position.kp"] == pytest.approx(apart, rel=1e-9)
    assert degrees(apart) > 0.1


def test_a_limit_is_varied_the_other_way() -> None:
    """10 % more of a set-point weight of 2, or of an arm whose lever would jam, are refused."""
    base = load_parameters(model="second-order")
    assert all(e.effect is not None for e in by_effect(base) if e.label.startswith("second_order."))


def test_what_a_set_amounts_to_by_closed_forms() -> None:
    dry = {f"friction.coulomb.{side}": [0.0] * 7 for side in ("positive", "negative")}
    amounts = {what: float(text.split()[0]) for what, text in amounts_to(load_parameters().with_values(dry)).items()}
    arm, start, stop, limit = 0.05, radians(5.0), radians(25.0), radians(20.0)
    ratio = 2.0 * pi * arm / 0.005
    rel = 6e-4  # four digits, three of a count
    assert amounts["no-load speed of the motor at the supply"] == pytest.approx(39.0 / 0.11 * 30.0 / pi, rel=rel)
    assert amounts["stroke of the nut from stop to stop"] == pytest.approx(
        1e3 * arm * (tan(stop + start) + tan(stop - start)), rel=rel)
    assert amounts["motor turns per turn of the fin"] == pytest.approx(ratio, rel=rel)
    assert amounts["one count of the motor's encoder"] == pytest.approx(360.0 / 8192.0 / ratio, rel=6e-3)
    # Where the lever is square to the screw, at -5 deg; one of 101 points of the range is there.
    assert amounts["smallest hinge moment that stalls it"] == pytest.approx(0.11 * 60.0 * ratio, rel=rel)
    assert amounts["smallest fin rate without load"] == pytest.approx(
        degrees(300.0 / ratio * np.cos(limit + start)**2), rel=rel)


def test_a_hinge_moment_that_stalls_it() -> None:
    """Without friction the least is 6.6 N.m times 62.8, where the lever is square to the screw."""
    dry = load_parameters().with_values({f"friction.coulomb.{side}": [0.0] * 7 for side in ("positive", "negative")})
    assert [*stalled(dry, 414.0)] == []
    (said,) = stalled(dry, 415.0)
    assert "415 N.m stalls the actuator" in said
    assert "414.7 N.m" in said
    assert [*stalled(load_parameters(model="second-order"), 1e6)] == []


@pytest.mark.parametrize("model", ["second-order", "clutch", "electrohydraulic", "worm-gear"])
def test_others_amount_to_nothing_here(model: str) -> None:
    assert amounts_to(load_parameters(model=model)) == {}


def test_the_command(file: Path) -> None:
    said = CliRunner().invoke(app, ["parameters", "-p", str(file)]).output
    assert "smallest hinge moment that stalls it" in said
    assert "  motor: inductance, pole_pairs\n" in said
    assert "Still shipped estimates: " in said
    assert "Still shipped estimates" not in CliRunner().invoke(app, ["parameters"]).output
    ordered = CliRunner().invoke(app, ["parameters", "-p", str(file), "--sensitivity", "0"]).output
    assert "still an estimate" in ordered
    records = {r["name"]: r for r in json.loads(CliRunner().invoke(
        app, ["parameters", "-p", str(file), "--json", "--sensitivity", "0"]).output)}
    assert not records["motor.resistance"]["shipped_estimate"]
    assert records["motor.resistance"]["effect_deg"] is None
    assert records["motor.inductance"]["effect_deg"] > 0.0
    plain = json.loads(CliRunner().invoke(app, ["parameters", "-p", str(file), "--json"]).output)
    assert "effect_deg" not in plain[0]
    assert sum(r["shipped_estimate"] for r in plain) == sum(r["shipped_estimate"] for r in records.values())


def test_a_hinge_moment_that_is_none() -> None:
    refused = CliRunner().invoke(app, ["parameters", "--sensitivity", str(inf)])
    assert refused.exit_code == 2
    assert "--sensitivity inf: give a finite hinge moment in N.m" in refused.stderr
