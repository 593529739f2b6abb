"""Contact of nut and fork: bounce, energy, free play, limit cycles, direct and indirect fin angle."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, exp, pi, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.namespace import with_values
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.steppers.elastic import Pair, advance
from tests.default_actuator import THESIS_LOOPS
from tests.marks import others_slow
from tests.simulation import acting, nested

from .line import MODEL, RIGID, SMOOTH, fin_angle_of, motor_angle_of, run_of, values_of


def _frictionless(overrides: Mapping[str, Any]) -> Any:
    """Return parameters of two inertias with only the drive line between them."""
    return nested(values_of({**SMOOTH, **overrides}), MODEL, constant_ratio=True)


_OFF = acting(enabled=False)


def _energy(p: Any, s: Pair) -> float:
    c = drive_line.line(FLOATS, p, s.fin_side_angle)
    deflection = s.motor_angle - s.fin_side_angle
    pressed, flank = drive_line.pressed(FLOATS, c, deflection, s.motor_speed - s.fin_side_speed)
    fin = drive_line.fin_side(FLOATS, p, s.fin_side_angle).inertia
    kinetic = mechanics.screw_inertia(p) * s.motor_speed**2 + fin * s.fin_side_speed**2
    return float(0.5 * (kinetic + (c.stiffness * (deflection - flank)**2 if pressed else 0.0)))


@pytest.mark.parametrize("ratio", others_slow([0.0, 0.05, 0.3, 0.8], lambda ratio: ratio == 0.3))
def test_bounce_has_the_closed_form_restitution(ratio: float) -> None:
    """A damped spring that pushes but never pulls returns the share exp(-zeta phi/q) of the impact speed.

    The bodies separate at the phase tan(phi) = 2 zeta q/(2 zeta^2 - 1), q^2 = 1 - zeta^2, where the force is zero.
    """
    p = _frictionless({**RIGID, "drive_line.backlash": 1e-4})
    fin = drive_line.fin_side(FLOATS, p, 0.0).inertia
    mass = 1.0 / (1.0 / mechanics.screw_inertia(p) + 1.0 / fin) / p.screw.lead**2  # along the screw
    damping = 2.0 * ratio * sqrt(p.drive_line.contact_stiffness * mass)
    p = with_values(p, {"drive_line.contact_damping": damping})
    q = sqrt(1.0 - ratio**2)
    expected = exp(-ratio / q * atan2(2.0 * ratio * q, 2.0 * ratio**2 - 1.0)) if ratio else 1.0
    s, h = Pair(0.0, 20.0, 0.0, 0.0, 0.0, -5.0), 1e-6
    momentum = mechanics.screw_inertia(p) * s.motor_speed + fin * s.fin_side_speed
    while s.motor_speed - s.fin_side_speed > 0.0 or s.motor_angle - s.fin_side_angle > 0.0:
        s, _ = advance(FLOATS, p, s, _OFF, h)
    # Stepping is of second order in w h = 4e-3 per tick; the instant of separation is located more accurately.
    assert (s.fin_side_speed - s.motor_speed) / 25.0 == pytest.approx(expected, rel=1e-4)
    assert mechanics.screw_inertia(p) * s.motor_speed + fin * s.fin_side_speed == pytest.approx(momentum, rel=1e-9)


@settings(derandomize=True, max_examples=12)
@given(axial=st.sampled_from([0.0, 1e-9, 1e-8, 1e-6]), torsional=st.sampled_from([0.0, 1e-3, 0.1]),
       gap=st.sampled_from([1e-5, 1e-4, 1e-3]), damping=st.sampled_from([0.0, 1e3, 1e5]),
       speeds=st.tuples(st.floats(-300, 300), st.floats(-300, 300)),
       offset=st.floats(-0.9, 0.9), h=st.sampled_from([5e-6, 5e-5, 3e-4]))
def test_contact_creates_no_energy(axial: float, torsional: float, gap: float, damping: float,
                                   speeds: tuple[float, float], offset: float, h: float) -> None:
    p = _frictionless({
        "drive_line.axial_compliance": axial, "drive_line.torsional_compliance": torsional,
        "drive_line.backlash": gap, "drive_line.contact_damping": damping, "drive_line.axial_damping": 0.0,
        "drive_line.torsional_damping": 0.0, "fin.stop_angle": radians(70.0)})
    half = 0.5 * gap / p.screw.lead
    s = Pair(offset * half, speeds[0], 0.0, 0.0, 0.0, speeds[1])
    largest = start = _energy(p, s)
    for _ in range(300):
        s, _ = advance(FLOATS, p, s, _OFF, h)
        largest = max(largest, _energy(p, s))
    # Contact is located within 1e-6 of a tick or MET = 1e-9 rad, whichever is larger; 1e-9 rad of a drive line of
    # 1e3 N.m/rad store 5e-16 J.
    assert largest <= start * (1.0 + 1e-6) + 1e-15


@pytest.mark.parametrize(("command", "overrides"), [
    (-0.2, {"friction.fin_viscous": 5.0}), (-0.3, {"friction.fin_viscous": 5.0}),
    (0.1, {"friction.fin_viscous": 20.0, "drive_line.backlash": 2e-5}), (0.05, {"drive_line.backlash": 1e-9}),
])
def test_slow_separation_from_a_flank_does_not_stall_the_run(command: float, overrides: Mapping[str, Any]) -> None:
    """During 20 s the limit cycle leaves flanks so slowly that a tick moves the angle by less than rounding."""
    run = run_of({"encoder.enabled": False, **overrides}, 20.0, fin_command=lambda t: command if t > 0.05 else 0.0)
    assert abs(run["tracking_error"][-1]) < radians(0.2)


def test_nut_position_includes_shaft_and_screw_but_no_gap() -> None:
    """Under a load the nut lags the rotor by the deflection of shaft and screw, without gap and contact."""
    torque = -60.0
    run = run_of({"friction.fin_viscous": 20.0, "friction.fin_coulomb": 0.0}, 2.0, aero_torque=torque)
    p = nested(values_of(), MODEL)
    tangent = tan(run["fin_angle"][-1] + p.kinematics.initial_angle)
    at_screw = -torque / (p.kinematics.moment_arm / p.screw.lead * (1.0 + tangent * tangent))
    twist = at_screw * (p.drive_line.torsional_compliance + p.drive_line.axial_compliance / p.screw.lead**2)
    lag = run["motor_angle"][-1] - run["nut_position"][-1] / p.screw.lead
    assert twist > 1e-4
    assert lag == pytest.approx(twist, rel=1e-2)  # after 2 s the fin still creeps


def test_free_play_under_a_small_torque_is_gap_and_deflection() -> None:
    """The motor's friction holds against a torque that moves the fin from flank to flank."""
    for gap in (2e-5, 5e-5, 2e-4):
        run = run_of({"drive_line.backlash": gap, "friction.fin_viscous": 5.0, "friction.fin_coulomb": 0.0}, 1.0,
                     enable=False, aero_torque=lambda t: 2.0 if t < 0.5 else -2.0)
        values = values_of({"drive_line.backlash": gap})
        p = nested(values, MODEL)
        play = np.ptp((run["motor_angle"] - motor_angle_of(values, run["fin_angle"]))[[499, 999]])
        ratio = p.kinematics.moment_arm / p.screw.lead / cos(p.kinematics.initial_angle)**2
        deflection = 4.0 / ratio / drive_line.line(FLOATS, p, 0.0).stiffness
        # The ratio varies over the gap by 1/300 of the deflection, itself 1 % to 10 % of the gap.
        assert play * p.screw.lead == pytest.approx(gap + deflection * p.screw.lead, rel=1e-3)
        assert run["motor_angle"][999] - run["motor_angle"][499] < 0.01 * play  # the impact moves the rotor a little


