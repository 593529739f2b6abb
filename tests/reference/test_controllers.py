"""Optional parts of the controllers and deviations as built, against independent integration and closed forms."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.reference.plant import simulate as reference
from emcas_fmu.simulation import simulate
from tests.marks import others_slow

LOOPS = {
    "controller.position.setpoint_weight": 0.92, "controller.position.velocity_feedforward": 0.4,
    "controller.velocity.ki": 0.4, "controller.load_observer": 80.0, "controller.drive_antiwindup": 10.0,
}
AS_BUILT = {
    "deviation.kinematics.moment_arm": 0.03, "deviation.kinematics.initial_angle": math.radians(1.5),
    "deviation.screw.lead": -0.02, "deviation.motor.torque_constant": -0.06, "deviation.friction.coulomb": 0.5,
    "deviation.friction.viscous": -0.4, "deviation.mass.fin": 0.3,
}
P_LOOPS = {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0}
# A velocity integral together with a load observer makes a limit cycle about the friction, which amplifies rounding.
CASES: Mapping[str, Mapping[str, Any]] = {
    "loops": {**LOOPS, "controller.load_observer": 0.0},
    "observer": {**LOOPS, "controller.velocity.ki": 0.0},
    "P loops": {**P_LOOPS, "controller.drive_antiwindup": 10.0, "drive.current_limit": 30.0},
    "feedforward of a slow bus": {"controller.position.velocity_feedforward": 0.4, "command.update_time": 5e-3},
    "as built": AS_BUILT, "fin's angle as built": {**AS_BUILT, "encoder.on_fin": True},
    "observer as built": {**AS_BUILT, "controller.load_observer": 80.0, "drive.current_limit": 45.0}}


def changed(changes: Mapping[str, Any], model: str = "nonlinear") -> Mapping[str, Any]:
    return load_parameters(model=model).with_values({"encoder.enabled": False, **changes}).values


@pytest.mark.parametrize("case", others_slow(CASES, lambda case: case == "observer as built"))
def test_independent_integration_agrees(case: str) -> None:
    values = changed({**CASES[case], "fin.start_angle": math.radians(8.0)})
    time = np.arange(401) * 1e-3
    command = np.radians(np.select([time < 0.03, time < 0.2], [8.0, 3.0], 8.0))
    inputs = {"fin_command": command, "aero_torque": np.where((time > 0.12) & (time < 0.28), 100.0, -60.0),
              "enable": np.where((time > 0.32) & (time < 0.36), 0.0, 1.0)}
    ours = simulate(values, 0.4, 1e-3, **inputs)
    theirs = reference(values, {"time": time, **inputs})
    # The limit of every reference case at the default tick.
    assert np.max(np.abs(np.degrees(ours["fin_angle"] - theirs["fin_angle"]))) < 0.002


def test_linear_reference_has_the_same_controllers() -> None:
    loops = {name: value for name, value in LOOPS.items() if name != "controller.drive_antiwindup"}
    linear = load_parameters(model="linear").with_values({**loops, "kinematics.initial_angle": 0.0}).values
    command = np.radians(np.where(np.arange(301) > 10, 2.0, 0.0))
    ours = simulate(linear, 0.3, 1e-3, model="linear", fin_command=command)["fin_angle"]
    theirs = LinearModel({**load_parameters().values, **linear}).simulate(command)
    # Ticks of 0.5 ms against exact exponentials: 4e-6 rad measured, 1e-4 of the step.
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=8e-6)
    plain = LinearModel({**load_parameters().values, **linear, **dict.fromkeys(loops, 0.0)}).simulate(command)
    assert np.max(np.abs(plain - theirs)) > 1e-3


@pytest.mark.parametrize("changes", [
    {"deviation.kinematics.moment_arm": 0.03}, {"deviation.motor.torque_constant": -0.2},
    {"deviation.screw.lead": -0.05, "deviation.friction.viscous": 4.0, "friction.fin_viscous": 5.0},
    {**AS_BUILT, "deviation.friction.coulomb": 0.0, "controller.load_observer": 120.0},
    *({"command.latency": late} for late in (0.5e-3, 2.5e-3, 4.5e-3, 3.4e-3))])
def test_linear_reference_has_the_same_deviations_and_latency(changes: Mapping[str, float]) -> None:
    parameters = load_parameters(model="linear")
    linear = parameters.with_values({"drive.transport_delay": 3.5e-3, **parameters.having(changes)}).values
    command = np.radians(np.where(np.arange(301) > 10, 2.0, 0.0))
    ours = simulate(linear, 0.3, 1e-3, model="linear", fin_command=command)["fin_angle"]
    theirs = LinearModel(linear).simulate(command)
    # Ticks of 0.5 ms against exact exponentials, as above. The changes matter.
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=8e-6)
    assert np.max(np.abs(theirs - LinearModel({**linear, **dict.fromkeys(changes, 0.0)}).simulate(command))) > 2e-4


@pytest.mark.parametrize(("name", "value", "message"), [
    ("command.resolution", 0.01, "command.resolution = 0.01 rad: the linear model has no such effect; set"),
    ("command.update_time", 1.5e-3, "command.update_time = 0.0015 s: the linear model has no such effect")])
def test_linear_reference_refuses_resolution_and_update_time(name: str, value: float, message: str) -> None:
    values = load_parameters().values
    with pytest.raises(EmcasError, match=re.escape(message)):
        LinearModel({**values, name: value})
    LinearModel({**values, "command.update_time": 1.4e-3})  # rounded to one sample


@pytest.mark.parametrize(("name", "deviation"), [
    ("kinematics.moment_arm", 0.01), ("screw.lead", -0.01), ("kinematics.initial_angle", math.radians(1.0))])
def test_deviation_of_the_lever_causes_the_expected_error_at_20_deg(name: str, deviation: float) -> None:
    """The motor moves to 20 deg of the nominal lever; the fin angle is that of the lever as built, (2.1)-(2.5)."""
    values = changed({f"deviation.{name}": deviation})
    angle = simulate(values, 1.5, 1e-3, fin_command=math.radians(20.0))["fin_angle"][-1]
    arm, lead, assembly = (values[n] for n in ("kinematics.moment_arm", "screw.lead", "kinematics.initial_angle"))
    motor = arm / lead * (math.tan(math.radians(20.0) + assembly) - math.tan(assembly))
    built = {"kinematics.moment_arm": arm, "screw.lead": lead, "kinematics.initial_angle": assembly}
    built[name] = built[name] + deviation if name.endswith("angle") else built[name] * (1.0 + deviation)
    start = built["kinematics.initial_angle"]
    expected = math.atan(built["screw.lead"] * motor / built["kinematics.moment_arm"] + math.tan(start)) - start
    # Friction stops the motor near its target: 8e-4 deg measured.
    assert math.degrees(angle) == pytest.approx(math.degrees(expected), abs=2e-3)
    if name == "kinematics.moment_arm":
        assert math.radians(20.0) - angle == pytest.approx(math.radians(0.177), abs=math.radians(0.005))


def test_with_an_encoder_on_the_fin_deviations_of_the_lever_cause_no_error() -> None:
    values = changed({"deviation.kinematics.moment_arm": 0.01, "encoder.on_fin": True})
    angle = simulate(values, 1.5, 1e-3, fin_command=math.radians(20.0))["fin_angle"][-1]
    assert math.degrees(angle) == pytest.approx(20.0, abs=2e-3)  # friction; 0.177 deg without this encoder


@pytest.mark.parametrize("weight", [0.0, 0.7, 1.3])
@pytest.mark.parametrize("encoder", [False, True])
def test_a_fin_at_its_command_stays_there_through_start_and_enabling(weight: float, encoder: bool) -> None:
    """It is at rest to the bit, with any setpoint weight."""
    values = changed({"controller.position.setpoint_weight": weight, "encoder.enabled": encoder,
                      "controller.load_observer": 100.0, "controller.position.velocity_feedforward": 0.5,
                      "drive.current_offset": 0.0, "fin.start_angle": math.radians(-12.0)})
    enable = np.ones(401)
    enable[150:250] = 0.0
    run = simulate(values, 0.4, 1e-3, fin_command=math.radians(-12.0), enable=enable)
    # The reference of an error below a count, 0.0007 deg of the fin, does not overcome friction.
    assert np.ptp(run["fin_angle"]) == 0.0


@pytest.mark.parametrize("angle", [-11.7, 0.3, 7.9])
@pytest.mark.parametrize("on_fin", [False, True])
def test_feedforward_does_not_change_the_current_of_a_constant_command(angle: float, on_fin: bool) -> None:
    """The rate of the command is 0 at the start and when enabled, with any counts of the encoder."""
    enable = np.ones(301)
    enable[100:200] = 0.0
    runs = [simulate(changed({"encoder.enabled": True, "encoder.on_fin": on_fin, "fin.start_angle": math.radians(angle),
                              "controller.position.velocity_feedforward": share}), 0.3, 1e-3,
                     fin_command=math.radians(angle), enable=enable) for share in (0.0, 1.0)]
    assert np.array_equal(runs[0]["motor_current"], runs[1]["motor_current"])


def test_anti_windup_leaves_no_offset_in_p_loops() -> None:
    """After the drive was at its limit, a loop without an integral must have no offset."""
    command = np.radians(np.repeat([20.0, -20.0, 0.0], 500))
    run = simulate(changed({**P_LOOPS, "controller.drive_antiwindup": 10.0}), 1.499, 1e-3, fin_command=command)
    ends = np.degrees(run["fin_angle"][[499, 999, 1499]])
    # Friction and the drive's offset cause an error of 0.02 deg; integrals that moved would cause 2.5 to 4.5 deg.
    np.testing.assert_allclose(ends, [20.0, -20.0, 0.0], rtol=0, atol=0.05)


def test_load_observer_halves_the_deviation_with_a_pwm_amplifier() -> None:
    """The reference is a voltage, which opposes the load by K_t/R per volt."""
    load = np.where(np.arange(801) > 500, -50.0, 0.0)

    def deviation(bandwidth: float) -> float:
        run = simulate(changed({"controller.load_observer": bandwidth}, "ristanovic"), 0.8, 1e-3, model="ristanovic",
                       fin_command=math.radians(5.0), aero_torque=load)
        return float(np.ptp(run["fin_angle"][490:]))

    assert deviation(100.0) < 0.6 * deviation(0.0)


def test_setpoint_weight_does_not_change_the_response_to_a_load() -> None:
    load = np.where(np.arange(401) > 50, 100.0, 0.0)
    runs = [simulate(changed({"controller.position.setpoint_weight": weight}), 0.4, 1e-3, aero_torque=load)["fin_angle"]
            for weight in (1.0, 0.9)]
    # The command is 0, so only rounding differs.
    np.testing.assert_allclose(runs[0], runs[1], rtol=0, atol=1e-12)


def test_load_observer_halves_the_deviation_and_keeps_the_rate() -> None:
    time = np.arange(801) * 1e-3
    on, off = ({"controller.load_observer": rate} for rate in (200.0, 0.0))

    def deviation(changes: Mapping[str, float]) -> float:
        run = simulate(changed(changes), 0.8, 1e-3, aero_torque=np.where(time > 0.3, 100.0, 0.0))
        return float(np.degrees(np.max(np.abs(run["fin_angle"]))))

    def rate(changes: Mapping[str, float]) -> float:
        slewing = time > 0.4
        run = simulate(changed(changes), 0.8, 1e-3, fin_command=np.radians(np.where(slewing, 20.0, -20.0)),
                       aero_torque=np.where(slewing, -100.0, 0.0))
        fin = np.degrees(run["fin_angle"][400:])
        return float(20.0 / (1e-3 * (np.argmax(fin > 10.0) - np.argmax(fin > -10.0))))

    assert deviation(on) < 0.6 * deviation(off)
    assert rate(on) > 240.0 > rate(off)


def test_anti_windup_reduces_the_overshoot_after_an_excessive_load() -> None:
    """A load above the drive's limit moves the fin away; without anti-windup it overshoots far when the load ends.

    With a load that the drive still holds, anti-windup does not change the overshoot.
    """
    time = np.arange(2501) * 1e-3

    def response(load: float, gain: float | None = None) -> tuple[float, float]:
        """Return the deviation under the load and the overshoot after it [deg], by default with the shipped gain."""
        gains = {} if gain is None else {"controller.drive_antiwindup": gain}
        run = simulate(changed({"encoder.enabled": True, **gains}), 2.5, 1e-3,
                       aero_torque=np.where((time > 0.2) & (time < 1.7), load, 0.0))
        angle = np.degrees(run["fin_angle"]) * np.sign(load)
        return float(np.max(angle[:1700])), float(-np.min(angle[1700:]))

    for load in (-400.0, 400.0):
        (deviation, overshoot), (deviation_without, overshoot_without) = response(load), response(load, 0.0)
        assert overshoot < 0.5 * overshoot_without
        # The drive is at its limit with and without anti-windup, so the deviation is about the same.
        assert deviation < deviation_without + 0.1
    for load in (-380.0, 380.0):
        # The state at the end of the load changes the overshoot by up to 0.15 deg.
        assert response(load)[1] == pytest.approx(response(load, 0.0)[1], abs=0.15)


def test_anti_windup_uses_the_current_limit_of_a_hot_drive() -> None:
    """After seconds at 250 N.m the I2t limit is 21 A, half of the current needed; afterwards the fin hardly overshoots.
    """
    time = np.arange(9001) * 1e-3
    values = load_parameters(model="nonlinear+heat").values
    run = simulate(values, 9.0, 1e-3, model="nonlinear+heat",
                   aero_torque=np.where((time > 0.5) & (time < 8.0), 250.0, 0.0))
    angle = np.degrees(run["fin_angle"])
    assert run["current_limit"][7999] < 22.0
    assert angle[7999] > 20.0
    # It would be 0.41 deg with the limit of a cold drive, 2.4 deg without anti-windup.
    assert np.min(angle[8000:]) > -0.1


@pytest.mark.parametrize(("amplitude", "update_time", "share", "highest"), [
    (2.0, 0.0, 0.46, 0.7),
    # Pulses at each update would meet the speed limit and reduce the lag of 46 deg by 0.4 deg, the filtered rate by a
    # third.
    (5.0, 0.01, 0.5, 0.75)])
def test_feedforward_reduces_the_lag_of_a_sine(amplitude: float, update_time: float, share: float, highest: float
                                               ) -> None:
    time = np.arange(1601) * 1e-3
    command = np.radians(amplitude * np.sin(2.0 * np.pi * 5.0 * time))

    def lag(share: float) -> float:
        values = changed({"controller.position.velocity_feedforward": share, "command.update_time": update_time})
        run = simulate(values, 1.6, 1e-3, fin_command=command)
        steady = slice(600, 1600)
        phase = np.exp(-2j * np.pi * 5.0 * time[steady])
        return float(-np.degrees(np.angle(np.sum(run["fin_angle"][steady] * phase) / np.sum(command[steady] * phase))))

    assert lag(share) < highest * lag(0.0)
