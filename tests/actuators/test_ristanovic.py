"""The model without a current loop: against matrix exponentials, and by its statics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "ristanovic"
SMOOTH = {"encoder.enabled": False, "friction.viscous.positive": 5e-4, "friction.viscous.negative": 5e-4,
          **{f"friction.coulomb.{d}[{n}]": 0.0 for d in ("positive", "negative") for n in range(7)}}


def exact(values: Mapping[str, Any], command: float, torque: float, rows: int) -> Any:
    """Fin angle at the samples of the linear loop: motor, winding and bar by matrix exponentials."""
    lead = values["screw.lead"]
    ratio = values["kinematics.moment_arm"] / lead
    fin = values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]
    inertia = values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2 + fin / ratio**2
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    a = np.zeros((5, 5))  # angle, speed, current, voltage held, torque held
    a[0, 1] = 1.0
    a[1] = [-values["load.torsion_bar"] / ratio**2, -values["friction.viscous.positive"],
            values["motor.torque_constant"], 0.0, 1.0 / ratio]
    a[1] /= inertia
    a[2] = [0.0, -values["motor.back_emf_constant"] / inductance, -resistance / inductance, 1.0 / inductance, 0.0]
    period = values["controller.sample_time"]
    phi = expm(a * period)
    x, integral, angles = np.zeros(5), 0.0, []
    x[4] = torque
    for _ in range(rows):
        angles.append(x[0] / ratio)
        error = ratio * command - x[0]
        demand = values["controller.position.kp"] * error + integral
        x[3] = values["pwm.gain"] * values["controller.velocity.kp"] * (demand - x[1])
        integral += period * values["controller.position.ki"] * error
        x = phi @ x
    return np.array(angles)


@pytest.mark.parametrize(("command", "torque", "bar"), [(0.02, 0.0, 0.0), (0.0, -20.0, 0.0), (0.02, 10.0, 300.0)])
def test_smooth_motion_is_the_linear_loops(command: float, torque: float, bar: float) -> None:
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):
        values = load_parameters(model=MODEL).with_values({
            **SMOOTH, "load.torsion_bar": bar, "solver.max_tick": tick}).values
        found = simulate(values, 0.2, model=MODEL, fin_command=command, aero_torque=torque)["fin_angle"]
        errors.append(np.abs(found - exact(values, command, torque, 201)).max())
    # A hundredth of a count (7e-4 deg) at the finest, and of second order, as far as cut ticks let it.
    assert np.degrees(errors[-1]) < 1e-5
    assert errors[0] > 2.5 * errors[1] > 2.5**2 * errors[2]


def test_bar_is_held_by_the_voltage() -> None:
    """At rest the winding's drop is all the voltage, and its torque the bar's."""
    values = load_parameters(model=MODEL).with_values({**SMOOTH, "load.torsion_bar": 300.0}).values
    run = {name: column[-1] for name, column in simulate(values, 3.0, model=MODEL, fin_command=0.1).items()}
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    # The slowest mode has decayed by exp(-3 s x ki/kp) = 0.7 % of the load's error, itself a hundredth of the angle.
    assert run["fin_angle"] == pytest.approx(0.1, rel=1e-3)
    assert run["hinge_torque"] == pytest.approx(-300.0 * run["fin_angle"], rel=1e-12)
    assert run["motor_torque"] * ratio == pytest.approx(300.0 * run["fin_angle"], rel=1e-3)
    assert run["motor_voltage"] == pytest.approx(values["motor.resistance"] * run["motor_current"], rel=1e-2)


def test_supply_limits_the_voltage() -> None:
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.2, 1e-4, model=MODEL, fin_command=0.3, supply_voltage=20.0)
    assert np.abs(run["motor_voltage"]).max() == pytest.approx(20.0, rel=1e-9)
    assert run["saturated"].any()
    # No current loop holds the winding's current: it comes up to what the supply drives through it.
    assert run["motor_current"].max() > 0.5 * 20.0 / values["motor.resistance"]


def test_no_back_emf_opposes_the_current() -> None:
    """However fast the motor turns, the winding's voltage is that of its resistance and inductance alone.

    Between samples the voltage is held, so that the current is an exponential; with a K_e it would be off by K_e w/R.
    """
    values = load_parameters(model=MODEL).with_values({"solver.max_tick": 5e-5}).values
    run = simulate(values, 0.15, model=MODEL, fin_command=0.3)
    current, voltage = run["motor_current"], run["motor_voltage"]
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    left = np.exp(-values["controller.sample_time"] * resistance / inductance)
    assert 0.11 * run["motor_speed"].max() / resistance > 100.0  # A
    # A row shows the voltage before the sample that falls on it. The tick is exact at a held voltage, which leaves the
    # instant at which the supply no longer limits it.
    np.testing.assert_allclose(current[2:], voltage[2:] / resistance * (1.0 - left) + current[1:-1] * left, rtol=1e-9,
                               atol=1e-9)


def test_a_back_emf_that_is_given_acts() -> None:
    """Under the whole supply the current falls with speed: (V - K_e w)/R at any time beyond the first milliseconds."""
    values = load_parameters(model=MODEL).with_values({"motor.back_emf_constant": 0.11, "solver.max_tick": 5e-5}).values
    run = simulate(values, 0.05, 1e-4, model=MODEL, fin_command=0.4)
    whole = (run["motor_voltage"] == 39.0) & (run["time"] > 0.0)
    rise = np.gradient(run["motor_current"], 1e-4)[whole]
    expected = (39.0 - 0.11 * run["motor_speed"] - values["motor.resistance"] * run["motor_current"])[whole]
    # Central differences at 0.1 ms, of a current that turns in L/R = 2.4 ms.
    np.testing.assert_allclose(rise[2:-2] * values["motor.inductance"], expected[2:-2], atol=0.05)
    assert expected.min() < 0.0  # it has gone over its peak
