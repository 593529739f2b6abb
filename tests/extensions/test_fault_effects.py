"""The effects of each fault against closed forms."""

from __future__ import annotations

from math import degrees, exp, pi, radians, sin, sqrt

import numpy as np
import pytest

from emcas_fmu.simulation import simulate
from tests.runs import assert_equal

from .fault_runs import BASE, BIT, MODEL, PLAIN, gust, scheduled, wave


def test_a_jammed_fin_rests_until_the_fault_ends() -> None:
    run = simulate(scheduled(MODEL, "jam", begin=0.05, end=0.15), 0.5, model=MODEL, fin_command=radians(15.0),
                   aero_torque=-60.0)
    jammed = slice(51, 151)
    assert (run["fin_angle"][jammed] == run["fin_angle"][51]).all()
    assert not run["motor_speed"][jammed].any()
    assert abs(degrees(run["fin_angle"][-1] - radians(15.0))) < 0.5


def test_stall_current_of_a_jam() -> None:
    """The current is that of the drive's reference under proportional control; its integral adds less than 5 %."""
    run = simulate(scheduled(MODEL, "jam", controller__position__ki=0.0), 0.3, model=MODEL, fin_command=radians(10.0))
    reference = 8.19 * run["drive_reference"][-1] - 0.015
    expected = (5.0 * reference) / (5.0 + 0.25)  # K_p i_ref/(K_p + R)
    assert run["motor_current"][-1] == pytest.approx(min(expected, 60.0), rel=0.05)


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "linear"])
def test_a_broken_fin_falls_by_its_own_inertia(model: str) -> None:
    """From rest under a constant moment (J_fin + J_shaft) delta = T t^2/2, which the midpoint rule solves exactly."""
    torque, inertia = 2.0, 0.05 + 0.004
    dry = {} if model == "linear" else {"friction__fin_coulomb": 0.0}
    values = scheduled(f"{model}+faults", "free_fin", fin__stop_angle="60 deg", **dry)
    run = simulate(values, 0.1, model=f"{model}+faults", aero_torque=torque)
    np.testing.assert_allclose(run["fin_angle"], 0.5 * torque / inertia * run["time"] ** 2, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(run["fin_rate"], torque / inertia * run["time"], rtol=1e-9, atol=1e-12)
    assert abs(run["motor_angle"]).max() < 0.5  # the motor stays at its command


def test_a_broken_fin_swings_on_its_torsion_bar() -> None:
    """The angle is T/k (1 - cos(w t)) with w = sqrt(k/J).

    The frequency of the midpoint rule is off by (w h)^2/24: with ticks of 0.5 ms, 9e-5 of the amplitude after 9.1 rad.
    """
    torque, stiffness = 5.0, 50.0
    values = scheduled("ristanovic+faults", "free_fin", load__torsion_bar=stiffness)
    run = simulate(values, 0.3, model="ristanovic+faults", aero_torque=torque)
    exact = torque / stiffness * (1.0 - np.cos(sqrt(stiffness / 0.054) * run["time"]))
    assert abs(run["fin_angle"] - exact).max() < 1e-4 * torque / stiffness


def test_a_broken_fin_with_viscous_friction() -> None:
    """The rate is T/b (1 - exp(-b t/J)).

    The midpoint rule takes b/J for larger by the share (b h/J)^2/12, 9e-6 with ticks of 0.7 ms: 1.1e-6 of the rate.
    """
    torque, inertia, viscous = 2.0, 0.054, 0.8
    run = simulate(scheduled(MODEL, "free_fin", friction__fin_viscous=viscous, fin__stop_angle="79 deg"), 0.2,
                   model=MODEL, aero_torque=torque)
    exact = torque / viscous * (1.0 - exp(-viscous * 0.2 / inertia))
    assert run["fin_rate"][-1] == pytest.approx(exact, rel=2e-6)


def test_dry_friction_stops_a_broken_fin() -> None:
    """After a push of 50 ms half of the friction's moment remains as a load: the other half stops the fin for good."""
    inertia, dry, torque = 0.054, 3.0, 8.0
    run = simulate(scheduled(MODEL, "free_fin", friction__fin_coulomb=dry, fin__stop_angle="79 deg"), 0.4, model=MODEL,
                   aero_torque=lambda t: torque if t < 0.0499 else 0.5 * dry)
    speed = (torque - dry) / inertia * 0.05
    expected = 0.5 * (torque - dry) / inertia * 0.05**2 + 0.5 * inertia * speed**2 / (0.5 * dry)
    assert run["fin_angle"][-1] == pytest.approx(expected, rel=1e-9)
    assert run["fin_rate"][-1] == 0.0


def test_a_broken_fin_swings_as_a_pendulum() -> None:
    """Only mass and centre of mass of the fin count: the period at small angles is 2 pi sqrt(J/(m g r))."""
    values = scheduled(MODEL, "free_fin", loads__gravity=True, center_of_mass__fin__x=0.0, center_of_mass__fin__z=0.2,
                       center_of_mass__fork__x=0.3, mass__fork=5.0, mass__fin=3.0, mass__shaft=0.0,
                       fin__start_angle="1 deg")
    run = simulate(values, 2.0, model=MODEL, step=1e-3)
    expected = 2.0 * pi * np.sqrt(0.054 / (3.0 * 9.80665 * 0.2))
    angle = run["fin_angle"]
    crossings = np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))
    share = angle[crossings] / (angle[crossings] - angle[crossings + 1])
    period = np.diff(run["time"][crossings] + 1e-3 * share).mean()
    assert period == pytest.approx(expected, rel=1e-4)  # an amplitude of 1 deg makes it longer by 2e-5


