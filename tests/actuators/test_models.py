"""The linear and the second-order actuator against closed forms, the fit of the latter, and names of variables."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.electromechanical import interface as electromechanical
from emcas_fmu.actuators.hydraulic import interface as hydraulic
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.fitting import MODEL, fit, write_fitted


def test_linear_actuator_agrees_with_the_thesis_linear_model() -> None:
    """The error against matrix exponentials is of second order in the tick, and small at the default tick."""
    command = np.full(301, 0.1)
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):  # the delay of 3.5 ms is a multiple of each
        values = load_parameters(model="linear").with_values({
            "solver.max_tick": tick, "drive.transport_delay": 3.5e-3}).values
        found = simulate(values, 0.3, model="linear", fin_command=command)["fin_angle"]
        errors.append(np.abs(found - LinearModel(values).simulate(command)).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.3), slopes  # ticks are too long for exactly 2
    assert np.degrees(errors[0]) < 1e-4  # of 5.7 deg; a count of the encoder is 7e-4 deg of the fin


def test_linear_is_linear_in_commands_and_loads() -> None:
    values = load_parameters(model="linear").values

    def response(command: float, torque: float) -> Any:
        return simulate(values, 0.2, model="linear", fin_command=command, aero_torque=torque)["fin_angle"]

    together = response(0.1, -40.0)
    # Ticks end where the motion reverses, so the responses differ by the error of ticks, 8e-5 deg at most (above).
    assert together == pytest.approx(response(0.1, 0.0) + response(0.0, -40.0), abs=radians(8e-5))
    assert 2.0 * response(0.05, 0.0) == pytest.approx(response(0.1, 0.0), abs=1e-12)


def test_linear_actuator_with_p_control_has_the_thesis_load_error() -> None:
    """Section 4.1: T_f/N over K_pos K_vel K_v K_t times the share of the current that the drive's P control reaches."""
    values = load_parameters(model="linear").with_values({"controller.position.ki": 0.0, "drive.ki": 0.0}).values
    run = simulate(values, 1.0, model="linear", aero_torque=-30.0)
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    share = values["drive.kp"] / (values["drive.kp"] + values["motor.resistance"])
    stiffness = (values["controller.position.kp"] * values["controller.velocity.kp"] * values["drive.current_gain"]
                 * values["motor.torque_constant"] * share)
    # After 1 s the loops have settled to 1e-6.
    assert run["fin_angle"][-1] == pytest.approx(-30.0 / ratio / stiffness / ratio, rel=1e-4)


@pytest.mark.parametrize("damping", [0.0, 0.2, 0.7, 1.0, 1.0 + 1e-10, 1.5, 30.0])
def test_second_order_step_response_has_the_closed_form(damping: float) -> None:
    values = load_parameters(model=MODEL).with_values({
        "second_order.damping": damping, "second_order.rate_limit": 1e5, "drive.transport_delay": 0.0}).values
    frequency = values["second_order.natural_frequency"]
    run = simulate(values, 0.2, model=MODEL, fin_command=0.05)
    system = ([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2])
    _, exact, _ = lsim(system, np.full(len(run["time"]), 0.05), run["time"])
    # Both are exact for a constant command: rounding is left, and 1e-9 relative where near roots count as double.
    assert run["fin_angle"] == pytest.approx(exact, abs=1e-10)


def test_second_order_keeps_its_limits() -> None:
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.3, 1e-4, model=MODEL, fin_command=lambda t: 0.34 if t < 0.15 else -0.34)
    limit = values["second_order.rate_limit"]
    assert np.abs(run["fin_rate"]).max() == pytest.approx(limit, rel=1e-12)
    slewing = np.abs(run["fin_rate"]) > limit * (1.0 - 1e-9)
    assert slewing.sum() > 500
    assert np.all(run["saturated"][slewing] > 0.0)
    travelled = np.abs(np.diff(run["fin_angle"])[slewing[1:] & slewing[:-1]])
    assert np.median(travelled) == pytest.approx(limit * 1e-4, rel=1e-9)
    assert travelled == pytest.approx(limit * 1e-4, rel=0.1)  # also in ticks in which the limit is met or left


def test_second_order_rate_limit_converges_to_second_order() -> None:
    def run(tick: float) -> Any:
        values = load_parameters(model=MODEL).with_values({"solver.max_tick": tick}).values
        return simulate(values, 0.2, model=MODEL, fin_command=0.3)["fin_angle"]

    finest = run(1e-6)
    errors = [np.abs(run(tick) - finest).max() for tick in (4e-4, 2e-4, 1e-4)]
    assert np.degrees(errors[0]) < 0.01  # of 17 deg, at half the largest tick
    # Second order is a factor of 16; the position of the limit's onset within a tick changes it.
    assert errors[2] < errors[0] / 6.0


def test_second_order_fin_stops_at_once_when_disabled() -> None:
    """Delayed commands do not move it; when enabled, the motion continues from this angle."""
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.3, model=MODEL, fin_command=0.3, enable=lambda t: not 0.05 <= t + 1e-9 < 0.1)
    assert 0.05 < run["fin_angle"][50] < 0.25
    assert np.all(run["fin_angle"][50:101] == run["fin_angle"][50])
    assert np.all(run["fin_rate"][51:101] == 0.0)
    assert run["fin_angle"][-1] == pytest.approx(0.3, abs=1e-3)


