"""Stiffness about the hinge while friction holds the rotor: deflection, natural frequency, energy, damping."""

from __future__ import annotations

from math import exp, pi, radians, sqrt
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.runs import run_both_kernels

from .checks import oscillation_frequency
from .line import BASE, HINGE, MODEL, RIGID, SMOOTH, run_of, values_of

STIFFNESS = 1e4  # N.m/rad, of HINGE
ROTOR_HELD = {**SMOOTH, **RIGID, **HINGE, "friction.coulomb.positive[0]": 9.0, "friction.coulomb.negative[0]": 9.0}
INERTIA = sum(BASE.values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
ANGLES = [0.0, 15.0, -15.0]  # deg


def swing(angle: float, stop: float, moment: float, **changes: Any) -> tuple[Any, Any, Any]:
    """Return time [s], deflection [rad] and rate [rad/s] of a fin on which a moment [N.m] acts for the first 7 ms."""
    start = radians(angle)
    run = run_of({**ROTOR_HELD, "fin.start_angle": start, **changes}, stop, 1e-4, enable=False,
                 aero_torque=lambda t: moment if t < 7e-3 else 0.0)
    assert np.ptp(run["motor_angle"]) == 0.0
    return run["time"], run["fin_angle"] - start, run["fin_rate"]


@pytest.mark.parametrize("angle", ANGLES)
def test_stiffness_is_torque_over_deflection(angle: float) -> None:
    """The lever's ratio changes over the deflection of 5e-3 rad, by up to tan(20 deg) of it: 0.2 %."""
    run = run_of({**ROTOR_HELD, "fin.start_angle": radians(angle), "drive_line.hinge_damping": 30.0}, 0.4, enable=False,
                 aero_torque=50.0)
    assert 50.0 / (run["fin_angle"][-1] - radians(angle)) == pytest.approx(STIFFNESS, rel=3e-3)


@pytest.mark.parametrize("angle", ANGLES)
def test_natural_frequency(angle: float) -> None:
    time, deflection, _ = swing(angle, 0.5, 20.0)
    found = oscillation_frequency(deflection[time > 0.01], 1e-4)
    # The midpoint rule lengthens a period by (w h)^2/12 = 4e-5; the varying ratio changes it by 4e-5.
    assert found == pytest.approx(sqrt(STIFFNESS / INERTIA) / (2.0 * pi), rel=5e-4)


@pytest.mark.parametrize("angle", ANGLES)
def test_undamped_oscillation_keeps_its_energy(angle: float) -> None:
    """5 s are 320 oscillations of 0.7 deg. Within one, the energy varies with the lever's ratio."""
    _, deflection, rate = swing(angle, 5.0, 60.0)
    energy = 0.5 * INERTIA * rate**2 + 0.5 * STIFFNESS * deflection**2
    first, last = energy[200:2200], energy[-2000:]
    assert last.mean() == pytest.approx(first.mean(), rel=5e-6)  # at most 6e-7 measured
    assert np.ptp(first) < 0.01 * first.mean()  # 0.6 % measured


def test_damping_about_the_hinge() -> None:
    """The amplitude decays as exp(-c t/(2 J))."""
    damping = 1.0
    time, deflection, _ = swing(10.0, 0.3, 20.0, **{"drive_line.hinge_damping": damping})
    peaks = [np.abs(deflection[(time >= begin) & (time < begin + 0.03)]).max() for begin in (0.02, 0.22)]
    # 0.2 s are 26 half periods, so the peaks are 0.2 s apart within two rows: 0.1 % measured.
    assert peaks[1] / peaks[0] == pytest.approx(exp(-damping / (2.0 * INERTIA) * 0.2), rel=0.005)


def test_hinge_and_screw_deflections_add() -> None:
    """At the hinge the screw has the compliance c cos^4/d^2."""
    compliance = 1.2e-8
    angle = radians(15.0)
    run = run_of({**ROTOR_HELD, "drive_line.axial_compliance": compliance, "fin.start_angle": angle,
                  "drive_line.hinge_damping": 30.0}, 0.4, enable=False, aero_torque=50.0)
    lever = BASE.values["kinematics.moment_arm"] / np.cos(angle + BASE.values["kinematics.initial_angle"])**2
    expected = 50.0 * (1.0 / STIFFNESS + compliance / lever**2)
    assert run["fin_angle"][-1] - angle == pytest.approx(expected, rel=5e-3)


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("model", ["elastic", "elastic+efficiency"])
def test_kernels_agree(model: str) -> None:
    values = load_parameters(model=model).with_values({**HINGE, "drive_line.hinge_damping": 5.0}).values
    run_both_kernels(values, 0.2, model, 3.7e-4, fin_command=lambda t: 0.3 if t < 0.1 else -0.2, aero_torque=-60.0)


@pytest.mark.parametrize("model", ["habibi", "ozkan"])
def test_habibi_and_ozkan_have_no_hinge_stiffness(model: str) -> None:
    assert not {*HINGE, "drive_line.hinge_damping"} & {v.name for v in get(model).parameters}


def test_fin_deflects_on_its_shaft_with_a_rigid_screw_without_gap() -> None:
    values = values_of({**RIGID, "drive_line.shaft_stiffness": 1e4})
    run = simulate(values, 0.3, model=MODEL, fin_command=0.0, aero_torque=50.0, enable=False)
    assert run["fin_angle"][1] > 0.0
    assert run["motor_angle"][1] == 0.0
