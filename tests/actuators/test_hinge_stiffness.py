"""Stiffness about the hinge, the rotor held by its friction: deflection, natural frequency, energy, damping."""

from __future__ import annotations

from math import exp, pi, radians, sqrt
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

from .line import BASE, HINGE, MODEL, RIGID, SMOOTH, run_of, values_of

STIFFNESS = 1e4  # N.m/rad, of HINGE
HELD = {**SMOOTH, **RIGID, **HINGE, "friction.coulomb.positive[0]": 9.0, "friction.coulomb.negative[0]": 9.0}
INERTIA = sum(BASE.values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
ANGLES = [0.0, 15.0, -15.0]  # deg


def swing(angle: float, stop: float, moment: float, **more: Any) -> tuple[Any, Any, Any]:
    """Time [s], deflection [rad] and rate [rad/s] of a fin that a moment [N.m] for 7 ms has set swinging."""
    start = radians(angle)
    run = run_of({**HELD, "fin.start_angle": start, **more}, stop, 1e-4, enable=False,
                 aero_torque=lambda t: moment if t < 7e-3 else 0.0)
    assert np.ptp(run["motor_angle"]) == 0.0
    return run["time"], run["fin_angle"] - start, run["fin_rate"]


@pytest.mark.parametrize("angle", ANGLES)
def test_torque_over_angle(angle: float) -> None:
    """What is left is the lever, whose ratio is that of the fin: tan(20 deg) of the 5e-3 rad at the most."""
    run = run_of({**HELD, "fin.start_angle": radians(angle), "drive_line.hinge_damping": 30.0}, 0.4, enable=False,
                 aero_torque=50.0)
    assert 50.0 / (run["fin_angle"][-1] - radians(angle)) == pytest.approx(STIFFNESS, rel=3e-3)


@pytest.mark.parametrize("angle", ANGLES)
def test_natural_frequency(angle: float) -> None:
    time, deflection, _ = swing(angle, 0.5, 20.0)
    up = np.flatnonzero((deflection[:-1] < 0.0) & (deflection[1:] >= 0.0) & (time[:-1] > 0.01))
    at = time[up] - deflection[up] * 1e-4 / (deflection[up + 1] - deflection[up])
    found = (len(at) - 1) / (at[-1] - at[0])
    # The midpoint rule lengthens a period by (w h)^2/12 = 4e-5; the ratio varies on the way, 4e-5.
    assert found == pytest.approx(sqrt(STIFFNESS / INERTIA) / (2.0 * pi), rel=5e-4)


@pytest.mark.parametrize("angle", ANGLES)
def test_an_undamped_swing_keeps_its_energy(angle: float) -> None:
    """Over five seconds, 320 swings of 0.7 deg. Within a swing the stiffness at the motor follows the fin."""
    _, deflection, rate = swing(angle, 5.0, 60.0)
    energy = 0.5 * INERTIA * rate**2 + 0.5 * STIFFNESS * deflection**2
    first, last = energy[200:2200], energy[-2000:]
    assert last.mean() == pytest.approx(first.mean(), rel=5e-6)  # 6e-7 at most is found
    assert np.ptp(first) < 0.01 * first.mean()  # 0.6 %


def test_damping_about_the_hinge() -> None:
    """exp(-c t/(2 J)) of the amplitude."""
    damping = 1.0
    time, deflection, _ = swing(10.0, 0.3, 20.0, **{"drive_line.hinge_damping": damping})
    peaks = [np.abs(deflection[(time >= begin) & (time < begin + 0.03)]).max() for begin in (0.02, 0.22)]
    # A peak is met within 2 % of a period at most, 1 % of it.
    assert peaks[1] / peaks[0] == pytest.approx(exp(-damping / (2.0 * INERTIA) * 0.2), rel=0.02)


def test_in_series_with_the_screw() -> None:
    """Deflections add: k_x d^2/cos^4 of the screw beside what is about the hinge."""
    compliance = 1.2e-8
    angle = radians(15.0)
    run = run_of({**HELD, "drive_line.axial_compliance": compliance, "fin.start_angle": angle,
                  "drive_line.hinge_damping": 30.0}, 0.4, enable=False, aero_torque=50.0)
    lever = BASE.values["kinematics.moment_arm"] / np.cos(angle + BASE.values["kinematics.initial_angle"])**2
    expected = 50.0 * (1.0 / STIFFNESS + compliance / lever**2)
    assert run["fin_angle"][-1] - angle == pytest.approx(expected, rel=5e-3)


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("model", ["elastic", "elastic+efficiency"])
def test_kernels_agree(model: str) -> None:
    hinge = {**HINGE, "drive_line.hinge_damping": 5.0}
    values = load_parameters(model=model).with_values(hinge).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.3 if t < 0.1 else -0.2, "aero_torque": -60.0}
    runs = [simulate(values, 0.2, 3.7e-4, kernel, model, **inputs) for kernel in ("python", "compiled")]
    for name, expected in runs[0].items():
        assert np.array_equal(runs[1][name], expected), name


@pytest.mark.parametrize("model", ["habibi", "ozkan"])
def test_models_without_it_have_no_such_parameter(model: str) -> None:
    assert not {*HINGE, "drive_line.hinge_damping"} & {v.name for v in get(model).parameters}


def test_a_fin_shaft_alone_is_a_drive_line() -> None:
    """With a rigid screw and no gap the fin gives all the same."""
    values = values_of({**RIGID, "drive_line.shaft_stiffness": 1e4})
    run = simulate(values, 0.3, model=MODEL, fin_command=0.0, aero_torque=50.0, enable=False)
    assert run["fin_angle"][1] > 0.0
    assert run["motor_angle"][1] == 0.0
