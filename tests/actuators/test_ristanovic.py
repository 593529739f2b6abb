"""The ristanovic actuator, which has no current loop: against matrix exponentials and closed forms."""

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
    """Return the fin angle [rad] at the samples: motor, winding and torsion bar by matrix exponentials."""
    lead = values["screw.lead"]
    ratio = values["kinematics.moment_arm"] / lead
    fin = values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]
    inertia = values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2 + fin / ratio**2
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    a = np.zeros((5, 5))  # angle, speed, current, and the constant voltage and torque of a sample
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
def test_without_friction_the_response_is_that_of_the_linear_loops(command: float, torque: float, bar: float) -> None:
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):
        values = load_parameters(model=MODEL).with_values({
            **SMOOTH, "load.torsion_bar": bar, "solver.max_tick": tick}).values
        found = simulate(values, 0.2, model=MODEL, fin_command=command, aero_torque=torque)["fin_angle"]
        errors.append(np.abs(found - exact(values, command, torque, 201)).max())
    # A hundredth of a count (7e-4 deg) with the finest ticks. The order is about 2: some ticks end at events.
    assert np.degrees(errors[-1]) < 1e-5
    assert errors[0] > 2.5 * errors[1] > 2.5**2 * errors[2]


def test_motor_balances_the_torsion_bar_at_rest() -> None:
    """The voltage is then that of the winding's resistance."""
    values = load_parameters(model=MODEL).with_values({**SMOOTH, "load.torsion_bar": 300.0}).values
    run = {name: column[-1] for name, column in simulate(values, 3.0, model=MODEL, fin_command=0.1).items()}
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    # The slowest mode has decayed to exp(-3 s ki/kp) = 0.7 % of the load's error, itself 1 % of the angle.
    assert run["fin_angle"] == pytest.approx(0.1, rel=1e-3)
    assert run["hinge_torque"] == pytest.approx(-300.0 * run["fin_angle"], rel=1e-12)
    assert run["motor_torque"] * ratio == pytest.approx(300.0 * run["fin_angle"], rel=1e-3)
    assert run["motor_voltage"] == pytest.approx(values["motor.resistance"] * run["motor_current"], rel=1e-2)


def test_supply_limits_the_voltage() -> None:
    values = load_parameters(model=MODEL).values
    run = simulate(values, 0.2, 1e-4, model=MODEL, fin_command=0.3, supply_voltage=20.0)
    assert np.abs(run["motor_voltage"]).max() == pytest.approx(20.0, rel=1e-9)
    assert run["saturated"].any()
    # Without a current loop the current rises until the winding's resistance limits it.
    assert run["motor_current"].max() > 0.5 * 20.0 / values["motor.resistance"]


def test_shipped_actuator_has_no_back_emf() -> None:
    """At the constant voltage between samples the current is an exponential; a back-EMF would change it by K_e w/R."""
    values = load_parameters(model=MODEL).with_values({"solver.max_tick": 5e-5}).values
    run = simulate(values, 0.15, model=MODEL, fin_command=0.3)
    current, voltage = run["motor_current"], run["motor_voltage"]
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    decay = np.exp(-values["controller.sample_time"] * resistance / inductance)
    assert 0.11 * run["motor_speed"].max() / resistance > 100.0  # A, the change by a K_e of 0.11 V.s/rad
    # A row shows the voltage before the sample at its time. Ticks are exact at a constant voltage.
    np.testing.assert_allclose(current[2:], voltage[2:] / resistance * (1.0 - decay) + current[1:-1] * decay,
                               rtol=1e-9, atol=1e-9)


def test_back_emf_reduces_the_current() -> None:
    """At the full supply voltage L di/dt = V - K_e w - R i."""
    values = load_parameters(model=MODEL).with_values({"motor.back_emf_constant": 0.11, "solver.max_tick": 5e-5}).values
    run = simulate(values, 0.05, 1e-4, model=MODEL, fin_command=0.4)
    at_limit = (run["motor_voltage"] == 39.0) & (run["time"] > 0.0)
    rise = np.gradient(run["motor_current"], 1e-4)[at_limit]
    expected = (39.0 - 0.11 * run["motor_speed"] - values["motor.resistance"] * run["motor_current"])[at_limit]
    # Central differences at 0.1 ms of a current with the time constant L/R = 2.4 ms.
    np.testing.assert_allclose(rise[2:-2] * values["motor.inductance"], expected[2:-2], atol=0.05)
    assert expected.min() < 0.0  # the current has passed its peak