def test_a_broken_fin_rests_at_the_stop_and_does_not_heal() -> None:
    run = simulate(scheduled(MODEL, "free_fin", begin=0.05, end=0.06), 0.3, model=MODEL, aero_torque=30.0)
    assert run["fin_angle"][-1] == radians(25.0)
    assert run["at_stop"][-1]
    assert run["fault_word"][-1] == BIT["free_fin"]


def test_a_disabled_drive_has_no_hard_over() -> None:
    run = simulate(scheduled(MODEL, "hard_over"), 0.1, model=MODEL, enable=False)
    assert not run["drive_reference"].any()


@pytest.mark.parametrize("share", [1.0, -0.5])
def test_a_hard_over_drives_the_fin_to_its_stop(share: float) -> None:
    run = simulate(scheduled(MODEL, "hard_over", begin=0.02, fault__hard_over__share=share), 0.5, model=MODEL)
    assert (run["drive_reference"][21:] == share * 10.0).all()
    assert run["fin_angle"][-1] == pytest.approx(np.sign(share) * radians(25.0), rel=1e-12)
    assert run["at_stop"][-1]


def test_an_encoder_bias_displaces_the_fin() -> None:
    """The loop controls the measured angle. After 3 s its integral is off by up to 0.03 deg, as without a bias."""
    run = simulate(scheduled(MODEL, "encoder_bias", fault__encoder_bias__angle="1.5 deg"), 3.0, model=MODEL,
                   fin_command=radians(5.0))
    assert degrees(run["fin_angle"][-1]) == pytest.approx(5.0 - 1.5, abs=0.03)
    assert degrees(run["measured_fin_angle"][-1]) == pytest.approx(5.0, abs=0.03)


@pytest.mark.parametrize("on_fin", [False, True])
@pytest.mark.parametrize(("fault", "gain", "missed"), [
    ("encoder_freeze", 0.0, 0.0), ("encoder_reversed", -1.0, 0.0), ("encoder_dropped", 1.0, 0.2)])
def test_counts_of_a_faulty_encoder(on_fin: bool, fault: str, gain: float, missed: float) -> None:
    """The measured angle of motor or fin is the sum of the counted motion, to one count of 0.044 deg."""
    values = scheduled(MODEL, fault, encoder__on_fin=on_fin, fault__encoder_dropped__share=0.2)
    run = simulate(values, 0.2, model=MODEL, fin_command=lambda t: radians(2.0) * sin(30.0 * t))
    ratio, start = 0.05 / (5e-3 / (2.0 * pi)), radians(5.0)
    measured, angle = run["measured_fin_angle"], run["fin_angle"]
    if not on_fin:
        measured, angle = ratio * (np.tan(measured + start) - np.tan(start)), run["motor_angle"]
    motion = np.diff(angle)
    counted = np.cumsum(gain * (motion - missed * np.maximum(motion, 0.0)))
    # A row shows the angle at its time, and the measurement of the sample 1 ms before.
    assert np.abs(measured[2:] - counted[:-1]).max() <= 2.0 * pi / 8192 + 1e-9
    assert np.abs(angle).max() > 0.03


