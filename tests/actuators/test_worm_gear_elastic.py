"""The worm gear with an elastic mesh: closed forms, energy, the rigid worm gear, both kernels."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from math import cos, degrees, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.extensions.status import OPERATIONAL
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters, require_sound
from emcas_fmu.simulation import simulate
from tests.runs import input_levels, run_both_kernels, run_within_stops
from tests.simulation import CompiledCore

from .checks import oscillation_frequency
from .test_worm_gear import FALLING, QUICK

MODEL = "worm-gear-elastic"
RIM, RATIO = 0.045, 60.0  # m, radius of the wheel's pitch circle; turns of the worm in one of the wheel


@cache
def shipped() -> Mapping[str, Any]:
    return load_parameters(model=MODEL).values


def run(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, model: str = MODEL, **inputs: Any
        ) -> dict[str, Any]:
    values = load_parameters(model=model).with_values({"encoder.enabled": False, **overrides}).values
    return simulate(values, stop, step, model=model, **inputs)


def stiffness(v: Mapping[str, Any]) -> float:
    """Return the stiffness about the hinge [N.m/rad] of worm and bearing and, with a gap, of the flanks."""
    contact = 1.0 / v["drive_line.contact_stiffness"] if v["drive_line.backlash"] else 0.0
    return float(RIM**2 / (v["drive_line.axial_compliance"] + contact))


def test_rigid_mesh_equals_the_worm_gear_to_the_bit() -> None:
    rigid = {"drive_line.axial_compliance": 0.0, "drive_line.backlash": 0.0}
    values = {**shipped(), **FALLING, **rigid}
    plain = {name: value for name, value in values.items() if not name.startswith("drive_line.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
                              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.3 < t < 0.35}
    one, other = (simulate(v, 0.5, model=model, **inputs) for v, model in ((values, MODEL), (plain, "worm-gear")))
    for name, expected in other.items():
        np.testing.assert_array_equal(one[name], expected, err_msg=name)


@pytest.mark.parametrize("gap", [2e-5, 1e-4, 4e-4])
def test_lost_motion_of_a_motor_that_reverses(gap: float) -> None:
    """In a slow cycle it is the gap and the deflection under the fin's friction in both directions."""
    overrides = {"drive_line.backlash": gap, "friction.fin_viscous": 5.0}
    rate = radians(4.0)
    shown = run(overrides, 3.0, fin_command=lambda t: rate * (1.0 - abs(t % 2.0 - 1.0)))
    lag = shown["motor_angle"] / RATIO - shown["fin_angle"]
    deflection = 2.0 * (2.0 + 5.0 * rate) / stiffness({**shipped(), **overrides})
    # Half-way up and down; the loop still settles, by 0.1 % of its rate.
    assert lag[2600] - lag[1600] == pytest.approx(gap / RIM + deflection, rel=1e-3)


@QUICK
@given(load=st.floats(-300.0, 300.0), gap=st.floats(1e-6, 4e-4), start=st.floats(-0.3, 0.3), mu=st.floats(0.0941, 0.3))
def test_a_locked_worm_holds_the_fin_within_half_the_backlash(load: float, gap: float, start: float, mu: float) -> None:
    """The deflection of the mesh adds to half the backlash; the worm is at rest to the bit."""
    overrides = {"drive_line.backlash": gap, "worm.friction": mu, "fin.start_angle": start,
                 "friction.fin_viscous": 40.0}
    shown = run(overrides, 0.4, enable=False, aero_torque=lambda t: load if t < 0.2 else -load)
    assert len(set(shown["motor_angle"])) == 1
    half, k = 0.5 * gap / RIM, stiffness({**shipped(), **overrides})
    for sign, row in ((1.0, 200), (-1.0, 400)):
        moved = sign * np.copysign(1.0, load) * (shown["fin_angle"][row] - start)
        # The fin's dry friction of 2 N.m stops it on either side of the balance; 1e-7 rad of the oscillation are left.
        assert moved <= half + (abs(load) + 2.0) / k + 1e-7
        # At (load - friction)/(40 N.m.s/rad) the fin crosses the gap within half of the 0.2 s.
        if 0.1 * (abs(load) - 2.0) > 40.0 * gap / RIM:
            assert moved >= half + (abs(load) - 2.0) / k - 1e-7