def test_second_order_has_only_the_outputs_of_the_fin_port() -> None:
    """Its hinge torque is the load, which does not move the fin."""
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.1, model=MODEL, fin_command=0.4, aero_torque=-12.0)
    assert set(run) == {"time", "fin_angle", "fin_rate", "hinge_torque", "tracking_error", "measured_fin_angle",
                        "saturated", "at_stop"}
    assert run["hinge_torque"] == pytest.approx(-12.0)
    assert run["tracking_error"] == pytest.approx(values["command.limit"] - run["fin_angle"], abs=1e-15)
    assert np.all(run["saturated"][2:] > 0.0)  # the command is beyond its limit from the first sample on


def test_second_order_fin_meets_and_leaves_its_stop() -> None:
    values = load_parameters(model=MODEL).with_values({
        "fin.stop_angle": radians(20.0), "second_order.damping": 0.1, "second_order.rate_limit": 1e3}).values
    run = simulate(values, 0.5, 1e-4, model=MODEL, fin_command=radians(19.5))
    # It leaves the stop with w_n^2 0.5 deg = 720 rad/s2, by 3.6e-6 rad until the next row.
    assert radians(20.0) - 4e-6 < run["fin_angle"].max() <= radians(20.0)
    assert run["fin_angle"][-1] < radians(20.0)


def test_shipped_second_order_values_are_the_fit_of_the_shipped_nonlinear_ones() -> None:
    found = fit(load_parameters())
    assert max(found.rms) < 6.0  # % of the step; a fin that rests at its command has 20 and more
    shipped = load_parameters(model=MODEL).values
    # The file has four digits, the last of which may depend on the compiler.
    for name, value in found.parameters.values.items():
        assert shipped[name] == pytest.approx(value, rel=2e-3), name


def test_a_fit_at_a_bound_has_a_warning() -> None:
    found = fit(load_parameters())
    assert (found.at_bound, found.warnings) == ({}, ())
    found = replace(found, parameters=found.parameters.with_values({"second_order.damping": 3.0}))
    assert found.figures()["at_bound"] == {"second_order.damping": "upper"}
    warning, = found.warnings
    assert warning.startswith("second_order.damping = 3 is at the upper bound of the fit")


def test_rate_limit_that_no_step_reaches_is_not_called_fitted(tmp_path: Path) -> None:
    found = fit(load_parameters().with_values({"command.limit": radians(0.5)}))
    assert found.figures()["undetermined"] == ("second_order.rate_limit",)
    warning, = found.warnings
    assert warning == "second_order.rate_limit = 4 is the initial value: no step depends on it"
    write_fitted(found, tmp_path / "fitted.toml", "a test")
    notes = {e.variable.name: e.note for e in load_parameters(tmp_path / "fitted.toml", model=MODEL).entries}
    assert notes["second_order.rate_limit"] == "Initial value of a fit whose steps do not depend on it."
    assert notes["second_order.damping"] == "Fitted to the nonlinear model."


def test_written_fit_has_all_changed_values(tmp_path: Path) -> None:
    found = fit(load_parameters().with_values({
        "command.limit": radians(25.0), "fin.stop_angle": radians(28.0), "kinematics.moment_arm": 0.06,
        "encoder.pulses": 1024, "friction.coulomb.positive[1]": 0.02, "loads.gravity": True}))
    write_fitted(found, tmp_path / "fitted.toml", "a test")
    again = load_parameters(tmp_path / "fitted.toml", model=MODEL)
    assert dict(again.values) == dict(found.parameters.values)
    assert again.values["command.limit"] == radians(25.0)


def test_a_name_has_the_same_kind_unit_and_limits_in_every_actuator() -> None:
    """Limits of outputs may differ (a pump returns no power), and those of angles (a servo has no lever)."""
    angles = {"command.limit", "fin.stop_angle", "fin.start_angle"}
    attributes: dict[str, Any] = {}
    for v in (v for name in NAMES for v in get(name).inputs + get(name).outputs + get(name).file_entries):
        limits = () if v.causality == "output" or v.name in angles else (v.minimum, v.maximum)
        same = (v.kind, v.causality, v.variability, v.unit, *limits)
        assert attributes.setdefault(v.name, same) == same, v.name
    assert {"second_order.damping", "pwm.gain"} <= set(attributes)


@pytest.mark.parametrize("names", [
    (electromechanical.PARAMETER_ORDER, "parameters"), (electromechanical.OUTPUT_ORDER, "outputs"),
    (hydraulic._OUTPUT_ORDER, "outputs")], ids=("parameters", "outputs", "hydraulic outputs"))
def test_every_place_in_the_order_of_variables_is_that_of_a_variable(names: tuple[tuple[str, ...], str]) -> None:
    """A renamed variable would lose its place, and move to the end of the interface."""
    order, kind = names
    used = {next((prefix for prefix in order if v.name.startswith(prefix)), "") for each in NAMES
            for v in getattr(get(each), kind)}
    assert set(order) <= used


def test_unknown_actuators_and_parameters_are_refused() -> None:
    with pytest.raises(EmcasError, match=r"no actuator 'hydraulic';.* there is nonlinear, linear"):
        get("hydraulic")
    with pytest.raises(ParameterError, match="the nonlinear actuator has no such parameter"):
        load_parameters().with_values({"second_order.damping": 0.5})
    with pytest.raises(ParameterError, match=r"second_order.damping = -1\.0"):
        load_parameters(model=MODEL).with_values({"second_order.damping": -1.0})


@pytest.mark.parametrize(("model", "word"), [
    ("linear", "encoder"), ("electrohydraulic+faults", "the encoder"), ("electrohydraulic", "thesis"),
    ("electrohydrostatic", "thesis")])
def test_descriptions_name_no_part_that_the_actuator_lacks(model: str, word: str) -> None:
    actuator = get(model)
    assert [v.name for v in (*actuator.parameters, *actuator.inputs, *actuator.outputs) if word in v.description] == []
