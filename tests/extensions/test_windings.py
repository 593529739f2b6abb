"""Shorted terminals and a lost phase: closed forms, own integration of phases and rotor, no energy from nowhere."""

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

from .fault_runs import MODEL, equal, scheduled, wave
from .held import HELD

R, L, K = 0.25, 0.6e-3, 0.11  # Ohm, H, N.m/A of the default motor
LEAD, ARM, TILT = 5e-3 / (2.0 * pi), 0.05, tan(radians(5.0))
ROTOR, FIN = 2.81e-4 + 4.5e-6 + 0.5 * LEAD**2, 0.06  # kg.m2
SMOOTH = {f"friction__coulomb__{way}[{power}]": 0.0 for way in ("positive", "negative") for power in range(7)} | {
    f"friction__viscous__{way}": 5e-4 for way in ("positive", "negative")}
HAVE = [name for name in NAMES if PHASES in get(name).provides]


def _braking(pairs: float, speed: Any) -> Any:
    return K * K * speed * R / (R * R + (pairs * speed * L) ** 2)



@pytest.mark.parametrize("pairs", [0, 4, 8])
@pytest.mark.parametrize("torque", [10.0, -30.0])
def test_braking_torque_of_shorted_terminals(pairs: int, torque: float) -> None:
    """A constant load turns the linear model at the speed at which K^2 w R/(R^2 + (n w L)^2) balances it; after 0.3 s,
    twenty times the time that this takes, to 1e-6 of the load."""
    run = simulate(scheduled("linear+faults", "winding_short", fault__winding_short__pole_pairs=pairs), 0.3,
                   model="linear+faults", aero_torque=torque)
    speed, ratio, viscous = run["motor_speed"][-1], ARM / LEAD, 0.5 * (5e-4 + 4.6e-4)
    assert run["motor_torque"][-1] == pytest.approx(-_braking(pairs, speed), rel=1e-9)
    assert torque / ratio == pytest.approx(_braking(pairs, speed) + viscous * speed, rel=1e-6)


@pytest.mark.parametrize(("pairs", "load"), [(0, 100.0), (4, 100.0), (4, 150.0)])
def test_shorted_terminals_in_the_rotors_axes(pairs: int, load: float) -> None:
    """Against both currents, q and d: from rest, where the current d of a constant speed is ahead of the true one. It
    is off by 0.012 deg at most under 100 N.m (measured 0.0052), by 0.06 under 150 (0.035), near the largest torque;
    without pole pairs there is no current d, and ticks alone are left (0.0010)."""
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
    off = np.degrees(np.abs(run["fin_angle"] - fin)[before_the_stop]).max()
    assert off < {(0, 100.0): 2e-3, (4, 100.0): 0.012, (4, 150.0): 0.06}[pairs, load]
    assert np.degrees(fin[before_the_stop]).max() > 2.0


@pytest.mark.parametrize(("pairs", "order"), [(0, 2), (4, 1)])
def test_order_of_shorted_terminals_in_the_tick(pairs: int, order: int) -> None:
    """Against ticks of 10 us, 4 % of the finer ones: with pole pairs R' is that of the speed at the start of a tick. A
    quarter of the tick divides the error by 4^order (measured 16.0 and 4.2), within half a power of two an order."""
    angles = {tick: simulate(scheduled(MODEL, "winding_short", fault__winding_short__pole_pairs=pairs,
                                       drive__transport_delay=4e-3, solver__max_tick=tick, **SMOOTH), 0.05, model=MODEL,
                             aero_torque=100.0)["motor_angle"] for tick in (1e-3, 2.5e-4, 1e-5)}
    coarse, fine = (np.abs(angles[tick] - angles[1e-5]).max() for tick in (1e-3, 2.5e-4))
    assert 1.5 * order < np.log2(coarse / fine) < 2.5 * order
    assert np.degrees(coarse) * LEAD / ARM < 2e-3  # of the fin: measured 0.0002 and 0.0012 deg


def test_shorted_terminals_brake_also_without_the_drive() -> None:
    """Disabled or not, but for the 1e-11 A of the current loop that is left; an open bridge does not brake."""
    shorted = scheduled(MODEL, "winding_short")
    off, on, free = (simulate(values, 0.3, model=MODEL, aero_torque=60.0, enable=enable)
                     for values, enable in ((shorted, False), (shorted, True), (scheduled(MODEL), False)))
    np.testing.assert_allclose(off["motor_angle"], on["motor_angle"], atol=1e-9)
    assert 0.0 < off["fin_angle"][-1] < 0.3 * free["fin_angle"][-1]


