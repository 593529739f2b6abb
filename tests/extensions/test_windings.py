"""Shorted terminals and a lost phase: closed forms, independent integrations of phases and rotor, and energy."""

from __future__ import annotations

from math import pi, radians, sin, tan
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.capabilities import PHASES
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import others_slow
from tests.runs import assert_equal

from .fault_runs import MODEL, scheduled, wave
from .runs import BLOCKED, WAYS, values_of

R, L, K = 0.25, 0.6e-3, 0.11  # Ohm, H, N.m/A of the default motor
LEAD, ARM, TILT = 5e-3 / (2.0 * pi), 0.05, tan(radians(5.0))
ROTOR, FIN = 2.81e-4 + 4.5e-6 + 0.5 * LEAD**2, 0.06  # kg.m2
SMOOTH = {f"friction__coulomb__{way}[{power}]": 0.0 for way in WAYS for power in range(7)} | {
    f"friction__viscous__{way}": 5e-4 for way in WAYS}
HAVE = [name for name in NAMES if PHASES in get(name).provides]


def _braking(pairs: float, speed: Any) -> Any:
    return K * K * speed * R / (R * R + (pairs * speed * L) ** 2)


@pytest.mark.parametrize("pairs", [0, 4, 8])
@pytest.mark.parametrize("torque", [10.0, -30.0])
def test_braking_torque_of_shorted_terminals(pairs: int, torque: float) -> None:
    """A constant load turns the linear model at the speed at which K^2 w R/(R^2 + (n w L)^2) balances it.

    0.3 s are twenty time constants: less than 1e-6 of the load still accelerates the motor.
    """
    run = simulate(scheduled("linear+faults", "winding_short", fault__winding_short__pole_pairs=pairs), 0.3,
                   model="linear+faults", aero_torque=torque)
    speed, ratio, viscous = run["motor_speed"][-1], ARM / LEAD, 0.5 * (5e-4 + 4.6e-4)
    assert run["motor_torque"][-1] == pytest.approx(-_braking(pairs, speed), rel=1e-9)
    assert torque / ratio == pytest.approx(_braking(pairs, speed) + viscous * speed, rel=1e-6)


@pytest.mark.parametrize(("pairs", "load"), [(0, 100.0), (4, 100.0), (4, 150.0)])
def test_shorted_terminals_in_the_rotors_axes(pairs: int, load: float) -> None:
    """The model has the current d of a constant speed, the integration the currents q and d from rest.

    Measured errors: 0.0052 deg under 100 N.m (limit 0.012), 0.035 under 150, near the largest torque (limit 0.06).
    Without pole pairs there is no current d, and the error of the ticks remains (0.0010).
    """
    run = simulate(scheduled(MODEL, "winding_short", fault__winding_short__pole_pairs=pairs, **SMOOTH), 0.3,
                   model=MODEL, aero_torque=load, enable=False)

    def rates(_: float, y: Any) -> list[float]:
        angle, speed, q, d = y.tolist()
        tangent = LEAD / ARM * angle + TILT
        ratio = ARM / LEAD * (1.0 + tangent * tangent)
        torque = K * q + load / ratio - 5e-4 * speed + 2.0 * tangent * FIN / ratio**3 * speed * speed
        return [speed, torque / (ROTOR + FIN / ratio**2), (-R * q - pairs * speed * L * d - K * speed) / L,
                (-R * d + pairs * speed * L * q) / L]

    exact = solve_ivp(rates, (0.0, 0.3), [0.0] * 4, t_eval=run["time"], rtol=1e-9, atol=1e-10, method="LSODA").y
    fin = np.arctan(LEAD / ARM * exact[0] + TILT) - radians(5.0)
    before_the_stop = fin < radians(24.9)
    error = np.degrees(np.abs(run["fin_angle"] - fin)[before_the_stop]).max()
    assert error < {(0, 100.0): 2e-3, (4, 100.0): 0.012, (4, 150.0): 0.06}[pairs, load]
    assert np.degrees(fin[before_the_stop]).max() > 2.0


