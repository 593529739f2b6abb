"""Properties of the default actuator under any command, load and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import check_combinations
from emcas_fmu.physics import kinematics, mechanics
from emcas_fmu.rules import check_ranges
from tests.default_actuator import ACTUATOR, PARAMETERS, namespace

from ..simulation import NAMES, inputs_at_rest, new_core, simulate

COMMON = settings(derandomize=True, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
angles = st.floats(-0.5, 0.5)
loads = st.floats(-300.0, 300.0)
Profile = list[tuple[float, float, bool, float]]  # fin command, load, enable, supply; 5 ms or five steps each
profiles = st.lists(st.tuples(angles, loads, st.booleans(), st.floats(0.0, 50.0)), min_size=1, max_size=12)


def _symmetric(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with the same friction in both directions and no offsets."""
    mirrored = {f"friction.coulomb.negative[{k}]": (-1) ** k * values[f"friction.coulomb.positive[{k}]"]
                for k in range(7)}
    return {**values, **mirrored, "kinematics.initial_angle": 0.0, "drive.current_offset": 0.0,
            "friction.viscous.negative": values["friction.viscous.positive"], "encoder.enabled": False}


@COMMON
@given(angle=st.floats(-0.43, 0.43), initial=st.floats(-0.9, 0.9))
def test_motor_and_fin_angle_are_inverse_functions(values: Mapping[str, Any], angle: float, initial: float) -> None:
    p = namespace({**values, "kinematics.initial_angle": initial})
    motor = kinematics.motor_angle(FLOATS, p, angle)
    tangent = kinematics.lever_tangent(FLOATS, p, motor)
    # Rounding of tan and atan, amplified at most by 1/cos^2(1.33) = 18.
    assert kinematics.fin_angle(FLOATS, p, tangent) == pytest.approx(angle, abs=1e-14 * 18)
    step = 1e-6
    slope = (kinematics.motor_angle(FLOATS, p, angle + step) - kinematics.motor_angle(FLOATS, p, angle - step)) / 2e-6
    # Central difference: truncation R''' h^2/6 and rounding 1e-16 * 200/1e-6.
    assert kinematics.reduction_ratio(FLOATS, p, tangent) == pytest.approx(slope, rel=1e-6)


@COMMON
@given(speed=st.floats(-300.0, 300.0), start=st.floats(-0.3, 0.3), temperature=st.floats(-20.0, 40.0),
       viscous=st.floats(0.0, 0.05), coulomb=st.floats(0.0, 5.0))
def test_friction_never_creates_energy(values: Mapping[str, Any], speed: float, start: float, temperature: float,
                                       viscous: float, coulomb: float) -> None:
    """With its drive disabled and no load, a coasting actuator never gains kinetic energy."""
    case = {**values, "friction.temperature": temperature, "friction.fin_viscous": viscous,
            "friction.fin_coulomb": coulomb}
    p = namespace(case)
    core = new_core(case)
    period, position, (_, _, current, xi), *rest = core.state
    motor = kinematics.motor_angle(FLOATS, p, start)
    core.state = (period, position, (motor, speed, current, xi), *rest)

    def energy() -> float:
        angle, w, *_ = core.state[2]
        return 0.5 * float(mechanics.coefficients(FLOATS, p, angle).inertia) * float(w)**2

    before = first = energy()
    for k in range(1, 60):
        core.run(k * 1e-3, inputs_at_rest(0.0, 0.0, 39.0, False))
        now = energy()
        # The inertia's variation with angle is integrated to second order: 1e-6 of the first energy a step.
        assert now <= before + 1e-6 * first
        before = now


@COMMON
@given(profile=profiles)
def test_mirrored_inputs_give_mirrored_outputs(values: Mapping[str, Any], profile: Profile) -> None:
    case = _symmetric(values)

    def run(sign: float) -> np.ndarray:
        core = new_core(case)
        rows = []
        for k, (command, load, enable, supply) in enumerate(profile):
            inputs = inputs_at_rest(sign * command, sign * load, supply, enable)
            core.run((k + 1) * 5e-3, inputs)
            rows.append(core.outputs(inputs)[:6])
        return np.array(rows)

    np.testing.assert_array_equal(run(1.0), -run(-1.0))  # sign changes are exact in floating point


@COMMON
@given(profile=profiles, step=st.sampled_from([0.1e-3, 0.37e-3, 1e-3, 7e-3]))
def test_limits_are_never_exceeded(values: Mapping[str, Any], profile: Profile, step: float) -> None:
    core = new_core(values)
    time = 0.0
    for command, load, enable, supply in profile:
        inputs = inputs_at_rest(command, load, supply, enable)
        for _ in range(5):
            time += step
            core.run(time, inputs)
            out = dict(zip(NAMES, core.outputs(inputs), strict=True))
            assert abs(out["fin_angle"]) <= values["fin.stop_angle"] * (1.0 + 1e-12)
            assert abs(out["drive_reference"]) <= values["drive.reference_limit"]
            if not enable:
                assert out["motor_current"] == out["supply_power"] == 0.0
            if out["at_stop"]:
                assert abs(out["fin_angle"]) == pytest.approx(values["fin.stop_angle"], rel=1e-12)


@st.composite
def parameter_sets(draw: st.DrawFn) -> dict[str, float]:
    """Return up to four parameters with any values within their limits."""
    names = draw(st.lists(st.sampled_from([v for v in PARAMETERS if v.kind == "Real"]), max_size=4, unique=True))
    return {v.name: draw(st.floats(v.minimum, v.maximum)) for v in names}


@settings(COMMON, max_examples=75)
@given(changes=parameter_sets(), profile=profiles)
def test_outputs_are_always_finite(values: Mapping[str, Any], changes: dict[str, float], profile: Profile) -> None:
    case = {**values, **changes}
    limits = [(v.name, v.minimum, v.maximum) for v in PARAMETERS if v.kind != "Boolean"]
    if check_ranges(case, limits) or check_combinations(case, ACTUATOR):
        return
    # A few ticks for any sample time.
    size = min(case["solver.max_tick"], case["controller.sample_time"]) * 4.0
    core = new_core(case)
    for k, (command, load, enable, supply) in enumerate(profile):
        inputs = inputs_at_rest(command, load, supply, enable)
        core.run((k + 1) * size, inputs)
        assert all(isfinite(x) for x in core.outputs(inputs))


def test_load_below_breakaway_does_not_move_the_fin_by_a_bit(values: Mapping[str, Any]) -> None:
    case = {**values, "drive.current_offset": 0.0}
    result = simulate(case, 0.5, step=5e-3, aero_torque=lambda t: 10.0 * (1.0 if t < 0.2 else -1.0), enable=False)
    assert set(result["fin_angle"]) == {0.0}
    moved = simulate(case, 0.5, step=5e-3, aero_torque=20.0, enable=False)
    assert abs(moved["fin_angle"][-1]) > radians(1.0)


def test_fin_rests_at_a_stop_and_leaves_it(values: Mapping[str, Any]) -> None:
    result = simulate(values, 0.6, aero_torque=lambda t: 200.0 if t < 0.3 else -200.0, enable=False)
    stop = values["fin.stop_angle"]
    resting = result["at_stop"] > 0.0
    assert resting.sum() > 50
    assert np.all(result["fin_rate"][resting] == 0.0)
    assert result["fin_angle"].max() == pytest.approx(stop, rel=1e-12)
    assert result["fin_angle"][-1] == pytest.approx(-stop, rel=1e-12)