@pytest.mark.parametrize("model", others_slow(HAVE, lambda model: model != "worm-gear-elastic"))
def test_shorted_terminals_take_nothing_from_the_supply(model: str) -> None:
    """From a slew: the kinetic energy becomes heat. The current loop that is left gives 1e-10 V."""
    run = simulate(scheduled(f"{model}+faults", "winding_short", begin=0.08), 0.3, model=f"{model}+faults",
                   fin_command=wave, aero_torque=20.0)
    assert np.abs(run["supply_power"][82:]).max() < 1e-6
    assert (run["motor_torque"] * run["motor_speed"])[90:].max() <= 0.0


@pytest.mark.parametrize("degree", [0.0, 7.0, 22.5, 40.0])
def test_stall_torque_without_a_phase(degree: float) -> None:
    """Of a rotor that is blocked, sin^2 n (theta - theta_0) of that of the whole motor, to rounding."""
    values: dict[str, Any] = {"controller__position__ki": 0.0, "drive__ki": 0.0}
    whole, part = (simulate(scheduled(MODEL, "jam", *lost, fault__phase_loss__angle=radians(-degree), **values), 0.1,
                            model=MODEL, fin_command=radians(5.0)) for lost in ((), ("phase_loss",)))
    expected = max(sin(4.0 * radians(degree)) ** 2, 1e-12)
    assert whole["motor_torque"][-1] > 1.0
    assert part["motor_torque"][-1] == pytest.approx(expected * whole["motor_torque"][-1], rel=1e-9)


def test_without_a_phase_it_does_not_start_where_it_has_no_torque() -> None:
    values = {angle: scheduled(MODEL, "phase_loss", fault__phase_loss__angle=radians(angle)) for angle in (0.0, 22.5)}
    held, moved = (simulate(each, 0.3, model=MODEL, fin_command=radians(1.0)) for each in values.values())
    assert not held["motor_angle"].any()
    assert moved["fin_angle"][-1] > radians(0.5)


@pytest.mark.parametrize("share", [0.1, -0.2])
def test_a_constant_reference_without_a_phase(share: float) -> None:
    """Against own integration of the two phases in series. Ticks of 0.1 ms are within 0.008 deg (measured 0.0003 and
    0.0042; half the tick leaves a quarter), of some 20 sines of the torque."""
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
def test_before_and_after_a_failed_winding(fault: str) -> None:
    """Until it begins, the bits of the plain actuator; afterwards the actuator returns to its command."""
    plain, run = (simulate(scheduled(MODEL, *names, begin=0.1, end=0.2), 1.0, model=MODEL, fin_command=radians(8.0))
                  for names in ((), (fault,)))
    assert equal(run, {name: column for name, column in plain.items() if name != "fault_word"}, slice(0, 100))
    assert run["fin_angle"][-1] == pytest.approx(radians(8.0), abs=radians(0.05))


@pytest.mark.parametrize(("changes", "named"), [
    ({}, ""), ({"fault.winding_short.active": True}, "fault.winding_short.pole_pairs = 4 and motor.pole_pairs = 8"),
    ({"fault.phase_loss.end": 1.0, "motor.pole_pairs": 4, "inverter.pole_pairs": 3},
     "fault.phase_loss.pole_pairs = 4 and inverter.pole_pairs = 3"),
    ({"fault.phase_loss.active": True, "fault.winding_short.active": True, "fault.phase_loss.pole_pairs": 8.0},
     "fault.winding_short.pole_pairs = 4 and fault.phase_loss.pole_pairs = 8"),
    ({"fault.winding_short.active": True, "fault.winding_short.pole_pairs": 0.0}, "")])
def test_faults_have_the_pole_pairs_of_the_motor(changes: dict[str, Any], named: str) -> None:
    """A fault that is switched on or scheduled."""
    parameters = load_parameters(model="nonlinear+inverter+faults").with_values({"motor.pole_pairs": 8, **changes})
    text = [w for w in parameters.warnings if "fault." in w and "pole_pairs" in w]
    assert any(named in w for w in text) if named else not text


def test_a_lost_phase_has_the_dead_time_of_two_in_series() -> None:
    """K_p (share i_ref - i) = R i + 2 V t_d f, with the share of the sine of its position, to rounding."""
    model = "nonlinear+inverter+faults"
    values = load_parameters(model=model).with_values({
        **HELD, "drive.kp": 5.0, "drive.supply_voltage": 39.0, "motor.inductance": L, "drive.current_offset": 20.0,
        "inverter.dead_time": 2e-6, "fault.phase_loss.active": True, "fault.phase_loss.angle": -0.3}).values
    run = simulate(values, 0.02, model=model)
    current = (5.0 * 20.0 * sin(4.0 * 0.3) - 2.0 * 39.0 * 2e-6 * 20e3) / (5.0 + R)
    assert run["motor_current"][-1] == pytest.approx(current, rel=1e-9)
    assert run["motor_voltage"][-1] == pytest.approx(R * current, rel=1e-9)