@pytest.mark.parametrize(("pairs", "order"), [(0, 2), (4, 1)])
def test_order_of_shorted_terminals_in_the_tick(pairs: int, order: int) -> None:
    """With pole pairs the order is 1, since the resistance is that of the speed at the start of a tick.

    The reference has ticks of 10 us, 4 % of the finer ones. A quarter of the tick divides the error by 4^order
    (measured 16.0 and 4.2); the limits are half a power of two for each order.
    """
    angles = {tick: simulate(scheduled(MODEL, "winding_short", fault__winding_short__pole_pairs=pairs,
                                       drive__transport_delay=4e-3, solver__max_tick=tick, **SMOOTH), 0.05, model=MODEL,
                             aero_torque=100.0)["motor_angle"] for tick in (1e-3, 2.5e-4, 1e-5)}
    coarse, fine = (np.abs(angles[tick] - angles[1e-5]).max() for tick in (1e-3, 2.5e-4))
    assert 1.5 * order < np.log2(coarse / fine) < 2.5 * order
    assert np.degrees(coarse) * LEAD / ARM < 2e-3  # of the fin: measured 0.0002 and 0.0012 deg


def test_shorted_terminals_also_brake_with_a_disabled_drive() -> None:
    """Enabled, the current loop adds 1e-11 A; an open bridge does not brake."""
    shorted = scheduled(MODEL, "winding_short")
    off, on, free = (simulate(values, 0.3, model=MODEL, aero_torque=60.0, enable=enable)
                     for values, enable in ((shorted, False), (shorted, True), (scheduled(MODEL), False)))
    np.testing.assert_allclose(off["motor_angle"], on["motor_angle"], atol=1e-9)
    assert 0.0 < off["fin_angle"][-1] < 0.3 * free["fin_angle"][-1]


@pytest.mark.parametrize("model", others_slow(HAVE, lambda model: model != "worm-gear-elastic"))
def test_shorted_terminals_draw_no_power(model: str) -> None:
    """The kinetic energy of a slew becomes heat; the current loop adds 1e-10 V."""
    run = simulate(scheduled(f"{model}+faults", "winding_short", begin=0.08), 0.3, model=f"{model}+faults",
                   fin_command=wave, aero_torque=20.0)
    assert np.abs(run["supply_power"][82:]).max() < 1e-6
    assert (run["motor_torque"] * run["motor_speed"])[90:].max() <= 0.0


@pytest.mark.parametrize("degree", [0.0, 7.0, 22.5, 40.0])
def test_stall_torque_without_a_phase(degree: float) -> None:
    """The share of the whole motor's torque is sin^2 n (theta - theta_0), to rounding."""
    values: dict[str, Any] = {"controller__position__ki": 0.0, "drive__ki": 0.0}
    whole, part = (simulate(scheduled(MODEL, "jam", *lost, fault__phase_loss__angle=radians(-degree), **values), 0.1,
                            model=MODEL, fin_command=radians(5.0)) for lost in ((), ("phase_loss",)))
    expected = max(sin(4.0 * radians(degree)) ** 2, 1e-12)
    assert whole["motor_torque"][-1] > 1.0
    assert part["motor_torque"][-1] == pytest.approx(expected * whole["motor_torque"][-1], rel=1e-9)


def test_a_motor_without_a_phase_does_not_start_at_an_angle_without_torque() -> None:
    without, largest = (simulate(scheduled(MODEL, "phase_loss", fault__phase_loss__angle=radians(angle)), 0.3,
                                 model=MODEL, fin_command=radians(1.0)) for angle in (0.0, 22.5))
    assert not without["motor_angle"].any()
    assert largest["fin_angle"][-1] > radians(0.5)