def test_a_reversed_encoder_reverses_the_speed_without_counts() -> None:
    """With true angles and speeds, too, a velocity loop alone drives with the motion: u = +K w."""
    values = scheduled(MODEL, "encoder_reversed", encoder__enabled=False, controller__position__kp=0.0,
                       controller__position__ki=0.0, compensation__gain=0.0)
    run = simulate(values, 0.02, model=MODEL, aero_torque=40.0)
    reference = values["controller.velocity.kp"] * run["motor_speed"][:-1]
    assert run["drive_reference"][1:] == pytest.approx(np.clip(reference, -10.0, 10.0), abs=1e-12)
    assert reference.max() > 0.1


def test_missed_counts_add_up_and_are_not_recovered() -> None:
    """The encoder misses a share of the upward motion in every cycle, and the fin drifts up by it."""
    run = simulate(scheduled(MODEL, "encoder_dropped", fault__encoder_dropped__share=0.02), 3.0, model=MODEL,
                   fin_command=lambda t: radians(5.0) * (1.0 - np.cos(2.0 * pi * t)))
    motor = run["motor_angle"]
    upwards = sum(np.maximum(np.diff(motor[1000:2001]), 0.0))
    # The measured angle is the same again, to two counts of 8e-4 rad and 1e-3 rad of the integral's creep.
    assert motor[2000] - motor[1000] == pytest.approx(0.02 * upwards, abs=3e-3)
    assert motor[2000] - motor[1000] > 0.2
    healed = simulate(scheduled(MODEL, "encoder_dropped", end=0.5, fault__encoder_dropped__share=0.3), 4.0, model=MODEL,
                      fin_command=radians(5.0))
    assert degrees(healed["measured_fin_angle"][-1]) == pytest.approx(5.0, abs=0.03)
    assert degrees(healed["fin_angle"][-1]) > 5.5


def test_a_broken_fin_without_load_and_friction_keeps_its_rate() -> None:
    run = simulate(scheduled(MODEL, "free_fin", begin=0.05), 0.1, model=MODEL,
                   fin_command=lambda t: radians(20.0) * sin(8.0 * t))
    rate = run["fin_rate"][50]
    assert degrees(rate) > 50.0
    np.testing.assert_allclose(run["fin_rate"][51:], rate, rtol=1e-12)
    coasted = run["fin_angle"][50] + rate * (run["time"][50:] - 0.05)
    np.testing.assert_allclose(run["fin_angle"][50:], coasted, rtol=0.0, atol=1e-12)


def test_with_a_broken_fin_the_drive_moves_only_the_fork() -> None:
    """As an actuator without load, fin and shaft, but for a stub with 0.1 % of the fin's inertia."""
    loads = {"loads.gravity": True, "mass.fin": 8.0, "mass.shaft": 2.0, "center_of_mass.fin.x": 0.3,
             "friction.fin_coulomb": 4.0}
    broken = simulate(BASE.with_values({**loads, "fault.free_fin.active": True}).values, 0.3, model=MODEL,
                      fin_command=wave, aero_torque=gust)
    fork = {"mass.fin": 0.0, "mass.shaft": 0.0, "friction.fin_coulomb": 0.0, "inertia.shaft": 0.0,
            "inertia.fin": 1e-3 * PLAIN.values["inertia.fin"]}
    plain = simulate(PLAIN.with_values({**loads, **fork}).values, 0.3, fin_command=wave)
    assert_equal(broken, {name: plain[name] for name in ("motor_angle", "motor_current")})


def test_friction_also_rises_on_a_broken_fin() -> None:
    values = scheduled(MODEL, "free_fin", "friction_rise", friction__fin_coulomb=3.0, fault__friction_rise__factor=3.0)
    run = simulate(values, 0.2, model=MODEL, aero_torque=lambda t: 8.9 if t < 0.1 else 9.1)
    assert not run["fin_angle"][:101].any()
    assert run["fin_angle"][-1] > 0.0


def test_an_encoder_on_the_fin_measures_the_broken_fin() -> None:
    run = simulate(scheduled(MODEL, "free_fin", encoder__on_fin=True), 0.2, model=MODEL, aero_torque=1.0)
    # A count of the fin is 0.044 deg; the measurement is 1 ms old, in which the fin moves less than 0.3 deg.
    assert np.degrees(np.abs(run["measured_fin_angle"][1:] - run["fin_angle"][:-1])).max() < 0.35
    on_motor = simulate(scheduled(MODEL, "free_fin"), 0.2, model=MODEL, aero_torque=1.0)
    assert abs(on_motor["measured_fin_angle"]).max() < radians(0.1)