def test_limit_cycle_needs_gap_and_integral_or_gain() -> None:
    """A loop over the gap, with the encoder on the fin, has a limit cycle whose amplitude is in proportion to the gap.

    Without dry friction about the hinge a PI loop has it at any gain; a P loop of the same gain comes to rest. With the
    default friction the PI loop also comes to rest.
    """
    loops = {**THESIS_LOOPS, "encoder.enabled": False, "friction.fin_viscous": 5.0}
    gain = THESIS_LOOPS["controller.position.kp"]

    def width(gap: float, share: float, on_fin: bool = True, dry: float = 0.0,
              ki: float = THESIS_LOOPS["controller.position.ki"]) -> float:
        run = run_of({**loops, "drive_line.backlash": gap, "controller.position.kp": share * gain,
                      "encoder.on_fin": on_fin, "friction.fin_coulomb": dry, "controller.position.ki": ki}, 20.0,
                     fin_command=lambda t: 0.02 if t > 0.05 else 0.0)
        return float(np.degrees(np.ptp(run["fin_angle"][17000:])))

    assert width(0.0, 2.0) < 1e-3
    assert width(1e-4, 2.0, on_fin=False) < 1e-3
    assert width(1e-4, 1.0, ki=0.0) < 1e-3
    assert width(1e-4, 1.0, dry=values_of()["friction.fin_coulomb"]) < 1e-3
    assert width(1e-4, 1.0) > 2e-2
    small, large = width(1e-4, 2.0), width(2e-4, 2.0)
    assert small > np.degrees(1e-4 / 0.05)  # wider than the gap
    assert large == pytest.approx(2.0 * small, rel=0.25)  # friction does not grow with the gap


def test_encoder_on_the_fin_measures_the_fin_and_that_on_the_motor_the_motor() -> None:
    on_fin, on_motor = (run_of({"encoder.on_fin": on, "drive_line.backlash": 2e-4}, 0.5, fin_command=0.05,
                               aero_torque=-40.0) for on in (True, False))
    count = 2.0 * pi / 8192
    for run, measured, is_motor in ((on_fin, on_fin["fin_angle"], False), (on_motor, on_motor["motor_angle"], True)):
        # A row shows the sample at the beginning of the step to it.
        counted = np.floor(measured[:-1] / count) * count
        expected = fin_angle_of(counted) if is_motor else counted
        at_edge = np.abs(measured[:-1] / count - np.round(measured[:-1] / count)) < 1e-6  # rounding decides the count
        assert run["measured_fin_angle"][1:][~at_edge] == pytest.approx(expected[~at_edge], abs=1e-12)
    lost_motion = fin_angle_of(on_motor["motor_angle"][-1]) - on_motor["fin_angle"][-1]
    assert lost_motion > 1e-4 / 0.05 * 0.98  # half the gap, at 8 deg of the lever