@pytest.mark.parametrize("share", [0.1, -0.2])
def test_a_constant_reference_without_a_phase(share: float) -> None:
    """An independent integration of the two phases in series, over some 20 sines of the torque.

    Ticks of 0.1 ms are within 0.008 deg (measured 0.0003 and 0.0042; half the tick leaves a quarter).
    """
    run = simulate(scheduled(MODEL, "hard_over", "phase_loss", fault__hard_over__share=share, drive__ki=0.0,
                             solver__max_tick=1e-4, **SMOOTH), 0.15, model=MODEL)
    wanted = 8.19 * 10.0 * share - 0.015

    def rates(t: float, y: Any) -> list[float]:
        angle, speed, current = y.tolist()
        tangent = LEAD / ARM * angle + TILT
        ratio, s = ARM / LEAD * (1.0 + tangent * tangent), sin(4.0 * (angle - radians(10.0)))
        reference = s * (wanted if t >= 3.7e-3 else -0.015)
        voltage = min(max(5.0 * (reference - current), -39.0), 39.0)
        torque = s * K * current - 5e-4 * speed + 2.0 * tangent * FIN / ratio**3 * speed * speed
        return [speed, torque / (ROTOR + FIN / ratio**2), (voltage - R * current - s * K * speed) / L]

    exact = solve_ivp(rates, (0.0, 0.15), [0.0] * 3, t_eval=run["time"], rtol=1e-9, atol=1e-10, max_step=1e-4).y
    fin = np.arctan(LEAD / ARM * exact[0] + TILT) - radians(5.0)
    inside = np.abs(fin) < radians(24.9)
    assert np.degrees(np.abs(run["fin_angle"] - fin)[inside]).max() < 8e-3
    assert np.degrees(np.abs(fin[inside])).max() > 2.0


@pytest.mark.parametrize("fault", ["winding_short", "phase_loss"])
def test_a_winding_fault_has_no_effect_before_it_and_the_actuator_recovers_after_it(fault: str) -> None:
    plain, run = (simulate(scheduled(MODEL, *names, begin=0.1, end=0.2), 1.0, model=MODEL, fin_command=radians(8.0))
                  for names in ((), (fault,)))
    del plain["fault_word"]
    assert_equal(run, plain, rows=slice(0, 100))
    assert run["fin_angle"][-1] == pytest.approx(radians(8.0), abs=radians(0.05))


@pytest.mark.parametrize(("changes", "named"), [
    ({}, ""), ({"fault.winding_short.active": True}, "fault.winding_short.pole_pairs = 4 and motor.pole_pairs = 8"),
    ({"fault.phase_loss.end": 1.0, "motor.pole_pairs": 4, "inverter.pole_pairs": 3},
     "fault.phase_loss.pole_pairs = 4 and inverter.pole_pairs = 3"),
    ({"fault.phase_loss.active": True, "fault.winding_short.active": True, "fault.phase_loss.pole_pairs": 8.0},
     "fault.winding_short.pole_pairs = 4 and fault.phase_loss.pole_pairs = 8"),
    ({"fault.winding_short.active": True, "fault.winding_short.pole_pairs": 0.0}, "")])
def test_an_active_or_scheduled_fault_with_other_pole_pairs_than_the_motor_is_warned_of(
        changes: dict[str, Any], named: str) -> None:
    parameters = load_parameters(model="nonlinear+inverter+faults").with_values({"motor.pole_pairs": 8, **changes})
    text = [w for w in parameters.warnings if "fault." in w and "pole_pairs" in w]
    assert any(named in w for w in text) if named else not text


def test_a_lost_phase_has_the_dead_time_of_two_phases_in_series() -> None:
    """K_p (s i_ref - i) = R i + 2 V t_d f, to rounding; s is the sine of the electrical angle."""
    model = "nonlinear+inverter+faults"
    values = values_of(BLOCKED, {"drive.current_offset": 20.0, "inverter.dead_time": 2e-6,
                                 "fault.phase_loss.active": True, "fault.phase_loss.angle": -0.3}, model=model)
    run = simulate(values, 0.02, model=model)
    current = (5.0 * 20.0 * sin(4.0 * 0.3) - 2.0 * 39.0 * 2e-6 * 20e3) / (5.0 + R)
    assert run["motor_current"][-1] == pytest.approx(current, rel=1e-9)
    assert run["motor_voltage"][-1] == pytest.approx(R * current, rel=1e-9)