def test_natural_frequency_of_the_fin_on_the_mesh() -> None:
    """It is sqrt(k/J) of the fin alone: the worm stays at rest and takes no energy."""
    overrides = {"drive_line.axial_damping": 0.0, "drive_line.contact_damping": 0.0, "drive_line.backlash": 0.0,
                 "friction.fin_coulomb": 0.0}
    step = 2e-5
    shown = run(overrides, 0.1, step, enable=False, aero_torque=lambda t: 100.0 if t < 2e-4 else 0.0)
    assert not shown["motor_angle"].any()
    found = 2.0 * pi * oscillation_frequency(shown["fin_angle"][20:], step)
    expected = sqrt(stiffness({**shipped(), **overrides}) / 0.06)
    # The midpoint rule lengthens a period by (w h)^2/12 = 1.1e-4.
    assert found == pytest.approx(expected * (1.0 - (expected * step)**2 / 12.0), rel=1e-5)
    first, second = (np.max(np.abs(part)) for part in np.array_split(shown["fin_rate"][20:], 2))
    assert second == pytest.approx(first, rel=1e-3)  # rows miss a crest by up to (w h/2)^2/2 = 2e-4


@pytest.mark.parametrize("overrides", [{}, {"worm.friction": 0.05}, FALLING])
@pytest.mark.parametrize("torque", [60.0, -60.0])
def test_energy(overrides: Mapping[str, Any], torque: float) -> None:
    """The work of motor and load equals losses (worm, friction, hinge, mesh) and stored energy; the worm only loses."""
    step = 1e-5
    changed = {**overrides, "solver.max_tick": step, "friction.fin_viscous": 1.0, "drive_line.backlash": 1e-4}
    v = {**shipped(), **changed}
    shown = run(changed, 0.15, step, fin_command=lambda t: 0.05 * sin(40.0 * t), aero_torque=torque)
    speed, rate = shown["motor_speed"], shown["fin_rate"]
    difference = shown["motor_angle"] / RATIO - shown["fin_angle"]
    deflection = np.sign(difference) * np.maximum(np.abs(difference) - 0.5e-4 / RIM, 0.0)
    k = stiffness(v)
    contact = k / (v["drive_line.contact_stiffness"] * RIM**2)  # share of the flanks in the deflection
    damping = RIM**2 * (v["drive_line.axial_damping"] * (1.0 - contact)**2
                        + v["drive_line.contact_damping"] * contact**2)
    approach = speed / RATIO - rate
    pressed = deflection * (k * deflection + damping * approach) > 0.0
    powers = {"motor": shown["motor_torque"] * speed, "load": shown["hinge_torque"] * rate, "worm": shown["worm_loss"],
              "friction": 0.1 * np.abs(speed) + 5e-4 * speed**2, "hinge": 2.0 * np.abs(rate) + rate**2,
              "mesh": np.where(pressed, damping * approach**2, 0.0)}
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}
    stored = 0.5 * ((v["inertia.motor"] + v["inertia.worm"]) * speed**2 + 0.06 * rate**2 + k * deflection**2)
    lost = sum(work[name] for name in ("worm", "friction", "hinge", "mesh"))
    # Of 7 J; torques and the worm's loss jump within a row at reversals and impacts.
    assert work["motor"] + work["load"] == pytest.approx(lost + stored[-1] - stored[0], abs=2e-3)
    assert shown["worm_loss"].min() >= 0.0
    assert work["worm"] > 1.0


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("overrides", [{}, FALLING])
def test_kernels_agree(overrides: Mapping[str, Any]) -> None:
    v = {**shipped(), **overrides, "worm.starts": 2, "worm.teeth": 61, "drive_line.shaft_stiffness": 3e4,
         "solver.max_tick": 2e-4}
    run_both_kernels(v, 0.1, MODEL, 0.37e-3, fin_command=lambda t: 0.2 * sin(25.0 * t),
                     aero_torque=lambda t: 120.0 * sin(60.0 * t), enable=lambda t: t < 0.07)


