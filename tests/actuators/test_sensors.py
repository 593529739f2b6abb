"""With `encoder.on_fin` the position comes from an encoder on the fin, the speed from that on the motor."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, radians, sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.plant import simulate as reference_of
from emcas_fmu.simulation import simulate
from tests.marks import slow

ON_FIN = {"encoder.on_fin": True}
TIMES = np.arange(301) * 1e-3
_COUNT = 2.0 * pi / 8192


def _values(model: str = "nonlinear", **changes: object) -> Mapping[str, Any]:
    overrides = {name.replace("__", "."): value for name, value in changes.items()}
    return load_parameters(model=model).with_values({**ON_FIN, **overrides}).values


def test_a_slow_sine_and_rest_need_little_current() -> None:
    """With the speed from counts of the fin, each 64 counts of the motor, they would need 6.8 A rms and 16 A peaks."""
    sine = simulate(_values(), 4.0, fin_command=lambda t: radians(5.0) * sin(2.0 * pi * t))["motor_current"][2000:]
    assert np.sqrt(np.mean(sine**2)) < 2.2  # measured 1.96, 1.94 with the motor's encoder alone
    rest = simulate(_values(), 4.0, fin_command=radians(3.3))["motor_current"][2000:]
    assert np.abs(rest).max() < 2.5  # measured 1.93


def test_a_soft_drive_line_comes_to_rest() -> None:
    """With the speed from the fin's counts, 1 mm/kN would cause a limit cycle of 3.6 deg with the full current."""
    soft = _values("elastic", drive_line__backlash=0.0, drive_line__axial_compliance=1e-6)
    run = simulate(soft, 5.0, model="elastic", fin_command=radians(3.3))
    assert np.degrees(np.ptp(run["fin_angle"][4000:])) < 0.044  # a count of the fin; 0.0050 measured
    assert np.abs(run["motor_current"][4000:]).max() < 2.5  # measured 1.94


@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_speed_is_of_the_motor_and_position_of_the_fin(model: str) -> None:
    """Without position gain the reference is -K_v times the speed from the motor's counts."""
    values = _values(model, controller__position__kp=0.0, controller__position__ki=0.0, compensation__gain=0.0)
    run = simulate(values, 0.1, model=model, aero_torque=lambda t: 60.0 * sin(60.0 * t))
    counts = run["motor_angle"] / _COUNT
    speed = np.diff(np.floor(counts)) * _COUNT / values["controller.sample_time"]
    reference = np.clip(-values["controller.velocity.kp"] * speed, -10.0, 10.0)
    # A row shows the sample at the beginning of the step to it. At the edge of a count, rounding decides.
    at_edge = np.abs(counts - np.round(counts)) < 1e-6
    decided = ~(at_edge[:-2] | at_edge[1:-1])
    assert run["drive_reference"][2:][decided] == pytest.approx(reference[:-1][decided], abs=1e-9)
    assert np.abs(reference).max() > 0.1
    errors = np.abs(run["measured_fin_angle"][1:] - np.floor(run["fin_angle"][:-1] / _COUNT) * _COUNT)
    assert errors.max() <= _COUNT
    assert np.median(errors) < 1e-12


@pytest.mark.parametrize("enabled", [True, *slow(False)])
def test_against_the_independent_integration(enabled: bool) -> None:
    """The lever deviates from the one that the controllers know; with both encoders and without, in both kernels."""
    command = 0.2 * np.sin(2.0 * pi * 3.0 * TIMES)
    values = _values(encoder__enabled=enabled, encoder__pulses=1_000_000, fin__start_angle=0.05,
                     deviation__kinematics__moment_arm=0.02)
    exact = reference_of(values, {"time": TIMES, "fin_command": command, "aero_torque": np.full(len(TIMES), -40.0)})
    for kernel in ("compiled", "python"):
        found = simulate(values, TIMES[-1], kernel=kernel, fin_command=command, aero_torque=-40.0)
        # 0.00016 deg measured; rounding may decide a count of 9e-5 deg.
        assert np.degrees(np.abs(found["fin_angle"] - exact["fin_angle"])).max() < 0.002


def test_with_ideal_encoders_their_location_does_not_matter() -> None:
    """On a rigid drive line the responses agree to the bit."""
    runs = [simulate(_values(encoder__enabled=False, encoder__on_fin=on), 0.3, fin_command=0.2) for on in (True, False)]
    assert np.array_equal(runs[0]["fin_angle"], runs[1]["fin_angle"])


@pytest.mark.parametrize("fault", ["encoder_freeze", "encoder_reversed", "encoder_bias", "encoder_dropped"])
@pytest.mark.parametrize("model", ["nonlinear+faults", "elastic+faults"])
def test_faults_of_the_encoder_on_the_fin_do_not_change_the_speed(model: str, fault: str) -> None:
    """Without a position loop they change only the measured angle."""
    loops = {"controller__position__kp": 0.0, "controller__position__ki": 0.0, "compensation__gain": 0.0}
    amounts = {"fault__encoder_bias__angle": 0.02, "fault__encoder_dropped__share": 0.5}
    runs = [simulate(_values(model, **loops, **amounts, **{f"fault__{fault}__active": on}), 0.1, model=model,
                     aero_torque=lambda t: 60.0 * sin(60.0 * t)) for on in (False, True)]
    assert np.array_equal(runs[0]["motor_angle"], runs[1]["motor_angle"])
    assert np.abs(runs[0]["measured_fin_angle"] - runs[1]["measured_fin_angle"]).max() > 2.0 * _COUNT


def test_loops_are_those_with_the_encoder_on_the_motor() -> None:
    """On a rigid drive line the linear loops do not depend on the encoder's location."""
    on, off = (LinearActuator(_values(encoder__on_fin=x), radians(8.0)) for x in (True, False))
    at = np.exp(2j * pi * 8.0 * 1e-3)
    for name in ("velocity", "position", "reference"):
        assert on.loop(name)(at) == pytest.approx(off.loop(name)(at), rel=1e-9)
    assert on.command_to_angle(at) == pytest.approx(off.command_to_angle(at), rel=1e-9)