@pytest.mark.kernel(MODEL)
@QUICK
@given(levels=input_levels(8), starts=st.integers(1, 12), mu=st.floats(0.0, 0.3), ratio=st.floats(1.0, 3.0),
       axial=st.sampled_from([0.0, 1e-12, 1e-8, 1e-6]), gap=st.sampled_from([0.0, 1e-7, 3e-5, 1e-3]),
       damping=st.sampled_from([0.0, 2e4, 1e6]), shaft=st.sampled_from([0.0, 1e3, 1e5]),
       dry=st.sampled_from([0.0, 2.0]), on_fin=st.booleans(), tick=st.sampled_from([2e-5, 1e-4, 1e-3]))
def test_outputs_are_finite_and_the_worm_only_loses_power(
        levels: list[Any], starts: int, mu: float, ratio: float, axial: float, gap: float, damping: float,
        shaft: float, dry: float, on_fin: bool, tick: float) -> None:
    v = load_parameters(model=MODEL).with_values({
        "encoder.enabled": False, "worm.starts": starts, "worm.friction": mu, "worm.static_ratio": ratio,
        "drive_line.axial_compliance": axial, "drive_line.backlash": gap, "friction.fin_coulomb": dry,
        "drive_line.contact_damping": damping, "drive_line.shaft_stiffness": shaft, "encoder.on_fin": on_fin,
        "solver.max_tick": tick}).values
    assert run_within_stops(v, MODEL, levels)["worm_loss"].min() >= 0.0


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_ticks_are_short_enough_for_a_unique_acceleration_of_a_locking_worm(mu: float) -> None:
    """-eta_b (K h^2/4 + D h/2) <= 0.9 J_r for a fin at rest: above J_r the worm's step has no unique solution."""
    actuator, v = get(MODEL), {**shipped(), "worm.friction": mu, "drive_line.axial_compliance": 1e-11,
                               "drive_line.backlash": 0.0, "solver.max_tick": 0.1, "drive.ki": 0.0}
    h = actuator.longest_tick(FLOATS, actuator.namespace(v))
    backward = (cos(radians(20.0)) - 10.0 * mu) / (cos(radians(20.0)) + 0.1 * mu)
    k, d = (x * RIM**2 / RATIO**2 for x in (1e11, v["drive_line.axial_damping"]))
    rotor = v["inertia.motor"] + v["inertia.worm"]
    assert -backward * (0.25 * k * h * h + 0.5 * d * h) == pytest.approx(0.9 * rotor, rel=1e-9)
    assert h < 1e-3


@pytest.mark.slow
def test_wear_adds_permanent_lost_motion_that_the_built_in_test_does_not_detect() -> None:
    """0.3 mm on the rim are 0.38 deg of the fin; the encoder is on the motor."""
    model = f"{MODEL}+faults"
    worn = {"fault.backlash_growth.begin": 0.0, "fault.backlash_growth.end": 0.01, "fault.backlash_growth.gap": 3e-4}
    bands, rate = [], radians(4.0)
    for changes in ({}, worn):
        shown = run({**changes, "friction.fin_viscous": 5.0}, 3.0, model=model,
                    fin_command=lambda t: rate * (1.0 - abs(t % 2.0 - 1.0)))
        lag = shown["motor_angle"] / RATIO - shown["fin_angle"]
        bands.append(lag[2600] - lag[1600])
        assert (shown["status"][10:] == OPERATIONAL).all()
    assert degrees(bands[1] - bands[0]) == pytest.approx(degrees(3e-4 / RIM), rel=1e-3)


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("stiffness", [1e-309, 1e-305])
def test_a_stiffness_without_finite_compliance_is_refused_by_name(stiffness: float) -> None:
    values = {**shipped(), "drive_line.structure_stiffness": stiffness}
    for check in (require_sound, CompiledCore):
        with pytest.raises(ParameterError, match=f"drive_line.structure_stiffness = {stiffness:g} N.m/rad: the compl"):
            check(values, MODEL)


def test_no_description_names_screw_nut_fork_or_lever() -> None:
    actuator = get(MODEL)
    described = " ".join(v.description for v in (*actuator.outputs, *actuator.parameters))
    assert not [word for word in ("screw", "nut ", "fork", "lever") if word in described]
